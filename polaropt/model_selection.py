"""Which rung of the ladder a capture needs: the lowest one that leaves no polarized light unexplained.

Unpolarized layers behind a flat pane that is seen from far leave no light polarized at 45 degrees to its plane of
incidence. What there is of it beyond the noise says that a higher rung is needed, and whether one explains it.
"""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import Literal

from polaropt.capture import Capture
from polaropt.perspective_fit import PerspectiveFit, PolarizedBlocks, fit_perspective
from polaropt.plate_frame import stokes_images
from polaropt.scene import SceneParameters
from polaropt.scene_estimation import SceneEstimate, estimate_scene

Model = Literal["auto", "pixelwise", "ghosts", "perspective"]

# Mean square, in units of the noise, up to which polarized light counts as explained, beside its own scatter.
_TOLERANCE = 0.1
_SCATTERS = 3.0
# Share of what the lower rung leaves that a higher one must explain, and how well it must be known.
_LEAST_EXPLAINED = 0.5
_WORST_ERROR_DEG = 3.0
# Ghosts closer than this fall onto each other.
_LEAST_SHIFT_PX = 0.5
# Focal length over the longer side from which on incidence and azimuth hardly vary.
_FAR = 30.0


@dataclass(frozen=True)
class Tried:
    """One rung that was looked at.

    Attributes
    ----------
    rung : str
    misfit : float or None
        Mean square of the light polarized at 45 degrees to the plane of incidence, in units of its noise; None where
        it was not measured.
    seconds : float
    taken : bool
    reason : str
        Why it was taken or left, a sentence.
    """

    rung: str
    misfit: float | None
    seconds: float
    taken: bool
    reason: str


@dataclass(frozen=True)
class FoundScene:
    """A complete scene, how it was estimated (None where it was given) and the rungs that were looked at."""

    scene: SceneParameters
    estimate: SceneEstimate | None
    tried: tuple[Tried, ...]

    @property
    def unexplained(self) -> float:
        """Polarized light that the rung taken leaves, in units of its noise: 1 where it explains all."""
        left = [tried.misfit for tried in self.tried if tried.taken and tried.misfit is not None]
        return left[0] if left else 1.0


def model_names() -> tuple[str, ...]:
    """Names that `find_scene` knows."""
    return ("auto", "pixelwise", "ghosts", "perspective")


def find_scene(
    capture: Capture,
    asked: SceneParameters,
    noise: float,
    model: str = "auto",
    *,
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
) -> FoundScene:
    """Complete a scene on the lowest rung that explains the capture, or on the one asked for.

    Parameters
    ----------
    capture : Capture
    asked : SceneParameters
        Fields that are None are estimated. A focal length asks for the perspective rung.
    noise : float
    model : {"auto", "pixelwise", "ghosts", "perspective"}
    thickness_px, thickness_kind
        As for `estimate_scene`.
    """
    if asked.complete and thickness_px is None:
        return FoundScene(asked, None, ())
    began = time.perf_counter()
    flat = asked.replace(focal_px=None)
    if model in ("pixelwise", "perspective") and asked.ghost_shift is None:
        flat = flat.replace(ghost_shift=0.0)
    estimate = estimate_scene(capture, flat, noise=noise, thickness_px=thickness_px, thickness_kind=thickness_kind)
    if model == "auto" and asked.ghost_shift is None and thickness_px is None:
        estimate = _without_a_trifle(estimate)
    blocks_began = time.perf_counter()
    if not estimate.polarized and asked.incidence_deg is None:
        return _nothing_seen(estimate, blocks_began - began)
    lower = _Lower(estimate, blocks_began - began)
    stokes = stokes_images(capture, noise)
    blocks = PolarizedBlocks(stokes)
    misfit = blocks.constant_misfit(estimate.scene.values()[1])
    if not _may_vary(asked, model):
        return FoundScene(estimate.scene, estimate, (lower.tried(misfit, True, "It is the one asked for."),))
    wanted = model == "perspective" or asked.focal_px is not None
    if not wanted and misfit <= 1 + _TOLERANCE + _SCATTERS * math.sqrt(2 / blocks.n):
        return FoundScene(estimate.scene, estimate, (lower.tried(misfit, True, "It leaves nothing but noise."),))
    fit = fit_perspective(stokes, asked.focal_px)
    found = _decided(lower, misfit, fit, wanted, time.perf_counter() - blocks_began)
    if not wanted or found.scene.focal_px is not None:
        return found
    return _as_from_afar(found, blocks, asked.focal_px or _FAR * max(capture.shape[-2:]))


def _nothing_seen(estimate: SceneEstimate, seconds: float) -> FoundScene:
    scene = estimate.scene.replace(signal=False)
    tried = Tried("none", None, seconds, True, "There is no polarization beyond the noise.")
    return FoundScene(scene, dataclasses.replace(estimate, scene=scene), (tried,))


def _without_a_trifle(estimate: SceneEstimate) -> SceneEstimate:
    """The estimate with a ghost shift that cannot be told from none taken as none: the lower rung does."""
    shift = estimate.scene.values()[2]
    if abs(shift) >= _LEAST_SHIFT_PX:
        return estimate
    return dataclasses.replace(estimate, scene=estimate.scene.replace(ghost_shift=0.0))


@dataclass(frozen=True)
class _Lower:
    """The estimate on the lower rungs, and its seconds."""

    estimate: SceneEstimate
    seconds: float

    def tried(self, misfit: float | None, taken: bool, reason: str) -> Tried:
        return Tried(self.estimate.scene.rung, misfit, self.seconds, taken, reason)


def _may_vary(asked: SceneParameters, model: str) -> bool:
    """Whether incidence and azimuth over the frame are for us to find."""
    free = asked.incidence_deg is None and asked.azimuth_deg is None
    return free and model in ("auto", "perspective") and not asked.ghost_shift


def _decided(lower: _Lower, misfit: float, fit: PerspectiveFit, wanted: bool, seconds: float) -> FoundScene:
    explained = (misfit - fit.misfit) / max(misfit - 1, 1e-9)
    shows = misfit - fit.misfit > _SCATTERS * math.sqrt(2 / fit.n)
    known = shows and fit.incidence_error_deg <= _WORST_ERROR_DEG
    taken = known and explained >= (-math.inf if wanted else _LEAST_EXPLAINED)
    share = f"{100 * explained:.0f} % of the polarized light that the {lower.estimate.scene.rung} rung leaves"
    if not known:
        reason = "The polarized light does not tell how incidence and azimuth change over the picture."
    elif taken:
        reason = f"It was asked for; it explains {share}." if wanted else f"It explains {share}."
    else:
        reason = f"It explains only {share}."
    left = "It leaves polarized light unexplained." if taken else "No higher rung explains what it leaves."
    tried = (
        lower.tried(misfit, not taken, left),
        Tried("perspective", fit.misfit, seconds, taken, reason),
    )
    if not taken:
        return FoundScene(lower.estimate.scene, lower.estimate, tried)
    scene = lower.estimate.scene.replace(
        incidence_deg=fit.incidence_deg, azimuth_deg=fit.azimuth_deg, ghost_shift=0.0, focal_px=fit.focal_px
    )
    return FoundScene(scene, dataclasses.replace(lower.estimate, scene=scene), tried)


def _as_from_afar(found: FoundScene, blocks: PolarizedBlocks, focal_px: float) -> FoundScene:
    """The perspective rung where polarized light does not tell the tilt: the lower rung's pane, seen by the lens."""
    incidence, azimuth, _ = found.scene.values()
    ways = (azimuth % 360, (azimuth + 180) % 360)
    leaning = min(ways, key=lambda way: blocks.misfit(incidence, way, focal_px))
    scene = found.scene.replace(azimuth_deg=leaning, ghost_shift=0.0, focal_px=focal_px)
    misfit = blocks.misfit(incidence, leaning, focal_px)
    asked = Tried(
        "perspective", misfit, 0.0, True, "It was asked for; incidence and azimuth are those of the lower rung."
    )
    tried = tuple(dataclasses.replace(rung, taken=False) for rung in found.tried)
    estimate = None if found.estimate is None else dataclasses.replace(found.estimate, scene=scene)
    return FoundScene(scene, estimate, (*tried, asked))
