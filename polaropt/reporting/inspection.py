"""What a capture is, before anything is solved."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import (
    Capture,
    EncodingHint,
    GammaFit,
    JpegFacts,
    NoiseModel,
    Origin,
    correlated_noise,
    exchanged_order,
    fit_gamma,
    grey_levels,
    measured_noise,
    noise_level,
    orthogonal_pairs,
    pair_gain_of,
    swapped_photographs,
    uneven_gains,
    visible_shift,
)
from polaropt.estimation import agreeing_photographs, motion_shows, still_photographs, unglazed_pixels
from polaropt.numerics import middle_part, quantization_step, strips, whole_blocks
from polaropt.optics import stokes_from_intensities
from polaropt.reporting.pictures import grey_strips
from polaropt.reporting.report import json_values

# Side in pixels of the blocks whose polarization is summed up: noise of a pixel alone looks polarized. Set by hand.
_SUMMARY_BLOCK = 2
# Share of the pixels that may be darker than black, as defects are. Set by hand.
_DARKEST_SHARE = 1e-3
# Values that a quantile is taken of, for its time's sake.
_MOST_SAMPLES = 4e6
# Side in pixels of the middle of a frame by which it is asked whether photographs agree, for its time's sake.
_COMPARED_PX = 1024
# Least light, white = 1, and least sums that are divided by: far below any noise.
_NO_LIGHT, _NOTHING = 1e-9, 1e-30
# Least length of the mean direction: its deviation is infinite at none.
_LEAST_LENGTH = 1e-12


@dataclass(frozen=True)
class Inspection:
    """Facts about a capture.

    Attributes
    ----------
    width, height, channels : int
        Size of a photograph in pixels; 1 channel for grey.
    angles_deg : tuple of float
    layout : str
        "files", "stack", "mono mosaic", "color mosaic" or "memory".
    sample_type : str
        Type of the values in the file; empty for a capture made in memory.
    grey_levels : int or None
        Number of levels between black and white; None where values lie on no grid.
    black_level, white_level : float
        In the file's units.
    brightest : float
        Highest value (white = 1).
    darkest : float or None
        Value that 0.1 % of the pixels are below, in the file's units; None where the values were encoded. The black
        level is hardly above it.
    noise : float
        Standard deviation of the noise of one photograph (white = 1).
    slow_noise : float
        How many times as noisy slow changes are as if the noise of each pixel were its own: 1 of white noise, more
        where photographs were demosaicked, resized or smoothed.
    pair_gain : float or None
        Gain of the 45/135 pair against the 0/90 pair as photographed; None where the angles tell nothing.
    pair_gain_removed : float
        What of it was divided out when the capture was read.
    saturated_share : float
        Share of pixels that are invalid at one angle at least.
    dolp_median, dolp_95 : float
        Degree of linear polarization, colours together, over unclipped blocks of 2x2 pixels.
    aolp_deg, aolp_spread_deg : float
        Mean angle of linear polarization (0..180), weighted by the polarized light, and its circular deviation.
    gamma_exponent, gamma_error : float or None
        Exponent that makes the photographs linear, and its standard error; None where nothing tells it.
    looks_encoded : bool or None
        Whether the photographs look gamma-encoded; None: cannot be told.
    encoding_hint : EncodingHint
        What the file format says about encoding.
    swapped_deg : tuple of pairs of float
        Angles of photographs of which one pair looks swapped; empty if the order looks right.
    visible_shift_px : float
        About how far photographs are shifted against each other; 0 if not surely by more than half a pixel.
    cell_order : tuple of float or None
        Polarizer angles of a mosaic's cell as it was read.
    cell_order_found : bool
        Whether that is not the usual order, which was not asked for and whose orthogonal pairs do not add up.
    closing_orders : tuple of tuples of float
        Orders of the cell in which pairs would add up, where they do not; the nearest ones.
    left_out_px : (int, int)
        Rows and columns of a mosaic that make no whole pattern, and were left out.
    defects : int
        Samples of a mosaic that stood out by themselves and were replaced.
    exposures : tuple of float
        As the files tell them, in seconds at ISO 100, or as given; divided out where they differ.
    exposures_given : bool
        Whether a person gave them.
    orientation : int
        How the camera was held, as EXIF has it: the photographs were turned upright.
    profile : str
        Name of the files' colour profile; empty for none or sRGB.
    profile_exponent : float or None
        Of its encoding: 1 where it says that values are linear; None where it tells none.
    shown_in_srgb : bool
        Whether pictures to look at are converted from it to sRGB.
    jpeg : JpegFacts or None
        How strongly JPEG files were compressed.
    uneven_gains : tuple of (float, float)
        Angles of photographs of which one looks exposed unlike the others, and how bright they are beside them.
    moving_share : float or None
        Share of the frame in which something moves between the photographs; None where that would not show: of three
        angles, and of a mosaic, whose samples are taken at once.
    layer_shifts_px : tuple of tuples of pairs of float
        How far down and to the right of the first photograph each shows one layer and the other, where these lie in
        places of their own; empty where the photographs show both layers together. Of the middle of large frames.
    blurs_px : tuple of float
        Standard deviation of the Gaussian by which each photograph is less sharp than the sharpest; empty where all
        are equally sharp. Of the middle of large frames.
    unglazed_share : float
        Share of the frame that looks as if it showed no glass. How the pane stands decides: near normal incidence glass
        looks the same.
    """

    width: int
    height: int
    channels: int
    angles_deg: tuple[float, ...]
    layout: str
    sample_type: str
    grey_levels: int | None
    black_level: float
    white_level: float
    brightest: float
    darkest: float | None
    noise: float
    slow_noise: float
    pair_gain: float | None
    pair_gain_removed: float
    saturated_share: float
    dolp_median: float
    dolp_95: float
    aolp_deg: float
    aolp_spread_deg: float
    gamma_exponent: float | None
    gamma_error: float | None
    looks_encoded: bool | None
    encoding_hint: EncodingHint
    swapped_deg: tuple[tuple[float, float], ...]
    visible_shift_px: float
    cell_order: tuple[float, ...] | None = None
    cell_order_found: bool = False
    closing_orders: tuple[tuple[float, ...], ...] = ()
    left_out_px: tuple[int, int] = (0, 0)
    defects: int = 0
    exposures: tuple[float, ...] = ()
    exposures_given: bool = False
    orientation: int = 1
    profile: str = ""
    profile_exponent: float | None = None
    shown_in_srgb: bool = False
    jpeg: JpegFacts | None = None
    uneven_gains: tuple[tuple[float, float], ...] = ()
    moving_share: float | None = None
    layer_shifts_px: tuple[tuple[tuple[float, float], ...], ...] = ()
    blurs_px: tuple[float, ...] = ()
    unglazed_share: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """The same as plain values, for JSON."""
        values: dict[str, Any] = json_values(self)
        return values


def inspect_capture(capture: Capture) -> Inspection:
    """Measure what a capture is: size, noise, gain, saturation, polarization, motion, and signs of mistakes.

    Whether the photographs agree, or show both layers in places of their own or not equally sharp, is asked in the
    middle of large ones.

    Parameters
    ----------
    capture : Capture
        `capture.origin` adds what only the files tell.
    """
    if not motion_shows(capture):
        return _with_unglazed(inspect_still(capture, None), capture, *measured_noise(capture))
    still = still_photographs(capture)
    inspection = inspect_still(capture, still.moving)
    middle = capture.part(*middle_part(capture.shape, _COMPARED_PX))
    whole = middle.shape == capture.shape
    _, agreeing, matching = agreeing_photographs(middle, still if whole else still_photographs(middle))
    if matching is None:
        return _with_unglazed(inspection, still.capture, still.noise, still.growth)
    if not agreeing.mistakes.swapped:
        inspection = replace(inspection, swapped_deg=())
    layers = matching.transfer.layers
    if layers is None:
        return replace(inspection, blurs_px=matching.transfer.blurs_px if matching.transfer.blurred else ())
    # That both layers move by themselves passes for motion of what they show.
    shifts = tuple(tuple((float(down), float(right)) for down, right in of_layer) for of_layer in layers.shifts_px)
    return replace(inspection, layer_shifts_px=shifts, visible_shift_px=0.0, moving_share=agreeing.moving_share)


def _with_unglazed(inspection: Inspection, capture: Capture, noise: float, growth: NoiseModel) -> Inspection:
    """The same with how much of the frame looks as if it showed no glass."""
    unglazed = unglazed_pixels(capture, noise, growth)
    return inspection if unglazed is None else replace(inspection, unglazed_share=float(unglazed.mean()))


def inspect_still(capture: Capture, moving: NDArray[np.bool_] | None) -> Inspection:
    """The same, where it is known what moves.

    Parameters
    ----------
    capture : Capture
    moving : ndarray of bool, shape (h, w), or None
        Pixels in which something moves between the photographs.

    Returns
    -------
    Inspection
    """
    whole, photographs = capture, capture if moving is None else capture.left_out(moving)
    origin, capture = capture.origin, photographs.registered
    removed = 1.0 if origin is None else origin.pair_gain
    swapped = swapped_photographs(capture)
    moved = visible_shift(capture)
    cell_order = None if origin is None else origin.cell_order
    hint = EncodingHint.NONE if origin is None or origin.gamma is not None else origin.encoding_hint
    # Swapped and shifted photographs break the same identity that the encoding does, and so do exposures that were
    # divided out of encoded values.
    spoilt = hint.decides and exposed_apart(() if origin is None else origin.exposures)
    gamma = None if swapped or moved or spoilt else fit_gamma(capture)
    noise = noise_level(photographs)
    correlated = correlated_noise(photographs, noise)
    return Inspection(
        width=photographs.shape[-1],
        height=photographs.shape[-2],
        channels=capture.shape[0] if capture.color else 1,
        angles_deg=capture.angles_deg,
        layout="memory" if origin is None else origin.layout,
        sample_type="" if origin is None else origin.sample_type,
        grey_levels=_grey_levels(capture),
        black_level=0.0 if origin is None else origin.black_level,
        white_level=1.0 if origin is None else origin.white_level,
        brightest=float(capture.intensities.max()),
        darkest=_darkest(capture),
        noise=noise,
        slow_noise=1.0 if correlated is None else correlated.slow,
        pair_gain=_gain_as_photographed(capture, removed),
        pair_gain_removed=removed,
        saturated_share=_saturated_share(whole.registered),
        **_polarization(capture),
        gamma_exponent=gamma.exponent if gamma is not None and gamma.certain else None,
        gamma_error=gamma.standard_error if gamma is not None and gamma.certain else None,
        looks_encoded=_looks_encoded(gamma, hint),
        encoding_hint=hint,
        swapped_deg=tuple((capture.angles_deg[a], capture.angles_deg[b]) for a, b in swapped),
        visible_shift_px=moved,
        cell_order=cell_order,
        cell_order_found=origin is not None and origin.cell_order_found,
        closing_orders=() if cell_order is None else tuple(exchanged_order(cell_order, pair) for pair in swapped),
        left_out_px=(0, 0) if origin is None else origin.left_out_px,
        defects=0 if origin is None else origin.defects,
        **_as_taken(origin or Origin()),
        uneven_gains=() if moved or spoilt else uneven_gains(capture),
        moving_share=_moving_share(whole, moving),
    )


def _as_taken(origin: Origin) -> dict[str, Any]:
    """How the camera was held and exposed, and what its files are."""
    return {
        "exposures": origin.exposures,
        "exposures_given": origin.exposures_given,
        "orientation": origin.orientation,
        "profile": origin.camera.colors.name,
        "profile_exponent": origin.camera.colors.exponent,
        "shown_in_srgb": origin.camera.colors.to_srgb is not None,
        "jpeg": origin.jpeg,
    }


def _moving_share(capture: Capture, moving: NDArray[np.bool_] | None) -> float | None:
    if not motion_shows(capture):
        return None
    return 0.0 if moving is None else float(moving.mean())


def _saturated_share(capture: Capture) -> float:
    """Share of the pixels of a plane that some photograph clips."""
    parts = (capture.mask[..., rows, :] for rows in strips(capture.shape[-2], capture.mask.size // capture.shape[-2]))
    trusted = sum(int(np.count_nonzero(part.all(axis=0))) for part in parts)
    n = math.prod(capture.shape)
    return (n - trusted) / n


_SAME_EXPOSURE = 1.001
"""Ratio of exposures that are the same: cameras round them. Set by hand."""


def _darkest(capture: Capture) -> float | None:
    origin = capture.origin or Origin()
    if origin.gamma is not None:
        return None
    step = max(1, round(math.sqrt(capture.intensities.size / _MOST_SAMPLES)))
    # A defect or two are darker than black.
    value = float(np.quantile(capture.intensities[..., ::step, ::step], _DARKEST_SHARE))
    return origin.black_level + value * (origin.white_level - origin.black_level)


def exposed_apart(exposures: tuple[float, ...]) -> bool:
    """Whether photographs were exposed differently, which was divided out."""
    return bool(exposures) and max(exposures) > _SAME_EXPOSURE * min(exposures)


def _looks_encoded(gamma: GammaFit | None, hint: EncodingHint) -> bool | None:
    """The photographs' own word counts; the file format's only where they say nothing."""
    if gamma is not None and gamma.certain:
        return True if gamma.encoded else (False if gamma.linear else None)
    return True if hint.decides else None


def _gain_as_photographed(capture: Capture, removed: float) -> float | None:
    gain = pair_gain_of(capture.intensities, capture.angles_deg, capture.mask)
    return None if gain is None else gain * removed


def _grey_levels(capture: Capture) -> int | None:
    origin = capture.origin or Origin()
    if origin.grey_levels is not None:
        return origin.grey_levels
    # A divided gain makes the levels of its pair denser or sparser; the first pair is as stored.
    pairs = orthogonal_pairs(capture.angles_deg)
    photograph = capture.intensities[0 if pairs is None else pairs[0][0]]
    return grey_levels(quantization_step(photograph[None]), origin)


def _polarization(capture: Capture) -> dict[str, Any]:
    """DoLP and AoLP of small blocks that are valid at every angle (of all blocks, if there are none)."""
    dolp, total, directed = _polarized_blocks(capture, trusted=True)
    if not dolp.size:
        dolp, total, directed = _polarized_blocks(capture, trusted=False)
    resultant = directed / max(total, _NOTHING)
    length = float(np.clip(np.abs(resultant), _LEAST_LENGTH, 1))
    return {
        "dolp_median": float(np.median(dolp)),
        "dolp_95": float(np.quantile(dolp, 0.95)),
        "aolp_deg": float(np.degrees(np.angle(resultant)) / 2 % 180),
        "aolp_spread_deg": float(np.degrees(np.sqrt(-2 * np.log(length))) / 2),
    }


def _polarized_blocks(capture: Capture, *, trusted: bool) -> tuple[NDArray[np.float32], float, complex]:
    """DoLP of each block, all polarized light, and its sum as (s1, s2); some rows at a time."""
    dolp, total, directed = [], 0.0, 0j
    planes = tuple(range(capture.intensities.ndim - 2))
    for rows, means in grey_strips(capture, _SUMMARY_BLOCK):
        stokes = stokes_from_intensities(means, capture.angles_deg)
        trusted_in_all = np.asarray(capture.mask[..., rows, :].all(axis=planes))
        whole = whole_blocks(trusted_in_all, _SUMMARY_BLOCK) & (stokes[0] > 0)
        s0, s1, s2 = stokes[:, whole] if trusted else stokes.reshape(3, -1)
        polarized = np.hypot(s1, s2)
        dolp.append(np.clip(polarized / np.maximum(s0, _NO_LIGHT), 0, 1))
        total += float(polarized.sum(dtype=np.float64))
        directed += complex(*(part.sum(dtype=np.float64) for part in (s1, s2)))
    return np.concatenate(dolp), total, directed
