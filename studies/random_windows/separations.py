"""One random scene, separated blind and with the scene known: its row."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics import turn_between
from polaropt.optics import SceneErrors
from polaropt.separation import Separation
from studies.camera import Sample
from studies.parameter_errors import compared
from studies.random_windows.windows import Window, window_of
from studies.scenes import Sensor
from studies.scores import BORDER_PX, both_psnr, detail_correlation, psnr
from studies.ways import DEFAULT, WITH_SCENE, minimum_over_angles, plain_intensity

Images = NDArray[np.float32]

_LARGEST_ERROR = 1e6
"""Of a number that is not told at all; JSON knows no infinity."""
_INNER = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))


@dataclass(frozen=True)
class Job:
    """One scene by its number.

    Attributes
    ----------
    number : int
    photos : str or None
        Folder of photographs; None: those inside scikit-image.
    size : int
        Side of the frame in pixels.
    sensor : {"", "mono", "color"}
        Of a polarization camera; "": four full photographs.
    shot_noise : bool
        Whether the noise grows with the light.
    """

    number: int
    photos: str | None
    size: int
    sensor: Sensor = ""
    shot_noise: bool = False

    @property
    def window(self) -> Window:
        """The scene."""
        return window_of(self.number, self.size, self.sensor, self.shot_noise)


@dataclass(frozen=True)
class Row:
    """One scene. PSNR is in dB, of the pixels that no photograph clips and nothing crosses.

    Attributes
    ----------
    number, family
        See `Window`.
    incidence_deg, shift_px, index, index_told, noise, bits, clipped, brightness : float
        Of the pane, and how it was photographed; the noise is that at white, the brightness the mirrored scene's.
    view_deg, bend_deg : float
        Field of view (0: from afar), and how far the normal turns at most from the middle to the end of the side.
    screen, sky : float
        Degrees of polarization.
    panes : int
    gap_px, tint : float
        Shift from pane to pane, and the share of light that all panes leave.
    gain_error, angle_error_deg, moving : float
        Largest error of a gain, error of the angles, side of what moves in sides of the frame.
    transmission, reflection, known_transmission, known_reflection : float
        Found blind, and with the scene known.
    intensity, minimum : float
        Of the plain intensity as transmission, and of twice the fitted minimum over all polarizer angles.
    detail, known_detail : float
        Correlation of the reflection's detail with the true one, found blind and with the scene known.
    made, rung : str
        Scene model that the scene was made with, and the one taken.
    panes_found : int
    found_incidence_deg : float
    turned_deg : float
        How far the azimuth found is off, modulo 180: near 90 the layers are exchanged.
    settled : float
        By how many noise levels the axis taken explains the photographs better than the one across.
    misfit, unexplained : float
        Mean squared residual, and of polarized light that the rung leaves, in units of the noise.
    chance : float
        That the transmission loses more than 3 dB for the errors of the scene, as these say.
    warnings : tuple of str
    parameters : tuple of str
        Numbers that were found with a standard error.
    away, stated : tuple of float
        How far each is from the truth, and its standard error.
    covered_transmission, covered_reflection : float
        Share of the pixels within two of the stated errors.
    width_transmission, width_reflection : float
        Root mean square of the stated errors in units of the true ones.
    seconds : float
    """

    number: int
    family: str
    incidence_deg: float
    shift_px: float
    index: float
    index_told: float
    noise: float
    bits: int
    clipped: float
    brightness: float
    view_deg: float
    bend_deg: float
    screen: float
    sky: float
    panes: int
    gap_px: float
    tint: float
    gain_error: float
    angle_error_deg: float
    moving: float
    transmission: float
    reflection: float
    known_transmission: float
    known_reflection: float
    intensity: float
    minimum: float
    detail: float
    known_detail: float
    made: str
    rung: str
    panes_found: int
    found_incidence_deg: float
    turned_deg: float
    settled: float | None
    misfit: float
    unexplained: float
    chance: float
    warnings: tuple[str, ...]
    parameters: tuple[str, ...]
    away: tuple[float, ...]
    stated: tuple[float, ...]
    covered_transmission: float
    covered_reflection: float
    width_transmission: float
    width_reflection: float
    seconds: float


def run(job: Job) -> list[Row]:
    """Separate one scene."""
    window = job.window
    sample = window.sample(job.photos, job.size)
    return [row_of(window, job.size, sample, DEFAULT.separation(sample), WITH_SCENE.separation(sample))]


def row_of(window: Window, size: int, sample: Sample, blind: Separation, known: Separation) -> Row:
    """What came out of a scene, blind and with the scene known."""
    seen, true = sample.unclipped, sample.layers
    # From afar there is no focal length that one could be held against.
    found_numbers = compared(window.scene, blind.scene, stated_errors(blind))
    numbers = [number for number in found_numbers if not math.isnan(number[1])]
    estimate = blind.diagnostics.estimate
    settled = None if estimate is None else estimate.axis_margin / blind.diagnostics.noise
    levels, known_levels = both_psnr(blind.layers, true, seen), both_psnr(known.layers, true, seen)
    covered = [_stated(blind, true, seen, i) for i in (0, 1)]
    found = blind.scene.values()
    return Row(
        *_of_window(window, size),
        *levels,
        *known_levels,
        psnr(plain_intensity(sample)[0], true[0], seen),
        psnr(minimum_over_angles(sample)[0], true[0], seen),
        *(detail_correlation(result.layers[1], true[1], seen) for result in (blind, known)),
        window.rung,
        blind.scene.rung,
        blind.scene.n_panes or 1,
        found[0],
        abs(turn_between(found[1], window.scene.values()[1])),
        None if settled is None or math.isinf(settled) else settled,
        blind.diagnostics.misfit_ratio,
        _unexplained(blind),
        0.0 if blind.diagnostics.loss is None else blind.diagnostics.loss.chance,
        tuple(warning.name for warning in blind.diagnostics.warnings),
        tuple(name.replace(", ", ".") for name, *_ in numbers),
        tuple(float(abs(value - truth)) for _, truth, value, _ in numbers),
        tuple(min(float(error), _LARGEST_ERROR) for *_, error in numbers),
        covered[0][0],
        covered[1][0],
        covered[0][1],
        covered[1][1],
        sum(blind.seconds.values()),
    )


def _of_window(window: Window, size: int) -> tuple[int | float | str, ...]:
    """The columns of a row that tell the scene."""
    scene, taking = window.scene, window.taking
    incidence, _, shift = scene.values()
    view = 0.0 if scene.focal_px is None else 2 * math.degrees(math.atan(size / 2 / scene.focal_px))
    return (
        window.number, window.family, incidence, shift, scene.refractive_index, window.index_told,
        taking.noise_at_white, taking.bits, taking.clipped, taking.reflection_gain, view,
        max(map(abs, scene.bend_deg_per_px)) * size / 2,
        scene.transmission_polarization[0], scene.reflection_polarization[0], scene.n_panes or 1,
        scene.gap_shift or 0.0, scene.tint, max(abs(gain - 1) for gain in taking.gains), taking.angle_error_deg,
        taking.moving_side,
    )  # fmt: skip


def stated_errors(found: Separation) -> SceneErrors:
    """Errors of what was found; where no pane was taken there is nothing that they are of."""
    return found.errors if found.scene.signal else SceneErrors()


def _unexplained(found: Separation) -> float:
    left = [rung.misfit for rung in found.tried if rung.taken and rung.misfit is not None]
    return left[0] if left else 1.0


def _stated(found: Separation, true: Images, seen: NDArray[np.bool_], layer: int) -> tuple[float, float]:
    """Share of a layer's pixels within two stated errors, and how wide these are in units of the true ones."""
    inner = seen[_INNER]
    if not inner.any():
        return math.nan, math.nan
    stated = np.asarray(found.uncertainty[layer], dtype=np.float64)[_INNER][..., inner]
    error = np.abs(found.layers[layer].astype(np.float64) - true[layer])[_INNER][..., inner]
    width = math.sqrt(float(np.square(stated).mean()) / max(float(np.square(error).mean()), 1e-12))
    return float((error <= 2 * stated).mean()), width
