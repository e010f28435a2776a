"""Pictures of captures and separations: exposure, polarization in colours, errors, misfit."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, encode_srgb, planes_last
from polaropt.numerics import block_mean, block_shares, in_color, strips
from polaropt.optics import dolp_aolp, stokes_from_intensities

if TYPE_CHECKING:
    from polaropt.judging import UncertaintyStrip
    from polaropt.separation import Separation


Image = NDArray[np.float32]
Picture = NDArray[np.uint8]

LAYERS = ("transmission", "reflection")
"""The layers in their order, as files, pictures and reports call them."""

# Quantile that becomes white in a picture to look at: highlights above it are few. Set by hand.
_WHITE_QUANTILE = 0.99
# Least value, white = 1, that is scaled to white: below it is nothing to see.
_LEAST_WHITE = 1e-6
# Values that a quantile is taken of, for the sake of time and memory.
_MOST_SAMPLES = 4_000_000
# The same of standard errors, which change slowly and wait until all rows are known.
_MOST_ERRORS = 1_000_000
_PAPER = (255, 255, 255)
# Of pictures side by side, in pixels: height of a title, room between pictures, size of letters.
_TITLE, _GAP, _LETTERS = 24, 8, 14
# Longest side in pixels of a picture in a contact sheet, and JPEG quality. Set by hand.
_THUMBNAIL, _THUMBNAIL_QUALITY = 192, 80


def viewing_exposure(layer: Image) -> float:
    """Factor that brings the 99 % quantile of a layer to white.

    Each layer has its own: a mirrored sky is up to fifty times as bright as what is behind the surface, and with one
    factor for both the other picture would be black.
    """
    bright = float(np.quantile(_thinned(layer), _WHITE_QUANTILE))
    return 1 / bright if bright > 0 else 1.0


def _thinned(values: Image) -> Image:
    """All values of an image, or of a large one as many as a quantile needs."""
    return values.reshape(-1)[:: max(1, values.size // _MOST_SAMPLES)]


def side_by_side(rows: Sequence[Sequence[tuple[str, Image | None]]], exposure: float = 1.0) -> Picture:
    """Rows of linear images (h, w[, 3]) of one size with titles, as 8-bit sRGB (h, w, 3); None leaves a gap."""
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    height, width = next(image.shape[:2] for _, image in rows[0] if image is not None)
    size = (_GAP + max(map(len, rows)) * (width + _GAP), _GAP + len(rows) * (height + _TITLE + _GAP))
    canvas = Pillow.new("RGB", size, _PAPER)
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(_LETTERS)
    for i, row in enumerate(rows):
        for j, (title, image) in enumerate(row):
            left, top = _GAP + j * (width + _GAP), _GAP + i * (height + _TITLE + _GAP)
            draw.text((left, top + 2), title, fill=0, font=font)
            if image is not None:
                pixels = np.round(255 * encode_srgb(in_color(image) * exposure)).astype(np.uint8)
                canvas.paste(Pillow.fromarray(pixels), (left, top + _TITLE))
    return np.asarray(canvas, dtype=np.uint8)


MISFIT_WHITE = 10.0
"""Multiple of the noise that is white in a picture of the map; set by hand."""


def misfit_map(result: Separation, capture: Capture) -> NDArray[np.float32]:
    """Residual of the photographs in units of their noise, root mean square over photographs and colours, (h, w).

    About 1 where the model holds; 0 where every photograph is clipped. Of a mosaic the samples alone count.
    """
    count = np.zeros(capture.shape[-2:], dtype=np.float32)
    total = np.zeros_like(count)
    observed = capture.observed
    for strip in result.component_strips():
        of_strip, n = total[strip.rows], count[strip.rows]
        trusted = observed.mask[..., strip.rows, :]
        for k, valid in enumerate(trusted):
            photograph = observed.intensities[k][..., strip.rows, :]
            squares = np.square(strip.components[0, k] + strip.components[1, k] - photograph) * valid
            of_strip += squares.reshape(-1, *n.shape).sum(axis=0)
            n += valid.reshape(-1, *n.shape).sum(axis=0)
    mean = np.sqrt(total / np.maximum(count, 1)) / np.float32(result.diagnostics.noise)
    return np.asarray(mean, dtype=np.float32)


# Colour of what is marked, and its share beside the photograph's own; set by hand.
_MARK, _MARK_SHARE = (1.0, 0.3, 0.1), 0.6


def marked_picture(capture: Capture, marked: NDArray[np.bool_], block: int = 1) -> Picture:
    """The light of all polarizations in grey, and in red what is marked, such as what moves, (h, w, 3).

    Parameters
    ----------
    capture : Capture
    marked : ndarray of bool, shape (h, w)
    block : int
        Side in pixels of the blocks over which means are taken.
    """
    light = grey_means(capture, block).mean(axis=0)
    grey = encode_srgb(light / max(float(np.quantile(light, _WHITE_QUANTILE)), _LEAST_WHITE))[..., None]
    share = np.float32(_MARK_SHARE) * block_mean(marked.astype(np.float32), block)[..., None]
    colors = (1 - share) * grey + share * np.array(_MARK, dtype=np.float32)
    return np.round(255 * colors).astype(np.uint8)


Floats = NDArray[np.floating[Any]]

# Of the panels of an inspection, in pixels: most and least width, room between panels, height of title and colour key
# with its note, size of letters.
_WIDEST, _NARROWEST, _PANEL_GAP, _PANEL_TITLE, _KEY, _PANEL_LETTERS = 640, 260, 12, 26, 68, 13
# Length and height of a key's bar and the room left of it, in pixels.
_BAR, _BAR_HEIGHT, _BAR_LEFT = 200, 12, 4
# Quantile of the degree of polarization from which the angle has its full colour, and the least such degree.
_FULL_COLOR_QUANTILE, _LEAST_FULL_COLOR = 0.95, 0.02
_HUE_SATURATION = 0.85
_SATURATED_GREY = 128
DOLP_TICKS = ("0", "0.5", "1")
AOLP_TICKS = ("0", "45", "90", "135", "180 deg")
# Dark to bright, also in grey print.
_DOLP_COLORS = ((0, 0, 4), (60, 15, 110), (140, 41, 129), (222, 73, 104), (254, 159, 109), (252, 253, 191))


def inspection_picture(capture: Capture) -> Picture:
    """Picture (h, w, 3) of intensity | DoLP | AoLP with titles and colour keys, for people.

    Intensity is s0, its 99 % quantile white, sRGB. DoLP runs from black (0) over purple to pale yellow (1). AoLP is the
    hue; brightness there is the DoLP, full from its 95 % quantile up, so that unpolarized pixels are black. Saturated
    pixels are grey in the last two. Large captures are reduced to at most 640 px per panel.
    """
    polarization = polarization_panels(capture)
    panels = [_intensity_panel(capture), polarization.dolp, polarization.aolp]
    keys = [
        None,
        dolp_colors(np.linspace(0, 1, _BAR)[None]),
        aolp_colors(np.linspace(0, 180, _BAR)[None], np.ones((1, _BAR))),
    ]
    titles = ("intensity", "degree of polarization", "angle of polarization")
    ticks = ((), DOLP_TICKS, AOLP_TICKS)
    notes = ("", "grey: saturated", f"black: unpolarized; full colour from {polarization.full:.2f}")
    columns = [_column(*parts) for parts in zip(panels, titles, keys, ticks, notes, strict=True)]
    gap = np.full((columns[0].shape[0], _PANEL_GAP, 3), _PAPER, dtype=np.uint8)
    return np.concatenate([gap, columns[0], gap, columns[1], gap, columns[2], gap], axis=1)


@dataclass(frozen=True)
class PolarizationPanels:
    """Degree and angle of polarization as pictures (h, w, 3), and the degree from which the angle has full colour."""

    dolp: Picture
    aolp: Picture
    full: float


def polarization_panels(capture: Capture) -> PolarizationPanels:
    """Panels of `inspection_picture`, without titles and keys."""
    stokes, valid = _gray_stokes(capture)
    dolp, aolp = dolp_aolp(stokes)
    full = float(np.quantile(dolp[valid], _FULL_COLOR_QUANTILE)) if valid.any() else 1.0
    full = max(full, _LEAST_FULL_COLOR)
    angles = aolp_colors(aolp, np.clip(dolp / full, 0, 1))
    return PolarizationPanels(_masked(dolp_colors(dolp), valid), _masked(angles, valid), full)


def dolp_colors(dolp: Floats) -> Picture:
    """DoLP 0..1 to colours (..., 3)."""
    stops = np.linspace(0, 1, len(_DOLP_COLORS))
    table = np.asarray(_DOLP_COLORS, dtype=np.float64)
    return np.stack([np.interp(dolp, stops, table[:, k]) for k in range(3)], axis=-1).astype(np.uint8)


def aolp_colors(aolp_deg: Floats, brightness: Floats) -> Picture:
    """Angles, 0..180 degrees once around the hues, and brightness 0..1 to colours (..., 3)."""
    table = np.array([colorsys.hsv_to_rgb(k / 180, _HUE_SATURATION, 1.0) for k in range(180)])
    colors = table[np.round(aolp_deg).astype(int) % 180]
    return np.asarray(255 * colors * np.asarray(brightness)[..., None]).astype(np.uint8)


def _reduction(capture: Capture) -> int:
    return -(-capture.shape[-1] // _WIDEST)


def _gray_stokes(capture: Capture) -> tuple[Floats, NDArray[np.bool_]]:
    block = _reduction(capture)
    whole = block_shares(capture.valid_in_all, block) > 0.5
    return stokes_from_intensities(grey_means(capture, block), capture.angles_deg), whole


def thumbnail_strip(result: Separation, capture: Capture) -> bytes:
    """Photograph, transmission and reflection side by side, small, as JPEG; each with its own exposure."""
    from imagecodecs import jpeg_encode

    block = -(-max(capture.shape[-2:]) // _THUMBNAIL)
    shown = (reduced_intensity(capture, block), *(block_mean(layer, block) for layer in result.layers))
    parts = [planes_last(np.asarray(part * np.float32(viewing_exposure(part)), dtype=np.float32)) for part in shown]
    strip = np.concatenate(parts, axis=1)
    return bytes(
        jpeg_encode(np.round(255 * encode_srgb(strip, capture.camera)).astype(np.uint8), level=_THUMBNAIL_QUALITY)
    )


def grey_means(capture: Capture, block: int) -> Image:
    """Photographs (k, h // block, w // block), means over blocks and colours."""
    return np.concatenate([means for _, means in grey_strips(capture, block)], axis=-2)


def grey_strips(capture: Capture, block: int) -> Iterator[tuple[slice, Image]]:
    """Rows from top to bottom and their `grey_means`."""
    height, images = capture.shape[-2], capture.intensities
    for rows in strips(height, images.size // height, block):
        part = images[..., rows, :]
        yield rows, block_mean(part.mean(axis=1) if capture.color else part, block)


def reduced_intensity(capture: Capture, block: int) -> Image:
    """The light of all polarizations, means over blocks, ([channel,] h // block, w // block)."""
    return np.concatenate([block_mean(part, block) for _, part in capture.intensity_strips(block)], axis=-2)


def _intensity_panel(capture: Capture) -> Picture:
    s0 = reduced_intensity(capture, _reduction(capture))
    bright = s0 / max(float(np.quantile(s0, _WHITE_QUANTILE)), _LEAST_WHITE)
    if capture.color and bright.shape[0] == 3:
        return np.round(255 * encode_srgb(planes_last(bright), capture.camera)).astype(np.uint8)
    view = encode_srgb(bright)
    gray = view.mean(axis=0) if capture.color else view
    return np.repeat(np.round(255 * gray).astype(np.uint8)[..., None], 3, axis=-1)


def _masked(colors: Picture, valid: NDArray[np.bool_]) -> Picture:
    return np.where(valid[..., None], colors, np.uint8(_SATURATED_GREY)).astype(np.uint8)


def _column(panel: Picture, title: str, key: Picture | None, ticks: tuple[str, ...], note: str) -> Picture:
    """One panel with its title above, its key and what that leaves open below."""
    from PIL import Image, ImageDraw, ImageFont

    width = max(panel.shape[1], _NARROWEST)
    canvas = Image.new("RGB", (width, panel.shape[0] + _PANEL_TITLE + _KEY), _PAPER)
    canvas.paste(Image.fromarray(panel), (0, _PANEL_TITLE))
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(_PANEL_LETTERS)
    below = _PANEL_TITLE + panel.shape[0]
    draw.text((0, 6), title, fill=0, font=font)
    draw.text((_BAR_LEFT, below + 44), note, fill=0, font=font)
    if key is not None:
        length = min(_BAR, width - 40)
        canvas.paste(Image.fromarray(key).resize((length, _BAR_HEIGHT)), (_BAR_LEFT, below + 8))
        for k, tick in enumerate(ticks):
            left = _BAR_LEFT + round(k * (length - 1) / (len(ticks) - 1)) - 3
            draw.text((min(left, width - font.getlength(tick)), below + 24), tick, fill=0, font=font)
    return np.asarray(canvas, dtype=np.uint8)


FADED = 0.2
"""Where less than this share of its detail is known, the reflection shows slow changes only; set by hand."""

# Longest side in pixels of a panel of uncertainties.
_LARGEST_PANEL = 800
_RED = (1.0, 0.25, 0.2)
# Brightness of red where nothing is known, so that it is seen.
_LEAST_RED = 0.3


@dataclass(frozen=True)
class UncertaintyPanels:
    """What is known of the layers, of a size to look at.

    Attributes
    ----------
    errors : dict of str to ndarray
        Standard errors of transmission and reflection, (h, w) or (h, w, channel), linear; of large images pixels are
        left out.
    white : dict of str to float
        The error to show as white.
    known : ndarray, shape (h, w, 3)
        Known share of the reflection's detail, red below `faded`.
    faded : float
    typical : dict of str to float
        Root mean square of each error.
    faded_share : float
        Of the pixels.
    """

    errors: dict[str, Image]
    white: dict[str, float]
    known: Image
    faded: float
    typical: dict[str, float]
    faded_share: float


class UncertaintySummary:
    """What is shown and told of uncertainties that come a strip of rows at a time.

    Parameters
    ----------
    shape : tuple of int
        Of the layers, (2, [channel,] h, w).
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._step = -(-max(shape[-2:]) // _LARGEST_PANEL)
        self._errors: list[Image] = []
        self._known: list[Image] = []
        self._samples: list[Image] = []
        self._squares = np.zeros(2)
        self._faded = 0

    def add(self, strip: UncertaintyStrip) -> None:
        """Look at the next rows."""
        errors, known = strip.uncertainty.standard_error, strip.uncertainty.reflection_known
        shown = (..., slice(-strip.rows.start % self._step, None, self._step), slice(None, None, self._step))
        self._errors.append(errors[shown].copy())
        self._known.append(known[shown].copy())
        every = max(1, math.prod(self._shape[1:]) // _MOST_ERRORS)
        self._samples.append(errors.reshape(2, -1)[:, ::every].copy())
        self._squares += [np.square(error).sum(dtype=np.float64) for error in errors]
        self._faded += int(np.count_nonzero(known < FADED))

    def panels(self) -> UncertaintyPanels:
        """Panels of ``uncertainty.png``, after all rows."""
        errors, samples = np.concatenate(self._errors, axis=-2), np.concatenate(self._samples, axis=-1)
        white = np.maximum(np.quantile(samples, _WHITE_QUANTILE, axis=1), _LEAST_WHITE)
        typical = np.sqrt(self._squares / math.prod(self._shape[1:]))
        return UncertaintyPanels(
            errors=dict(zip(LAYERS, map(planes_last, errors), strict=True)),
            white=dict(zip(LAYERS, white.tolist(), strict=True)),
            known=_red_where_faded(np.concatenate(self._known)),
            faded=FADED,
            typical=dict(zip(LAYERS, typical.tolist(), strict=True)),
            faded_share=self._faded / math.prod(self._shape[-2:]),
        )


def _red_where_faded(known: Image) -> Image:
    """Grey where the reflection is known, red where it has faded, (h, w, 3)."""
    red = np.array(_RED, dtype=np.float32)
    return np.where((known < FADED)[..., None], (_LEAST_RED + known[..., None]) * red, known[..., None])
