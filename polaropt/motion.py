"""Motions of photographs against each other: shifts, turns and growth, and images moved by them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Image = NDArray[np.float32]

_MIRRORED = 16


@dataclass(frozen=True)
class Motions:
    """Where each photograph holds what the first one shows, rows and columns counted from the middle of the frame.

    Attributes
    ----------
    matrices : ndarray, shape (k, 2, 2)
        A scene point at (row, column) u in the first photograph lies at ``matrices[k] @ u + offsets[k]``.
    offsets : ndarray, shape (k, 2)
        Pixels down and to the right.
    """

    matrices: Matrix
    offsets: Matrix

    @classmethod
    def of_shifts(cls, shifts: Matrix) -> Motions:
        """Shifts (k, 2) and nothing else."""
        return cls(np.tile(np.eye(2), (len(shifts), 1, 1)), np.asarray(shifts, dtype=np.float64))

    def followed_by(self, step: Matrix, half_diagonal: float) -> Motions:
        """After a small motion more, (k, 4): down, right, turn and growth in pixels at the corners."""
        turn, growth = step[:, 2] / half_diagonal, step[:, 3] / half_diagonal
        more = np.stack([np.stack([1 + growth, turn], -1), np.stack([-turn, 1 + growth], -1)], -2)
        offsets = self.offsets + (self.matrices @ step[:, :2, None])[..., 0]
        return Motions(self.matrices @ more, offsets)

    def magnified(self, factor: float) -> Motions:
        """The same in pixels that are smaller by a factor."""
        return Motions(self.matrices, self.offsets * factor)

    def about(self, point: Matrix) -> Motions:
        """The same with rows and columns counted from another point, (2,), given from the middle."""
        return Motions(self.matrices, self.offsets + (self.matrices - np.eye(2)) @ point)

    @property
    def rotations_deg(self) -> Matrix:
        """How far each photograph is turned, clockwise as seen, (k,)."""
        return np.asarray(np.degrees(np.arctan2(self.matrices[:, 0, 1], self.matrices[:, 0, 0])))

    @property
    def scales(self) -> Matrix:
        """How much larger each photograph shows the scene, (k,)."""
        return np.asarray(np.hypot(self.matrices[:, 0, 1], self.matrices[:, 0, 0]))

    def displacements(self, points: Matrix) -> Matrix:
        """How far scene points (n, 2) lie from where they are in the first photograph, (k, n, 2)."""
        turned = np.matmul(points, np.swapaxes(self.matrices - np.eye(2), 1, 2))
        return np.asarray(turned + self.offsets[:, None], dtype=np.float64)


def corners(shape: tuple[int, ...]) -> Matrix:
    """Corners of a frame (..., h, w) from its middle: top left, top right, bottom left, bottom right, (4, 2)."""
    half = (np.asarray(shape[-2:]) - 1) / 2
    return np.asarray(half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]))


def _place(matrix: Matrix, offset: Matrix, shape: tuple[int, ...]) -> Matrix:
    """Offset of an affine map of array indices that is given from the middle of the frame."""
    middle = (np.asarray(shape) - 1) / 2
    return np.asarray(middle + offset - matrix @ middle, dtype=np.float64)


def moved_back(image: Image, matrix: Matrix, offset: Matrix, order: int) -> Image:
    """An image (h, w) as the first photograph would show it, by splines; zero beyond its edges."""
    from scipy.ndimage import affine_transform

    place = _place(matrix, offset, image.shape)
    return np.asarray(affine_transform(image, matrix, place, order=order), dtype=np.float32)


def finely_moved_back(image: Image, matrix: Matrix, offset: Matrix) -> Image:
    """The same without loss of the finest detail: doubled in the Fourier domain, then by splines.

    Splines alone smooth the finest detail and the noise. The image is mirrored beyond its edges.
    """
    from scipy.ndimage import affine_transform, spline_filter
    from scipy.signal import resample

    padded = np.pad(image, _MIRRORED, mode="symmetric")
    doubled = resample(resample(padded, 2 * padded.shape[0], axis=0), 2 * padded.shape[1], axis=1)
    coefficients = spline_filter(doubled, order=3, output=np.float32)
    place = 2 * (_place(matrix, offset, image.shape) + _MIRRORED)
    moved = affine_transform(
        coefficients, 2 * matrix, place, output_shape=image.shape, order=3, mode="nearest", prefilter=False
    )
    return np.asarray(moved, dtype=np.float32)
