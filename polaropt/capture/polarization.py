"""A capture's Stokes images, and how the pane's frame shows them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture
from polaropt.numerics import block_mean, fill_gaps
from polaropt.optics import analyzer_matrix, frame_matrix

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SECOND_DIFFERENCE = 1.5
"""Variance of a value less the mean of its two neighbours, in units of theirs."""
_LEAST_INFORMATION = 0.01
"""Information in units of a photograph's, below which its noise would be amplified more than tenfold."""


@dataclass(frozen=True)
class StokesImages:
    """Stokes images without gaps, the covariance of their noise, and which pixels were measured.

    Attributes
    ----------
    images : ndarray, shape (3, channel, h, w)
        s0, s1, s2; pixels that cannot be trusted hold values from around them.
    covariance : ndarray, shape (3, 3)
    valid : ndarray of bool, shape (channel, h, w)
    aliased : bool
        Whether they come from a mosaic: fine detail of s0 then looks like polarized light, here and there.
    """

    images: Images
    covariance: Matrix
    valid: Mask
    aliased: bool = False

    def block_noise(self, size: int) -> float:
        """Standard deviation of means over blocks, in units of what white noise of the covariance would leave.

        What aliases differs from block to block, a pane's polarized light far less: it is measured on second
        differences of neighbours, in the light polarized across the frame's axis.
        """
        if not self.aliased:
            return 1.0
        white = math.sqrt(float(np.trace(self.covariance[1:, 1:])) / 2) / size
        polarized = block_mean(self.images[1:], size)
        _, axes = np.linalg.eigh(np.einsum("ichw,jchw->ij", polarized, polarized, dtype=np.float64))
        across = np.tensordot(axes[:, 0], polarized, axes=1)
        squares = [
            np.square(second).mean(dtype=np.float64) / _SECOND_DIFFERENCE
            for second in (
                across[..., 1:-1] - (across[..., :-2] + across[..., 2:]) / 2,
                across[..., 1:-1, :] - (across[..., :-2, :] + across[..., 2:, :]) / 2,
            )
            if second.size
        ]
        return max(1.0, math.sqrt(float(np.mean(squares))) / white) if squares else 1.0


@dataclass(frozen=True)
class PlateFrame:
    """(I_par, I_perp) of the pane at one azimuth: images (2, channel, h, w), noise covariance (2, 2), valid pixels."""

    images: Images
    covariance: Matrix
    valid: Mask
    azimuth_deg: float

    def across(self) -> PlateFrame:
        """The frame of a pane whose plane of incidence lies across: the two polarizations are exchanged."""
        return PlateFrame(self.images[::-1], self.covariance[::-1, ::-1], self.valid, self.azimuth_deg + 90)


def stokes_images(capture: Capture, noise: float) -> StokesImages:
    """Stokes images of a capture whose photographs have noise of standard deviation `noise`."""
    analyzer = analyzer_matrix(capture.angles_deg)
    inverse = np.linalg.pinv(analyzer)
    images = least_squares_entries(capture, analyzer)
    # Three photographs tell a pixel, if less exactly: gaps would cost more.
    valid = (capture.valid.sum(axis=0) >= analyzer.shape[1]).reshape(images.shape[1:])
    if not valid.all():
        # Where fewer do, what one of them tells beside what is filled in looks like polarized light.
        images = fill_gaps(images, valid)
    aliased = capture.origin is not None and capture.origin.low_passed
    return StokesImages(images, noise**2 * inverse @ inverse.T, valid, aliased)


def plate_frame(stokes: StokesImages, azimuth_deg: float) -> PlateFrame:
    """Turn Stokes images into the frame of a pane at `azimuth_deg`."""
    rotation = frame_matrix(azimuth_deg)[:2]
    images = np.tensordot(rotation.astype(np.float32), stokes.images, axes=1)
    return PlateFrame(images, rotation @ stokes.covariance @ rotation.T, stokes.valid, azimuth_deg)


def least_squares_entries(capture: Capture, mixing: Matrix) -> Images:
    """Entries (entries, channel, h, w) of photographs that are a constant mixing (k, entries) of them.

    From the trusted photographs of each pixel; what they do not tell is taken from the pixels around it.
    """
    photographs = capture.intensities if capture.color else capture.intensities[:, None]
    entries = np.tensordot(np.linalg.pinv(mixing).astype(np.float32), photographs, axes=1)
    valid = capture.valid if capture.color else capture.valid[:, None]
    whole = np.asarray(valid.all(axis=0))
    if not whole.all():
        entries = fill_gaps(entries, whole)
        partly = ~whole & valid.any(axis=0)
        around = entries[:, partly]
        entries[:, partly] = _weighted_entries(photographs[:, partly], valid[:, partly], mixing, around)
    return entries


def _weighted_entries(values: Images, valid: Mask, mixing: Matrix, around: Images) -> Images:
    """Entries (entries, pixels) of valid photographs (k, pixels), by least squares; `around` where they hardly tell."""
    normal = np.einsum("kp,ke,kf->pef", valid, mixing, mixing)
    information, directions = np.linalg.eigh(normal)
    right = np.einsum("kp,ke,pef->pf", valid * values, mixing, directions)
    elsewhere = np.einsum("ep,pef->pf", around, directions)
    along = np.where(information > _LEAST_INFORMATION, right / np.maximum(information, _LEAST_INFORMATION), elsewhere)
    return np.asarray(np.einsum("pef,pf->ep", directions, along), dtype=np.float32)
