"""Checks of linear operators and gradients that every part of the suite shares."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def assert_adjoint(
    forward: Callable[[Array], Array],
    adjoint: Callable[[Array], Array],
    shape: tuple[int, ...],
    *,
    tolerance: float = 1e-12,
    seed: int = 0,
) -> None:
    """Check ``<A x, y> = <x, A^T y>`` for random float64 x of `shape` and y of the shape of ``A x``."""
    random = np.random.default_rng(seed)
    x = random.standard_normal(shape)
    image = forward(x)
    y = random.standard_normal(image.shape)
    back = adjoint(y)
    assert back.shape == shape
    left, right = np.vdot(image, y), np.vdot(x, back)
    size = np.linalg.norm(image) * np.linalg.norm(y) + np.linalg.norm(x) * np.linalg.norm(back)
    assert abs(left - right) <= tolerance * size, f"<A x, y> = {left}, <x, A^T y> = {right}"


def assert_gradient(
    value_and_grad: Callable[[Array], tuple[float, Array]],
    x: Array,
    *,
    step: float = 1e-5,
    tolerance: float = 1e-6,
    n_directions: int = 5,
    seed: int = 0,
) -> None:
    """Check a gradient at `x` against central differences of the value along random directions.

    `step` is the length of the step relative to the entries of `x` (or to 1); `tolerance` is relative to the length
    of the gradient.
    """
    random = np.random.default_rng(seed)
    _, gradient = value_and_grad(x)
    assert gradient.shape == x.shape
    for _ in range(n_directions):
        direction = random.standard_normal(x.shape)
        direction /= np.linalg.norm(direction)
        h = step * max(1.0, float(np.abs(x).max()))
        above, _ = value_and_grad((x + h * direction).astype(x.dtype))
        below, _ = value_and_grad((x - h * direction).astype(x.dtype))
        slope, expected = (above - below) / (2 * h), float(np.vdot(gradient.astype(np.float64), direction))
        size = max(float(np.linalg.norm(gradient)), 1e-12)
        assert abs(slope - expected) <= tolerance * size, f"differences give {slope}, the gradient {expected}"
