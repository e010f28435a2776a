"""Edges of the layers that a pane leaves, in closed form: what tells panes apart whose spectra are alike."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseModel
from polaropt.numerics import middle_part
from polaropt.optics import SceneParameters
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem

MIDDLE_PX = 512
"""Side of the middle of the frame that is looked at, pixels: it bounds the seconds, and holds every double image."""
_LEAST_VARIATION = 1e-12
"""Of a layer without any edges. Set by hand."""


def edges_of_layers(
    capture: Capture, scene: SceneParameters, noise: float, growth: NoiseModel | None = None
) -> tuple[float, float]:
    """Logarithms of the total variations of transmission and reflection, in the middle of the frame.

    Minus log likelihood for each difference of neighbours, where these follow a Laplace distribution whose width is not
    known.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        A complete scene.
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    growth : NoiseModel, optional
        How it grows with the light. Default: it is the same everywhere.
    """
    middle = capture.part(*middle_part(capture.shape, MIDDLE_PX))
    problem = Problem(middle, scene, noise, Weights(), growth=growth)
    layers = problem.canvas.crop(problem.closed_form().layers)
    behind, mirrored = (math.log(_total_variation(layer) + _LEAST_VARIATION) for layer in layers)
    return behind, mirrored


def _total_variation(layer: NDArray[np.float32]) -> float:
    return sum(float(np.abs(np.diff(layer, axis=axis)).sum(dtype=np.float64)) for axis in (-1, -2))
