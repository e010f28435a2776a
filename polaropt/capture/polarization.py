"""A capture's Stokes images, and how the pane's frame shows them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture
from polaropt.numerics import GAP_STRIP, block_mean, block_shares, fill_gaps, gap_values, kept_while_alive, strips
from polaropt.optics import analyzer_matrix, frame_matrix

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SECOND_DIFFERENCE = 1.5
"""Variance of a value less the mean of its two neighbours, in units of theirs."""
_LEAST_INFORMATION = 0.01
"""Information in units of a photograph's, below which its noise would be amplified more than tenfold."""


_LARGE = 2**24
"""Values of photographs from which on their mixtures are worked out where they are read, not kept: 4 photographs of 4
megapixels; set by hand."""


@dataclass(frozen=True, eq=False)
class MixedImages:
    """Linear mixtures of large photographs without gaps, worked out where they are read.

    Attributes
    ----------
    photographs : ndarray, shape (k, channel, h, w)
    matrices : tuple of ndarray
        From photographs to what fills the gaps, (entries, k), and on from there.
    gaps : ndarray of int, shape (3, n)
        Channel, row and column of pixels that no matrix tells.
    values : ndarray, shape (entries, n)
        What the first matrix would give there.
    """

    photographs: Images
    matrices: tuple[Matrix, ...]
    gaps: NDArray[np.intp]
    values: Images

    @property
    def shape(self) -> tuple[int, ...]:
        """Entries, channels, rows and columns."""
        return (len(self.matrices[-1]), *self.photographs.shape[1:])

    def __getitem__(self, part: tuple[Any, slice, slice]) -> Images:
        """The images of some rows and columns, [..., rows, columns]."""
        _, rows, columns = part
        (top, bottom, _), (left, right, _) = (
            where.indices(side) for where, side in zip((rows, columns), self.shape[-2:], strict=True)
        )
        images = _mixed(self.matrices[0], self.photographs[..., rows, columns])
        _, row, column = self.gaps
        inside = (row >= top) & (row < bottom) & (column >= left) & (column < right)
        channel, row, column = self.gaps[:, inside]
        images[:, channel, row - top, column - left] = self.values[:, inside]
        for matrix in self.matrices[1:]:
            images = _mixed(matrix, images)
        return images

    def strips(self, multiple: int) -> Iterator[tuple[slice, Images]]:
        """Rows from top to bottom, a multiple of so many at a time, with their images."""
        height = self.shape[-2]
        for rows in strips(height, self.photographs.size // height, multiple):
            yield rows, self[..., rows, slice(None)]

    def exchanged(self) -> MixedImages:
        """The same with the entries in reverse order."""
        return replace(self, matrices=(*self.matrices, np.eye(self.shape[0])[::-1]))


AnyImages = Images | MixedImages


def _mixed(matrix: Matrix, images: Images) -> Images:
    return np.tensordot(matrix.astype(np.float32), images, axes=1)


def _mixed_again(matrix: Matrix, images: AnyImages) -> AnyImages:
    if isinstance(images, MixedImages):
        return replace(images, matrices=(*images.matrices, matrix))
    return _mixed(matrix, images)


def _block_means(images: AnyImages, size: int) -> Images:
    if isinstance(images, MixedImages):
        return np.concatenate([block_mean(part, size) for _, part in images.strips(size)], axis=-2)
    return block_mean(images, size)


@dataclass(frozen=True)
class StokesImages:
    """Stokes images without gaps, the covariance of their noise, and which pixels were measured.

    Attributes
    ----------
    images : ndarray or MixedImages, shape (3, channel, h, w)
        s0, s1, s2; pixels that cannot be trusted hold values from around them.
    covariance : ndarray, shape (3, 3)
    valid : ndarray of bool, shape (channel, h, w)
    aliased : bool
        Whether they come from a mosaic: fine detail of s0 then looks like polarized light, here and there.
    """

    images: AnyImages
    covariance: Matrix
    valid: Mask
    aliased: bool = False

    def means(self, size: int) -> Images:
        """Means over blocks of a side in pixels, (3, channel, h // size, w // size)."""
        return _block_means(self.images, size)

    def shares(self, size: int) -> Images:
        """Shares of measured pixels in these blocks, (channel, h // size, w // size)."""
        return block_shares(self.valid, size)

    def of_channel(self, channel: int) -> StokesImages:
        """Those of one colour."""
        only = slice(channel, channel + 1)
        return replace(self, images=self.images[..., :, :][:, only], valid=self.valid[only])

    def reversed(self) -> StokesImages:
        """The same of photographs whose angles count the other way."""
        mirror = np.diag([1.0, 1.0, -1.0])
        return replace(self, images=_mixed_again(mirror, self.images), covariance=mirror @ self.covariance @ mirror)

    def block_noise(self, size: int) -> float:
        """Standard deviation of means over blocks, in units of what white noise of the covariance would leave.

        Of a mosaic it is measured in the light polarized across the frame's axis, see `noise_of_neighbours`.
        """
        if not self.aliased:
            return 1.0
        white = math.sqrt(float(np.trace(self.covariance[1:, 1:])) / 2) / size
        polarized = self.means(size)[1:]
        _, axes = np.linalg.eigh(np.einsum("ichw,jchw->ij", polarized, polarized, dtype=np.float64))
        across = axes[:, 0]
        return max(1.0, math.sqrt(float(across @ noise_of_neighbours(polarized) @ across)) / white)


def noise_of_neighbours(polarized: Images) -> Matrix:
    """Covariance (2, 2) of what differs in s1 and s2 (2, channel, h, w) of blocks beside each other.

    What aliases differs from block to block, and more in one component than in the other where edges lie alike; a
    pane's polarized light differs far less. It is measured on second differences.
    """
    values = polarized.astype(np.float64)
    seconds = (
        values[..., 1:-1] - (values[..., :-2] + values[..., 2:]) / 2,
        values[..., 1:-1, :] - (values[..., :-2, :] + values[..., 2:, :]) / 2,
    )
    told = [np.einsum("ichw,jchw->ij", part, part) / part[0].size for part in seconds if part.size]
    return np.mean(told, axis=0) / _SECOND_DIFFERENCE if told else np.zeros((2, 2))


@dataclass(frozen=True)
class PlateFrame:
    """(I_par, I_perp) of the pane at one azimuth: images (2, channel, h, w), noise covariance (2, 2), valid pixels.

    `aliased` as of `StokesImages`.
    """

    images: AnyImages
    covariance: Matrix
    valid: Mask
    azimuth_deg: float
    aliased: bool = False

    def means(self, size: int) -> Images:
        """Means over blocks of a side in pixels, (2, channel, h // size, w // size)."""
        return _block_means(self.images, size)

    def shares(self, size: int) -> Images:
        """Shares of measured pixels in these blocks, (channel, h // size, w // size)."""
        return block_shares(self.valid, size)

    def across(self) -> PlateFrame:
        """The frame of a pane whose plane of incidence lies across: the two polarizations are exchanged."""
        images = self.images.exchanged() if isinstance(self.images, MixedImages) else self.images[::-1]
        return replace(self, images=images, covariance=self.covariance[::-1, ::-1], azimuth_deg=self.azimuth_deg + 90)


@kept_while_alive
def stokes_images(capture: Capture, noise: float) -> StokesImages:
    """Stokes images of a capture whose photographs have noise of standard deviation `noise`."""
    analyzer = analyzer_matrix(capture.angles_deg)
    inverse = np.linalg.pinv(analyzer)
    # Three photographs tell a pixel, if less exactly: gaps would cost more.
    valid = _known_by(capture, analyzer.shape[1])
    # Where fewer do, what one of them tells beside what is filled in looks like polarized light.
    images: AnyImages
    if capture.intensities.size > _LARGE:
        images = _mixed_in_strips(capture, analyzer, valid)
    else:
        images = least_squares_entries(capture, analyzer)
        images = images if valid.all() else fill_gaps(images, valid)
    return StokesImages(images, noise**2 * inverse @ inverse.T, valid, capture.low_passed)


def _known_by(capture: Capture, n: int) -> Mask:
    """Pixels (channel, h, w) that at least `n` photographs tell."""
    known = np.empty(capture.shape, dtype=np.bool_)
    height = capture.shape[-2]
    for rows in strips(height, capture.intensities.size // height):
        counts = np.add.reduce(capture.mask[..., rows, :], axis=0, dtype=np.uint16)
        known[..., rows, :] = counts >= n
    return known.reshape(-1, *known.shape[-2:])


@kept_while_alive
def plate_frame(stokes: StokesImages, azimuth_deg: float) -> PlateFrame:
    """Turn Stokes images into the frame of a pane at `azimuth_deg`."""
    rotation = frame_matrix(azimuth_deg)[:2]
    images = _mixed_again(rotation, stokes.images)
    return PlateFrame(images, rotation @ stokes.covariance @ rotation.T, stokes.valid, azimuth_deg, stokes.aliased)


def least_squares_entries(capture: Capture, mixing: Matrix) -> Images:
    """Entries (entries, channel, h, w) of photographs that are a constant mixing (k, entries) of them.

    From the trusted photographs of each pixel; what they do not tell is taken from the pixels around it.
    """
    photographs = capture.planes
    entries = np.tensordot(np.linalg.pinv(mixing).astype(np.float32), photographs, axes=1)
    valid = capture.valid if capture.color else capture.valid[:, None]
    whole = np.asarray(valid.all(axis=0))
    if not whole.all():
        entries = fill_gaps(entries, whole)
        partly = ~whole & valid.any(axis=0)
        around = entries[:, partly]
        entries[:, partly] = _weighted_entries(photographs[:, partly], valid[:, partly], mixing, around)
    return entries


def _mixed_in_strips(capture: Capture, mixing: Matrix, known: Mask) -> MixedImages:
    """The entries of `least_squares_entries`, with gaps filled once more where they are not `known` (channel, h, w)."""
    photographs = capture.planes
    nowhere = np.zeros((3, 0), np.intp), np.zeros((mixing.shape[1], 0), np.float32)
    mixed = MixedImages(photographs, (np.asarray(np.linalg.pinv(mixing), dtype=np.float64),), *nowhere)
    if capture.n_valid == capture.mask.size:
        return mixed

    def whole(rows: slice) -> Mask:
        in_all = np.asarray(capture.mask[..., rows, :].all(axis=0))
        return in_all.reshape(-1, *in_all.shape[-2:])

    gaps, values = gap_values((images, whole(rows)) for rows, images in mixed.strips(GAP_STRIP))
    trusted = np.stack([photograph.reshape(photographs.shape[1:])[*gaps] for photograph in capture.mask])
    partly = trusted.any(axis=0)
    of_partly = gaps[:, partly]
    values[:, partly] = _weighted_entries(photographs[:, *of_partly], trusted[:, partly], mixing, values[:, partly])
    mixed = replace(mixed, gaps=gaps, values=values)
    if known.all():
        return mixed
    _, again = gap_values((images, known[:, rows]) for rows, images in mixed.strips(GAP_STRIP))
    values = values.copy()
    values[:, ~known[*gaps]] = again
    return replace(mixed, values=values)


def _weighted_entries(values: Images, valid: Mask, mixing: Matrix, around: Images) -> Images:
    """Entries (entries, pixels) of valid photographs (k, pixels), by least squares; `around` where they hardly tell."""
    normal = np.einsum("kp,ke,kf->pef", valid, mixing, mixing)
    information, directions = np.linalg.eigh(normal)
    right = np.einsum("kp,ke,pef->pf", valid * values, mixing, directions)
    elsewhere = np.einsum("ep,pef->pf", around, directions)
    along = np.where(information > _LEAST_INFORMATION, right / np.maximum(information, _LEAST_INFORMATION), elsewhere)
    return np.asarray(np.einsum("pef,pf->ep", directions, along), dtype=np.float32)
