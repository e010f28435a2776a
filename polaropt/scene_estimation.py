"""Blind scene estimation: from a capture to incidence, azimuth and ghost shift.

The azimuth is the axis of the polarized light, and of the two such axes the one whose layers share fewer edges. Given
the azimuth, incidence (edge independence) and ghost shift (spectral likelihood) are found in turns until both rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.azimuth import PrincipalAxis, principal_axis
from polaropt.capture import Capture
from polaropt.edge_overlap import EdgeOverlap
from polaropt.ghost_shift import cross_spectra, misfit
from polaropt.noise import noise_level
from polaropt.plate_frame import PlateFrame, StokesImages, plate_frame, stokes_images
from polaropt.scene import SceneParameters, ghost_step

Curve = NDArray[np.float64]

INCIDENCE_GRID_DEG: Curve = np.arange(2.0, 89.0)
_POLARIZED_SNR = 10.0
_TURNS = 3
_SCALES = (4, 8, 16)


@dataclass(frozen=True)
class SceneEstimate:
    """A complete scene and the evidence it rests on.

    Attributes
    ----------
    scene : SceneParameters
        Complete: what was given stays, the rest is estimated.
    polarization_snr : float
        Polarized light found, in standard errors of what noise alone would leave.
    azimuth_error_deg : float
        Standard error of the azimuth.
    polarized : bool
        Whether there is polarization at all; without, incidence, azimuth and shift mean nothing.
    axis_margin : float
        How much less the edges overlap for this azimuth than for the one across it, 0..1.
    incidence_margin : float
        Depth of the overlap's minimum below its typical value, 0..1.
    incidence_grid_deg, overlap : ndarray
        Edge overlap of the layers over trial incidences.
    shift_grid, shift_misfit : ndarray
        Minus log likelihood over trial ghost shifts, less its minimum (empty where no shift was searched).
    """

    scene: SceneParameters
    polarization_snr: float
    azimuth_error_deg: float
    polarized: bool
    axis_margin: float
    incidence_margin: float
    incidence_grid_deg: Curve
    overlap: Curve
    shift_grid: Curve
    shift_misfit: Curve


@dataclass(frozen=True)
class _Thickness:
    pixels: float
    kind: Literal["paper", "plate"]


def estimate_scene(
    capture: Capture,
    scene: SceneParameters = SceneParameters(None, None, None),  # noqa: B008 (frozen)
    *,
    noise: float | None = None,
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
) -> SceneEstimate:
    """Estimate what a scene leaves open.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        Fields that are None are estimated, all others stay as they are.
    noise : float, optional
        Standard deviation of the noise of one photograph. Default: measured.
    thickness_px : float, optional
        Thickness of the pane in pixels; ties the ghost shift to the incidence (its sense stays open).
    thickness_kind : {"paper", "plate"}
        Formula of the ghost step, see `ghost_step`.

    Returns
    -------
    SceneEstimate
    """
    stokes = stokes_images(capture, noise_level(capture) if noise is None else noise)
    axis = principal_axis(stokes.images[1:], stokes.covariance[1:, 1:])
    thickness = None if thickness_px is None else _Thickness(thickness_px, thickness_kind)
    frame, margin = _choose_axis(stokes, axis, scene)
    found, overlap, grid, likelihood = _alternate(frame, scene.replace(azimuth_deg=frame.azimuth_deg), thickness)
    return SceneEstimate(
        scene=found,
        polarization_snr=axis.snr,
        azimuth_error_deg=axis.error_deg,
        polarized=axis.snr > _POLARIZED_SNR,
        axis_margin=margin,
        incidence_margin=float(1 - overlap.min() / max(float(np.median(overlap)), 1e-9)),
        incidence_grid_deg=INCIDENCE_GRID_DEG,
        overlap=overlap,
        shift_grid=grid,
        shift_misfit=likelihood,
    )


def _choose_axis(stokes: StokesImages, axis: PrincipalAxis, scene: SceneParameters) -> tuple[PlateFrame, float]:
    """Frame at the given azimuth, or at that one of two axes where the layers' edges overlap less."""
    if scene.azimuth_deg is not None:
        return plate_frame(stokes, scene.azimuth_deg), 1.0
    frames = [plate_frame(stokes, axis.azimuth_deg + turn) for turn in (0.0, 90.0)]
    least = []
    for frame in frames:
        curve = _overlap_curve(EdgeOverlap(frame, scene, 0.0, _SCALES), scene)
        least.append(float(curve.min()))
    best = int(np.argmin(least))
    return frames[best], float(1 - least[best] / max(least[1 - best], 1e-9))


def _overlap_curve(overlap: EdgeOverlap, scene: SceneParameters) -> Curve:
    """Overlap at all trial incidences (all alike where the incidence is given)."""
    if scene.incidence_deg is not None:
        return np.full(INCIDENCE_GRID_DEG.size, _joint(overlap, scene.incidence_deg))
    return np.array([_joint(overlap, float(incidence)) for incidence in INCIDENCE_GRID_DEG])


def _joint(overlap: EdgeOverlap, incidence_deg: float) -> float:
    """Overlap over all scales: the geometric mean."""
    return math.exp(float(np.mean([math.log(max(part.value, 1e-6)) for part in overlap.at(incidence_deg)])))


def _alternate(
    frame: PlateFrame, scene: SceneParameters, thickness: _Thickness | None
) -> tuple[SceneParameters, Curve, Curve, Curve]:
    """Incidence and ghost shift in turns."""
    shift = 0.0 if scene.ghost_shift is None or scene.single_surface else scene.ghost_shift
    incidence = scene.incidence_deg
    search_shift = scene.ghost_shift is None and not scene.single_surface
    spectra = cross_spectra(frame) if search_shift else None
    grid = likelihood = np.zeros(0)
    for _ in range(_TURNS if search_shift and scene.incidence_deg is None else 1 + search_shift):
        overlap = EdgeOverlap(frame, scene, shift, _SCALES)
        curve = _overlap_curve(overlap, scene)
        if scene.incidence_deg is None:
            incidence = _refined_incidence(overlap, curve)
        if spectra is None or incidence is None:
            break
        trial = scene.replace(incidence_deg=incidence)
        grid = _shift_grid(frame, incidence, scene, thickness)
        likelihood = misfit(spectra, trial, grid)
        before, shift = shift, float(grid[np.argmin(likelihood)])
        if thickness is None:
            shift = _refined_shift(lambda d, trial=trial: float(misfit(spectra, trial, [d])[0]), shift)
        if abs(shift - before) < 0.05:
            break
    found = scene.replace(incidence_deg=incidence, ghost_shift=shift)
    return found, curve, grid, likelihood - likelihood.min(initial=np.inf) if likelihood.size else likelihood


def _shift_grid(
    frame: PlateFrame, incidence_deg: float, scene: SceneParameters, thickness: _Thickness | None
) -> Curve:
    if thickness is not None:
        step = ghost_step(incidence_deg, scene.refractive_index, thickness.pixels, thickness.kind)
        return np.array([step, -step])
    most = min(24.0, min(frame.images.shape[-2:]) / 6)
    return np.arange(-math.floor(most / 0.25), math.floor(most / 0.25) + 1) * 0.25


def _refined_incidence(overlap: EdgeOverlap, curve: Curve) -> float:
    best = float(INCIDENCE_GRID_DEG[np.argmin(curve)])
    return _local_search(lambda x: _joint(overlap, x), best, 1.0, 1.0, 88.5)


def _refined_shift(value: Callable[[float], float], best: float) -> float:
    return _local_search(value, best, 0.2, best - 0.3, best + 0.3)


def _local_search(value: Callable[[float], float], start: float, step: float, lower: float, upper: float) -> float:
    """Minimum of a function of one variable near a grid point."""
    import nlopt

    search = nlopt.opt(nlopt.LN_SBPLX, 1)
    search.set_min_objective(lambda x, _gradient: float(value(float(x[0]))))
    search.set_lower_bounds([lower])
    search.set_upper_bounds([upper])
    search.set_initial_step([step])
    search.set_xtol_abs([1e-2])
    search.set_maxeval(30)
    return float(search.optimize([min(max(start, lower), upper)])[0])
