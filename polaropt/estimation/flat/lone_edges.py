"""The incidence where all edges are mirrored ones: the pane hides a dark room, a blank wall or a clear sky.

How least edges of both layers overlap, and all else that compares two layers, then goes by noise. But what is mirrored
has one polarization, and shows it in every edge. It tells the incidence twice: on either side of Brewster's angle is a
pane that mirrors light of the same polarization. Before the flatter one all that is mirrored is darker, before the
steeper one hazier: it is as dark as it can be without less than no light. With a dark room behind it nothing but how
bright it is tells them apart.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.gradients import WINDOW, gradients_of, whitened_means
from polaropt.numerics import block_mean
from polaropt.optics import INCIDENCE_SEARCH_DEG, Rival, SceneParameters, in_place_weights

Values = NDArray[np.float64]

# What follows by trial, on panes of an engine of its own (training photographs, noise 0.2 to 1 %, seeds 2200 to 2904)
# before smooth, dark, blank and shaded pictures, and 144 before pictures with edges (seeds 2500 to 2511): of these an
# incidence is told once, rightly, before a dark night.
_SMOOTH_SHARE, _SMOOTH, _SMOOTH_OF_SHOWN = 0.015, 0.4, 0.0015
"""Power of the gradients across the direction of most, as a share of theirs, up to which they are of one layer; and in
units of a gradient's noise, or as a share of theirs where they are strong."""
_BY_NOISE = 0.6
"""What noise adds to that power in one window, two standard errors, in units of a gradient's noise."""
_SHOWN, _MIRRORED = 1.0, 1.3
"""Power of the gradients, in units of their noise, from which on edges show; ratio of what they show across the plane
of incidence to that along it from which on they are mirrored: glass that they pass shows less than 1."""
_LEAST_WINDOWS = 30
"""Windows without a clipped pixel that must be seen."""
_STEP_DEG, _LEAST_SLOPE = 0.05, 1e-6
"""Spacing of the incidences among which those are that mirror light of a polarization, and the least turn of that by a
degree (rad), by which is divided."""
_TRIALS_DEG = np.arange(*INCIDENCE_SEARCH_DEG, _STEP_DEG)
_LEAST_ERROR_DEG, _WORST_ERROR_DEG = 0.25, 2.0
"""Standard error that the scatter of windows does not tell, and up to which an incidence is told at all."""
_DARKEST, _DARK = 2.0, 0.2
"""Percentile of what is mirrored that is its darkest, and what that usually is at most, as a share of the mean."""
_USUAL = 0.3
"""Mean of what is mirrored that is usual (white = 1), give or take a factor e. Set by hand."""
_BY_GHOSTS = 2.5
"""How many times as likely the pane nearer the estimate's is where double images were found."""
_NEGATIVE, _HARDLY = 4.0, 1e-3
"""Standard errors by which the darkest must lie below black, and how likely a pane is of which it does."""


@dataclass(frozen=True)
class MirroredIncidence:
    """An incidence at which a pane mirrors light of the polarization that edges show.

    Attributes
    ----------
    incidence_deg, error_deg : float
        With its standard error.
    weight : float
        How likely it is beside others.
    """

    incidence_deg: float
    error_deg: float
    weight: float


def mirrored_incidences(frame: PlateFrame, scene: SceneParameters) -> list[MirroredIncidence]:
    """Incidences that mirrored edges tell, the likeliest first; none where both layers have edges, or hardly any show.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene : SceneParameters
        Complete, of one clear pane.
    """
    whitening, means, seen = whitened_means(frame, scene)
    moments = _moments_about_slopes(*gradients_of(means, seen))
    n = moments.shape[1]
    if n < _LEAST_WINDOWS:
        return []
    xx, xy, yy = moments.mean(axis=1) - (1, 0, 1)
    (left, shown), axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    smooth = min(_SMOOTH_SHARE * shown, max(_SMOOTH, _SMOOTH_OF_SHOWN * shown)) + _BY_NOISE / math.sqrt(n)
    if shown < _SHOWN or left > smooth:
        return []
    x, y = axes[:, 1]
    along, across = np.linalg.solve(whitening, axes[:, 1])
    along, across = (along, across) if across > 0 else (-along, -across)
    if across < _MIRRORED * along:
        return []
    scatter = (x * x - y * y) * moments[1] + x * y * (moments[2] - moments[0])
    error = math.hypot(float(scatter.std()) / math.sqrt(n), max(float(left), 0.0)) / float(shown)
    return _incidences(whitening, means, math.atan2(across, along), error, scene)


def _moments_about_slopes(x: NDArray[np.float32], y: NDArray[np.float32], known: NDArray[np.bool_]) -> Values:
    """Second moments (3, window) of two coordinates' gradients in small windows, about their means there.

    A slope that a whole window has, as light falls off over a wall, is no edge. Noise has moments 1, 0 and 1.
    """
    whole = block_mean(known.astype(np.float32), WINDOW) >= 1
    slopes = block_mean(x, WINDOW), block_mean(y, WINDOW)
    of_noise = 2 * (1 - 1 / WINDOW**3)

    def moment(one: int, other: int) -> Values:
        squares = block_mean(np.mean((x, y)[one] * (x, y)[other], axis=(0, 1)), WINDOW)
        about = squares - np.mean(slopes[one] * slopes[other], axis=(0, 1))
        return np.asarray(about[whole] / of_noise, dtype=np.float64)

    return np.stack([moment(0, 0), moment(0, 1), moment(1, 1)])


def _incidences(
    whitening: Values, means: NDArray[np.float32], shown: float, error: float, scene: SceneParameters
) -> list[MirroredIncidence]:
    """Those whose mirrored light points to an angle (rad) of what is across over what is along, the likeliest first.

    The error is one of the angle between coordinates, in which means have noise of unit variance. None where that is
    large.
    """
    cosine = np.cos(np.radians(_TRIALS_DEG))
    entries = np.stack(in_place_weights(cosine, scene.index, scene.single_surface))[:, :2]
    apart = np.arctan2(entries[1, 1], entries[1, 0]) - shown
    crossed = np.flatnonzero(np.diff(np.sign(apart)))
    # Noise may show more polarization than any pane mirrors.
    places = crossed if crossed.size else [int(np.argmin(np.abs(apart)))]
    coordinates = np.einsum("ij,kjn->kin", whitening, entries)
    turn = np.gradient(np.unwrap(np.arctan2(coordinates[1, 1], coordinates[1, 0])), _TRIALS_DEG)
    found = []
    for place in places:
        incidence, slope = float(_TRIALS_DEG[place]), abs(float(turn[place]))
        # Near Brewster's angle the error reaches to where polarization has turned by it.
        reach = np.cumsum(np.abs(turn[place:]) * _STEP_DEG) > error
        error_deg = _STEP_DEG * (int(np.argmax(reach)) if reach.any() else len(reach))
        unmixing = np.linalg.inv(coordinates[:, :, place].T)
        likely = _likely(unmixing @ means.reshape(2, -1), np.sqrt(np.square(unmixing).sum(axis=1)))
        weight = likely / max(slope, _LEAST_SLOPE)
        found.append(MirroredIncidence(incidence, math.hypot(error_deg, _LEAST_ERROR_DEG), weight))
    found.sort(key=lambda one: -one.weight)
    return found if found[0].error_deg <= _WORST_ERROR_DEG else []


def _likely(layers: Values, noise: Values) -> float:
    """How likely block means of both layers (2, n) with noise (2,) are: by what is mirrored, its darkest and its mean.

    Before the wrong pane that is less than no light, or all of it is hazy.
    """
    least, mean = np.percentile(layers, _DARKEST, axis=1), float(layers[1].mean())
    if mean <= 0 or (least < -_NEGATIVE * noise).any():
        return _HARDLY
    hazy = max(0.0, float(least[1])) / (_DARK * mean)
    return max(_HARDLY, math.exp(-hazy - 0.5 * math.log(mean / _USUAL) ** 2))


def with_mirrored_edges(estimate: SceneEstimate, frame: PlateFrame) -> tuple[SceneEstimate, str]:
    """The estimate with the incidence that mirrored edges tell, and what is to be said of it; as it is where none does.

    The other pane that mirrors such light is a rival.
    """
    found = mirrored_incidences(frame, estimate.scene)
    if not found:
        return estimate, ""
    nearest = min(found, key=lambda one: abs(one.incidence_deg - estimate.scene.values()[0]))
    # How bright double images are had a say in the estimate.
    by_ghosts = _BY_GHOSTS if estimate.scene.has_ghosts else 1.0

    def weight(one: MirroredIncidence) -> float:
        return one.weight * (by_ghosts if one is nearest else 1.0)

    best, *others = sorted(found, key=weight, reverse=True)
    scene, all_weights = estimate.scene.replace(incidence_deg=best.incidence_deg), sum(map(weight, found))
    rivals = tuple(Rival(scene.replace(incidence_deg=one.incidence_deg), weight(one) / all_weights) for one in others)
    errors = dataclasses.replace(estimate.errors, incidence_deg=best.error_deg)
    remark = "All edges are mirrored ones: what is behind the glass shows none."
    if others:
        remark += f" A pane at {others[0].incidence_deg:.0f} degrees would mirror the same polarization."
    return dataclasses.replace(estimate, scene=scene, errors=errors, rivals=rivals), remark
