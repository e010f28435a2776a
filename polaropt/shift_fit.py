"""Small motions that make photographs as dependent on each other as they can be: shifts, and turns and growth as well.

Behind glass each photograph is a mixture of the same two pictures (and of ghosts of them), so that k photographs that
lie on each other have a covariance of rank 2, noise apart. A motion of one raises it. The motions that make the
logarithm of its determinant least are those of greatest likelihood if the pixels are taken for normal; nothing of the
pane needs to be known for it, neither gains nor exposures matter, and ghosts do not bias it, as they would bias the
correlation of two photographs.

All that is needed of the photographs are the products of their values and of what each motion adds to them to first
order (their gradients), a matrix of 3k x 3k for shifts. A turn and growth about the middle of the frame are counted in
pixels at its corners, so that all motions are alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Images = NDArray[np.floating[Any]]
Matrix = NDArray[np.float64]

_STRIPS = 12
_FLOOR = 1e-6
_ROUNDS = 60


@dataclass(frozen=True)
class SmallShifts:
    """Motions against the first photograph.

    Attributes
    ----------
    pixels : ndarray, shape (k, 2) or (k, 4)
        Down and to the right, then turn (clockwise) and growth in pixels at the corners; the first is 0.
    error : float
        Largest standard error of them, from how far parts of the frame disagree; infinite where nothing tells.
    """

    pixels: Matrix
    error: float


def products(images: Images, trusted: NDArray[np.bool_] | None = None, turning: bool = False) -> Matrix:
    """Products of values, downward and rightward gradients of images (k, h, w), in strips, (strip, 3k, 3k).

    Parameters
    ----------
    images : ndarray, shape (k, h, w)
        Smooth, so that differences of neighbours are gradients.
    trusted : ndarray of bool, shape (h, w), optional
        Pixels that count; all if not given. Their neighbours must hold values, too.
    turning : bool
        Whether photographs may be turned and scaled as well: what both add comes after the gradients, (strip, 5k, 5k).
    """
    values = images[:, 1:-1, 1:-1]
    half = images.dtype.type(0.5)
    down = (images[:, 2:, 1:-1] - images[:, :-2, 1:-1]) * half
    right = (images[:, 1:-1, 2:] - images[:, 1:-1, :-2]) * half
    motions = [down, right]
    if turning:
        y, x = (part.astype(images.dtype) for part in from_middle(images.shape[-2:]))
        y, x = y[1:-1], x[:, 1:-1]
        motions += [x * down - y * right, y * down + x * right]
    features = np.concatenate([values, *motions])
    chosen = features.reshape(len(features), -1) if trusted is None else features[:, trusted[1:-1, 1:-1]]
    length = chosen.shape[1] // _STRIPS
    strips = chosen[:, : length * _STRIPS].reshape(len(features), _STRIPS, length).transpose(1, 0, 2)
    found: Matrix = (strips @ strips.transpose(0, 2, 1)).astype(np.float64)
    return found


def from_middle(shape: tuple[int, ...]) -> tuple[Matrix, Matrix]:
    """Rows (h, 1) and columns (1, w) from the middle of a frame, in units of its half diagonal."""
    height, width = shape
    half = np.hypot(height - 1, width - 1) / 2
    rows, columns = ((np.arange(side) - (side - 1) / 2) / half for side in (height, width))
    return rows[:, None], columns[None, :]


def disagreement(strips: Matrix, n_motions: int = 2) -> float:
    """Logarithm of the determinant of the photographs' correlations: 0 where they have nothing in common, else below.

    Unlike that of their covariance it does not fall because resampling smooths noise.
    """
    total = strips.sum(axis=0)
    count = len(total) // (1 + n_motions)
    covariance = _floored(total[:count, :count])
    return float(np.linalg.slogdet(covariance)[1] - np.log(np.diag(covariance)).sum())


def fit_small_shifts(strips: Matrix, at_rest: float = 1e-4, n_motions: int = 2) -> SmallShifts:
    """Motions of about a pixel at most that make the determinant least, to first order in the gradients.

    The logarithm of a determinant lies below its tangents; each round minimizes the tangent, a quadratic function,
    until nothing moves by more than `at_rest` pixels.
    """
    total = strips.sum(axis=0)
    count = len(total) // (1 + n_motions)
    shifts: Matrix = np.zeros((count, n_motions))
    if not np.trace(total) > 0:
        return SmallShifts(shifts, np.inf)
    for _ in range(_ROUNDS):
        before = shifts
        weights = _weights(total, shifts)
        matrix, right = _normal_equations(total, weights)
        try:
            found = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            return SmallShifts(np.zeros((count, n_motions)), np.inf)
        moving = np.asarray(found, dtype=np.float64).reshape(n_motions, -1).T
        shifts = np.concatenate([np.zeros((1, n_motions)), moving])
        if np.abs(shifts - before).max() < at_rest:
            break
    return SmallShifts(shifts, _standard_error(strips, weights, matrix, shifts))


def _weights(total: Matrix, shifts: Matrix) -> Matrix:
    """Inverse covariance of the photographs moved by their shifts."""
    moved = np.hstack([np.eye(len(shifts)), *(np.diag(motion) for motion in shifts.T)])
    return np.asarray(np.linalg.inv(_floored(moved @ total @ moved.T)), dtype=np.float64)


def _floored(covariance: Matrix) -> Matrix:
    # Photographs without noise leave a determinant of zero.
    floor = max(_FLOOR * float(np.trace(covariance)), 1e-30)
    return np.asarray(covariance + floor * np.eye(len(covariance)), dtype=np.float64)


def _normal_equations(total: Matrix, weights: Matrix) -> tuple[Matrix, Matrix]:
    """Matrix and right side for the motions of all photographs but the first, all downward ones before the others."""
    count = len(weights)
    n_features = len(total) // count
    blocks = total.reshape(n_features, count, n_features, count).transpose(0, 2, 1, 3)
    inner, motions = weights[1:, 1:], range(1, n_features)
    matrix: Matrix = np.block([[inner * blocks[a, b][1:, 1:] for b in motions] for a in motions])
    right = np.concatenate([-(weights * blocks[a, 0]).sum(axis=1)[1:] for a in motions])
    return matrix, right


def _standard_error(strips: Matrix, weights: Matrix, matrix: Matrix, shifts: Matrix) -> float:
    """From the strips' disagreement: natural pictures are not normal and their pixels not independent."""
    flat = shifts[1:].T.ravel()
    scores = []
    for strip in strips:
        own, right = _normal_equations(strip, weights)
        scores.append(right - own @ flat)
    moved = np.linalg.solve(matrix, np.array(scores).T)
    variance = np.square(moved).sum(axis=1) * len(strips) / (len(strips) - 1)
    return float(np.sqrt(variance.max()))
