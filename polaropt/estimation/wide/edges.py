"""How the edges of the layers tell what the direction of polarization leaves open of a pane that varies over the frame.

Each block of pixels is inverted linearly with its own incidence and azimuth; gradients are shrunk by their standard
errors, as in `polaropt.estimation.flat.overlap`. The overlap is normalized in each part of the frame: a trial pane that
makes one part's layers brighter must not make it count for more. With one normalization for all the incidence is
1.4 degrees too high before a lens of 45 degrees of view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.flat.errors import widened_incidence
from polaropt.estimation.flat.overlap import FAINT_OVERLAP, MOSTLY_VALID, PARTS, SHRINK
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.estimation.wide.pane import AZIMUTH, BEND, INCIDENCE, N_NUMBERS, VIEW, PaneFit, Prior, fitted, with_errors
from polaropt.numerics import grid_sums, left_out, local_minimum, minimum_error, vertex
from polaropt.optics import Pane, SceneParameters, in_place_weights, pixel_grid, plane_normal, scene_pane

Images = NDArray[np.float32]

Values = NDArray[np.float64]

# Side in pixels of the finest blocks, at least, and how many of them lie along the longer side, at most; how many
# scales there are, each twice as coarse; blocks along the shorter side of the coarsest, at least. All set by hand.
_FINEST, _MOST_BLOCKS, _SCALES, _LEAST_BLOCKS = 2, 128, 3, 8
# Least cosine of the incidence in a block (88.9 degrees): a trial pane may be seen from behind there. Set by hand.
_LEAST_COSINE = 0.02
# Difference of the pane's two reflectances that is divided by, at least; at 0.5 degrees it is 1.5e-5. Set by hand.
_LEAST_DIFFERENCE = 1e-9


@dataclass(frozen=True)
class _Scale:
    """Block means (3, channel, h, w), where gradients count (h - 1, w - 1), and the blocks' places in pixels."""

    means: Images
    weight: Images
    x: Values
    y: Values
    size: int


class VaryingOverlap:
    """Edge overlap of a capture's layers for any pane that varies over the frame.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        Index and surfaces of the pane; its geometry is not used.
    """

    def __init__(self, stokes: StokesImages, scene: SceneParameters) -> None:
        self._covariance, self.scene = stokes.covariance, scene
        side = max(stokes.images.shape[-2:])
        size = max(_FINEST, 2 ** math.ceil(math.log2(side / _MOST_BLOCKS)))
        self._scales = []
        for _ in range(_SCALES):
            if min(stokes.images.shape[-2:]) // size < _LEAST_BLOCKS:
                break
            self._scales.append(_scale(stokes, size))
            size *= 2

    def log(self, pane: Pane) -> Values:
        """Log overlap of each part of the frame (part,), mean over the scales; 0 where nothing is told."""
        return np.asarray(np.mean([self._log_overlap(scale, pane) for scale in self._scales], axis=0))

    @property
    def usable(self) -> bool:
        """Whether the frame is large enough."""
        return bool(self._scales)

    def _log_overlap(self, scale: _Scale, pane: Pane) -> Values:
        cosine, cos, sin = pane.angles(scale.x, scale.y)
        scene = self.scene
        weights = in_place_weights(np.maximum(cosine, _LEAST_COSINE), scene.index, *scene.sheets)
        energies = [
            _beyond_noise(scale, factor, (cos, sin), self._covariance)
            for factor in _factors(weights[1][0], weights[1][1])
        ]
        transmission, reflection = (scale.weight * energy for energy in energies)
        maps = np.stack([np.sqrt(reflection * transmission), reflection, transmission, scale.weight])
        both, reflections, transmissions, n_blocks = grid_sums(maps, PARTS)
        pseudo = FAINT_OVERLAP * np.maximum(n_blocks, 1)
        return np.asarray(np.log((both + pseudo) / (np.sqrt(reflections * transmissions) + pseudo)))


def _scale(stokes: StokesImages, size: int) -> _Scale:
    height, width = stokes.images.shape[-2:]
    means = stokes.means(size)
    good = stokes.shares(size).min(axis=0) >= MOSTLY_VALID
    weight = good[:-1, :-1] & good[:-1, 1:] & good[1:, :-1]
    rows, columns = means.shape[-2:]
    x, y = pixel_grid(rows, columns, ((width - size) / 2 / size, (height - size) / 2 / size))
    return _Scale(means, weight.astype(np.float32), size * x, size * y, size)


def _factors(par: Values, perp: Values) -> tuple[Values, Values]:
    """What s1' adds to s0 to make transmission and reflection, from the pane's two reflectances."""
    # Next to normal incidence nothing is told; the noise then drowns all.
    difference = np.minimum(par - perp, -_LEAST_DIFFERENCE)
    return -(par + perp) / difference, (2 - par - perp) / difference


def _beyond_noise(scale: _Scale, factor: Values, turn: tuple[Values, Values], covariance: Values) -> Values:
    """Squared gradients of one layer in units of their noise, shrunk by it, over colours and directions."""
    f = factor.astype(np.float32)
    with_s1, with_s2 = f * turn[0].astype(np.float32), f * turn[1].astype(np.float32)
    layer = scale.means[0] + with_s1 * scale.means[1] + with_s2 * scale.means[2]
    mixing = np.stack([np.ones_like(f), with_s1, with_s2])
    variance = np.einsum("ihw,ij,jhw->hw", mixing, covariance.astype(np.float32), mixing) * (2 / scale.size**2)
    error = np.sqrt(variance[:-1, :-1])
    energy = np.zeros(error.shape, np.float64)
    corner = layer[:, :-1, :-1]
    for moved in (layer[:, :-1, 1:], layer[:, 1:, :-1]):
        beyond = np.maximum(np.abs(moved - corner) / error - np.float32(SHRINK), 0)
        energy += np.einsum("chw,chw->hw", beyond, beyond)
    return energy


MIDDLE_BLOCKS = 24
"""Blocks along the longer side that panes are fitted to while edges are looked at. Set by hand."""
# The edges are asked along directions in which the pane is known worse than this (rad), so many at most. Set by hand.
_OPEN, _MOST_DIRECTIONS = math.radians(1.5), 2
# Factor on a later answer's error. How a pane bends shows in few edges, at the frame's ends: twice as far off as parts
# left out tell, on 32 scenes.
_LATER_WIDER = 2.0
# Search along a direction (rad): first step, accuracy and how far it goes either way. Set by hand.
_STEP, _TOLERANCE, _REACH = math.radians(4), math.radians(0.3), math.radians(25)
# Steps to either side at which layers are asked for light, where a pane would leave them less than none. Set by hand.
_FARTHEST_LIT = 15
# Distance (rad) at which the overlap's curvature is taken. Set by hand.
_JACKKNIFE_STEP = math.radians(1.5)
_AROUND = (-_JACKKNIFE_STEP, 0.0, _JACKKNIFE_STEP)
MOST_NEGATIVE = 0.02
"""Share of the frame where layers may come out with less than no light: of 60 random windows to fit on, before wide
lenses and bent (`studies.random_windows`, even seeds to 942), panes that were found within 3 dB of the scene known
leave up to 0.4 %, and two that were 22 and 24 dB worse 17 and 41 %."""
# Error (rad) of a value that is given: far below any that is told. Set by hand.
_EXACTLY = 1e-4


@dataclass(frozen=True)
class Candidate:
    """A pane, the numbers that are fitted, what else is known of them and directions (6,) that edges told."""

    blocks: PolarizedBlocks
    prior: Prior
    free: tuple[int, ...]
    fit: PaneFit
    directions: tuple[Values, ...] = ()

    def with_measurement(self, direction: Values, value: float, error: float) -> Candidate:
        """The pane with one more measurement."""
        known = candidate_near(
            self.blocks, self.prior.with_measurement(direction, value, error), self.free, self.fit.point
        )
        return replace(known, directions=(*self.directions, direction))

    def worst_known(self) -> tuple[Values, float]:
        """The direction in which the pane is known worst, across those that edges told, and the error there."""
        across = np.eye(N_NUMBERS)
        if self.directions:
            axes = np.linalg.qr(np.stack(self.directions, axis=1))[0]
            across = across - axes @ axes.T
        variances, directions = np.linalg.eigh(across @ self.fit.covariance @ across)
        return directions[:, -1], math.sqrt(max(float(variances[-1]), 0.0))

    def given(self, direction: Values, value: float, blocks: PolarizedBlocks) -> Values:
        """The likeliest point that has a value along a direction."""
        start = self.fit.point + direction * (value - direction @ self.fit.point)
        return fitted(blocks, start, self.free, self.prior.with_measurement(direction, value, _EXACTLY))


def candidate_near(blocks: PolarizedBlocks, prior: Prior, free: tuple[int, ...], start: Values) -> Candidate:
    point = fitted(blocks, start, free, prior)
    return Candidate(blocks, prior, free, with_errors(blocks, point, free, prior))


class PaneEdges:
    """Edge overlap of the layers along the panes that the directions of polarization leave open."""

    def __init__(self, overlap: VaryingOverlap, blocks: PolarizedBlocks) -> None:
        self._overlap, self._blocks = overlap, blocks

    def log_overlap(self, candidate: Candidate) -> float:
        """Of the layers that a pane leaves."""
        return float(self._overlap.log(pane_at(candidate.fit.point, self._blocks)).mean())

    def completed(self, candidate: Candidate) -> Candidate:
        """The pane with what the edges tell along directions in which it is known badly."""
        while len(candidate.directions) < _MOST_DIRECTIONS and candidate.worst_known()[1] > _OPEN:
            candidate = self.with_worst_direction(candidate)
        return candidate

    def with_worst_direction(self, candidate: Candidate) -> Candidate:
        """The pane with what the edges tell along the direction in which it is known worst."""
        direction, _ = candidate.worst_known()
        value, error = self.minimum_along(candidate, direction)
        return candidate.with_measurement(direction, value, _LATER_WIDER * error if candidate.directions else error)

    def minimum_along(self, candidate: Candidate, direction: Values) -> tuple[float, float]:
        """Where along a direction the edges overlap least, and its standard error."""

        @cache
        def logs(value: float) -> Values:
            return self._overlap.log(self._pane_given(candidate, direction, value))

        def cost(value: float) -> float:
            return float(logs(value).mean())

        begin = self._lit_near(candidate, direction)
        before, here, after = (cost(begin + shift) for shift in _AROUND)
        if min(before, after) > here:
            middle, found = begin, begin + _JACKKNIFE_STEP * vertex(before, here, after)
        else:
            bounds = (begin - _REACH, begin + _REACH)
            middle = found = local_minimum(cost, begin, bounds, _STEP, _TOLERANCE)
        error = minimum_error([left_out(logs(middle + shift)) for shift in _AROUND], _JACKKNIFE_STEP)
        return found, math.radians(widened_incidence(math.degrees(error)))

    def _lit_near(self, candidate: Candidate, direction: Values) -> float:
        """Where along a direction, nearest to a pane, its layers have light all over the frame; else where it is."""
        here = float(direction @ candidate.fit.point)
        for step in sorted(range(-_FARTHEST_LIT, _FARTHEST_LIT + 1), key=abs):
            value = here + step * _STEP
            pane = self._pane_given(candidate, direction, value)
            if negative_light(self._blocks, self._overlap.scene, pane) <= MOST_NEGATIVE:
                return value
        return here

    def _pane_given(self, candidate: Candidate, direction: Values, value: float) -> Pane:
        """The likeliest pane that has a value along a direction."""
        return pane_at(candidate.given(direction, value, self._blocks), self._blocks)


def pane_at(point: Values, blocks: PolarizedBlocks) -> Pane:
    """The pane of a point, in pixels."""
    incidence_deg, azimuth_deg, focal, bend = named(point, blocks)
    return Pane(plane_normal(incidence_deg, azimuth_deg), bend, 1 / focal)


def negative_light(blocks: PolarizedBlocks, scene: SceneParameters, pane: Pane | None = None) -> float:
    """Share of the blocks where a layer would have clearly less than no light, all ghosts in place.

    Parameters
    ----------
    blocks : PolarizedBlocks
    scene : SceneParameters
    pane : Pane, optional
        In the place of the scene's own, whose index and surfaces count.
    """
    pane = scene_pane(scene) if pane is None else pane
    cosine, cos, sin = (np.broadcast_to(part, blocks.places.shape[1:]) for part in pane.angles(*blocks.at_px))
    _, (par, perp, _) = in_place_weights(np.maximum(cosine, _LEAST_COSINE), scene.index, *scene.sheets)
    return blocks.negative(np.stack([[np.ones_like(f), f * cos, f * sin] for f in _factors(par, perp)]))


def named(point: Values, blocks: PolarizedBlocks) -> tuple[float, float, float, tuple[float, ...]]:
    """Incidence and azimuth in degrees, focal length in pixels (or infinite), bend in radians per pixel of a point."""
    incidence_deg, azimuth_deg = np.degrees(point[[INCIDENCE, AZIMUTH]])
    focal = blocks.half_px / float(point[VIEW]) if point[VIEW] else math.inf
    bend = tuple(float(part) / blocks.half_px for part in point[list(BEND)])
    return float(incidence_deg), float(azimuth_deg), focal, bend
