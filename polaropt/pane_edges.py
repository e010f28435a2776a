"""What the edges of the layers tell of a pane where the directions of polarization leave it open."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.jackknife import left_out, minimum_error
from polaropt.pane_program import AZIMUTH, BEND, INCIDENCE, N_NUMBERS, VIEW, PaneFit, Prior, fitted, with_errors
from polaropt.parabola import local_minimum, vertex
from polaropt.perspective import Pane, plane_normal
from polaropt.polarized_blocks import PolarizedBlocks
from polaropt.scene_errors import widened_incidence
from polaropt.varying_overlap import VaryingOverlap

Values = NDArray[np.float64]

MIDDLE_BLOCKS = 24
"""Blocks along the longer side that panes are fitted to while edges are looked at."""
# The edges are asked along directions in which the pane is known worse than this.
_OPEN, _MOST_ASKED = math.radians(1.5), 2
# How a pane bends shows in few edges, at the frame's ends: twice as far off as parts left out tell, on 32 scenes.
_LATER_WIDER = 2.0
_STEP, _TOLERANCE, _REACH = math.radians(4), math.radians(0.3), math.radians(25)
_JACKKNIFE_STEP = math.radians(1.5)
_AROUND = (-_JACKKNIFE_STEP, 0.0, _JACKKNIFE_STEP)
_EXACTLY = 1e-4


@dataclass(frozen=True)
class Candidate:
    """A pane, the numbers that are fitted, what else is known of them and directions (6,) that edges told."""

    blocks: PolarizedBlocks
    prior: Prior
    free: tuple[int, ...]
    fit: PaneFit
    asked: tuple[Values, ...] = ()

    def told(self, direction: Values, value: float, error: float) -> Candidate:
        """The pane with one more measurement."""
        known = candidate_near(self.blocks, self.prior.told(direction, value, error), self.free, self.fit.point)
        return replace(known, asked=(*self.asked, direction))

    def worst_known(self) -> tuple[Values, float]:
        """The direction in which the pane is known worst, across those that edges told, and the error there."""
        across = np.eye(N_NUMBERS)
        if self.asked:
            axes = np.linalg.qr(np.stack(self.asked, axis=1))[0]
            across = across - axes @ axes.T
        variances, directions = np.linalg.eigh(across @ self.fit.covariance @ across)
        return directions[:, -1], math.sqrt(max(float(variances[-1]), 0.0))

    def given(self, direction: Values, value: float, blocks: PolarizedBlocks) -> Values:
        """The likeliest point that has a value along a direction."""
        start = self.fit.point + direction * (value - direction @ self.fit.point)
        return fitted(blocks, start, self.free, self.prior.told(direction, value, _EXACTLY))


def candidate_near(blocks: PolarizedBlocks, prior: Prior, free: tuple[int, ...], start: Values) -> Candidate:
    point = fitted(blocks, start, free, prior)
    return Candidate(blocks, prior, free, with_errors(blocks, point, free, prior))


class PaneEdges:
    """Edge overlap of the layers along the panes that the directions of polarization leave open."""

    def __init__(self, overlap: VaryingOverlap, blocks: PolarizedBlocks) -> None:
        self._overlap, self._blocks = overlap, blocks

    def log_overlap(self, candidate: Candidate) -> float:
        """Of the layers that a pane leaves."""
        return float(self._logs(candidate.fit.point).mean())

    def completed(self, candidate: Candidate) -> Candidate:
        """The pane with what the edges tell along directions in which it is known badly."""
        while len(candidate.asked) < _MOST_ASKED and candidate.worst_known()[1] > _OPEN:
            candidate = self.asked(candidate)
        return candidate

    def asked(self, candidate: Candidate) -> Candidate:
        """The pane with what the edges tell along the direction in which it is known worst."""
        direction, _ = candidate.worst_known()
        value, error = self.told(candidate, direction)
        return candidate.told(direction, value, _LATER_WIDER * error if candidate.asked else error)

    def told(self, candidate: Candidate, direction: Values) -> tuple[float, float]:
        """Where along a direction the edges overlap least, and its standard error."""

        def logs(value: float) -> Values:
            return self._logs(candidate.given(direction, value, self._blocks))

        begin = float(direction @ candidate.fit.point)
        curves = [logs(begin + shift) for shift in _AROUND]
        before, here, after = (float(curve.mean()) for curve in curves)
        if min(before, after) > here:
            found = begin + _JACKKNIFE_STEP * vertex(before, here, after)
        else:
            bounds = (begin - _REACH, begin + _REACH)
            found = local_minimum(lambda x: float(logs(x).mean()), begin, bounds, _STEP, _TOLERANCE)
            curves = [logs(found + shift) for shift in _AROUND]
        error = minimum_error([left_out(curve) for curve in curves], _JACKKNIFE_STEP)
        return found, math.radians(widened_incidence(math.degrees(error)))

    def _logs(self, point: Values) -> Values:
        """Log overlap of each part of the frame."""
        incidence_deg, azimuth_deg, focal, bend = named(point, self._blocks)
        return self._overlap.log(Pane(plane_normal(incidence_deg, azimuth_deg), bend, 1 / focal))


def named(point: Values, blocks: PolarizedBlocks) -> tuple[float, float, float, tuple[float, ...]]:
    """Incidence and azimuth in degrees, focal length in pixels (or infinite), bend in radians per pixel of a point."""
    incidence_deg, azimuth_deg = np.degrees(point[[INCIDENCE, AZIMUTH]])
    focal = blocks.half_px / float(point[VIEW]) if point[VIEW] else math.inf
    bend = tuple(float(part) / blocks.half_px for part in point[list(BEND)])
    return float(incidence_deg), float(azimuth_deg), focal, bend
