"""What is compared in the stability study: polaropt on every rung, doing nothing, and independent components."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.estimation import model_names
from polaropt.separation import separate
from studies.protocol import EVALUATION_BORDER, Pair
from studies.stability_capture import Taken, take
from studies.stability_scenes import Case

Images = NDArray[np.float32]

NOTHING, MINIMUM, COMPONENTS = "s0", "minimum", "FastICA"
BASELINES = (NOTHING, MINIMUM, COMPONENTS)
_DETAIL_PX = 2.0
_LEAST = 1e-9


@dataclass(frozen=True)
class Row:
    """One separation.

    Attributes
    ----------
    family, case, value, second, pair
        The scene, see `studies.stability_scenes.Case`; the pair's number.
    method : str
    transmission, reflection : float
        PSNR in dB over pixels that no photograph clips, 16 px at the border left out.
    detail : float
        Correlation of the reflection's detail (finer than about 5 px) with the true one.
    rung : str
        That was taken; empty for the baselines.
    incidence_deg : float or None
        That was found.
    misfit : float or None
        Mean squared residual in units of the noise.
    seconds : float
    warnings : tuple of str
    """

    family: str
    case: str
    value: float
    second: float
    pair: int
    method: str
    transmission: float
    reflection: float
    detail: float
    rung: str
    incidence_deg: float | None
    misfit: float | None
    seconds: float
    warnings: tuple[str, ...]


def methods() -> tuple[str, ...]:
    """Names of all methods: polaropt's models first, "auto" at their head; its model "none" is doing nothing."""
    return (*(name for name in model_names() if name != "none"), *BASELINES)


def rows_of(case: Case, pair: Pair, wanted: Sequence[str]) -> list[Row]:
    """Separate one scene in every way that is wanted."""
    taken = take(case, pair)
    return [_row(case, pair, method, taken) for method in wanted]


def _row(case: Case, pair: Pair, method: str, taken: Taken) -> Row:
    began = time.perf_counter()
    rung, incidence, misfit, told = "", None, None, ()
    if method in BASELINES:
        layers = baseline(method, taken.capture, taken.layers)
    else:
        result = separate(taken.capture, taken.told, model=method)
        layers, rung = result.layers, result.scene.rung
        incidence, misfit = result.scene.incidence_deg, result.diagnostics.misfit_ratio
        told = tuple(warning.name for warning in result.diagnostics.warnings)
    seconds = time.perf_counter() - began
    seen = np.asarray(taken.capture.valid.all(axis=(0, 1)))
    quality = [_psnr(layers[i], taken.layers[i], seen) for i in (0, 1)]
    detail = _detail_correlation(layers[1], taken.layers[1], seen)
    return Row(
        case.family, case.name, case.value, case.second, pair.number, method, *quality, detail, rung, incidence,
        misfit, seconds, told,
    )  # fmt: skip


def baseline(method: str, capture: Capture, truth: Images) -> Images:
    """Layers (2, channel, h, w) of a method that knows no pane.

    "s0" takes the intensity as transmission and shows no reflection. "minimum" takes twice the darkest that any
    polarizer angle would show, and what is brighter as reflection. "FastICA" finds two independent components of the
    photographs, all colours together; as these know neither their order nor sign, scale and offset, all four are taken
    from the true layers, which is more than any method could know.
    """
    s0, s1, s2 = capture.stokes
    polarized = np.hypot(s1, s2)
    if method == NOTHING:
        return np.stack([s0, np.zeros_like(s0)])
    if method == MINIMUM:
        return np.stack([s0 - polarized, 2 * polarized])
    return _independent_components(capture, truth)


def _independent_components(capture: Capture, truth: Images) -> Images:
    from sklearn.decomposition import FastICA

    samples = capture.intensities.reshape(len(capture.angles_deg), -1).T.astype(np.float64)
    with warnings.catch_warnings():
        # Where it does not converge its last step is what it has to say.
        warnings.simplefilter("ignore")
        found = FastICA(2, whiten="unit-variance", random_state=0, max_iter=200).fit_transform(samples)
    components = np.asarray(found.T, dtype=np.float32).reshape(2, *capture.shape)
    fits = [np.stack([_fitted(part, layer) for layer, part in zip(truth, order, strict=True)])
            for order in (components, components[::-1])]  # fmt: skip
    return min(fits, key=lambda layers: float(np.square(layers - truth).mean()))


def _fitted(component: Images, layer: Images) -> Images:
    slope, offset = np.polyfit(component.ravel(), layer.ravel(), 1)
    return np.asarray(slope * component + offset, dtype=np.float32)


def _psnr(image: Images, reference: Images, seen: NDArray[np.bool_]) -> float:
    inner = (..., slice(EVALUATION_BORDER, -EVALUATION_BORDER), slice(EVALUATION_BORDER, -EVALUATION_BORDER))
    errors = np.square(image.astype(np.float64) - reference)[inner][..., seen[inner]]
    return float(-10 * np.log10(max(float(errors.mean()), _LEAST))) if errors.size else 0.0


def _detail_correlation(image: Images, reference: Images, seen: NDArray[np.bool_]) -> float:
    """Correlation of what is finer than a few pixels; 0 where there is none."""
    from scipy.ndimage import gaussian_filter

    inner = (..., slice(EVALUATION_BORDER, -EVALUATION_BORDER), slice(EVALUATION_BORDER, -EVALUATION_BORDER))
    fine = [part - gaussian_filter(part, (0, _DETAIL_PX, _DETAIL_PX)) for part in (image, reference)]
    first, second = (part[inner][..., seen[inner]].ravel().astype(np.float64) for part in fine)
    energy = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / energy if energy > _LEAST else 0.0
