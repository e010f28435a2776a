"""Captures of one size as tensors of a device, and the pane in front of each as a filter of its own.

On the canvas, whose margins hold all ghosts that show, a pane is a small matrix per frequency (`polaropt.inversion`'s
transfer): captures behind different panes are one batch, whatever the shifts of their ghosts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import conv2d

from polaropt.capture import Capture, NoiseClasses
from polaropt.inversion import Canvas, separable
from polaropt.numerics import Basis, opponent_basis
from polaropt.optics import PSE
from priors.natural_image import in_basis

Frame = tuple[int, int]


@dataclass(frozen=True)
class CaptureBatch:
    """Captures with their panes.

    Attributes
    ----------
    canvas : Canvas
        The same for all.
    photographs : Tensor, shape (capture, k, channel, h, w)
    precision : Tensor, shape (capture, k or 1, channel or 1, h or 1, w or 1)
        Inverse standard deviation of their noise, 0 where they are not trusted.
    mixing : Tensor, shape (capture, k, entry)
        From the light along and across the plane of incidence, and what is polarized in between, to the photographs.
    transfer : Tensor of complex64, shape (capture, entry, 2, H, W // 2 + 1)
        From the layers to these entries.
    basis : Tensor, shape (channel, channel) or (capture, 1, channel, channel)
        The colour basis, the same for all or of each capture.
    """

    canvas: Canvas
    photographs: Tensor
    precision: Tensor
    mixing: Tensor
    transfer: Tensor
    basis: Tensor

    @property
    def device(self) -> torch.device:
        """Where all of it lies."""
        return self.photographs.device

    def transformed(self, images: Tensor) -> Tensor:
        """Half spectra (..., H, W // 2 + 1) of canvas images; their transform keeps lengths."""
        spectra: Tensor = torch.fft.rfft2(images, norm="ortho")
        return spectra

    def images(self, spectra: Tensor) -> Tensor:
        """Canvas images (..., H, W) of half spectra."""
        images: Tensor = torch.fft.irfft2(spectra, s=self.canvas.shape, norm="ortho")
        return images

    def pad_zeros(self, frames: Tensor) -> Tensor:
        """Images (..., h, w) of the frame with zeros in the margins."""
        canvas = self.canvas
        return torch.nn.functional.pad(frames, (canvas.left, canvas.right, canvas.top, canvas.bottom))

    def simulated(self, spectra: Tensor) -> Tensor:
        """Photographs (capture, k, channel, h, w) of layers given as half spectra (capture, 2, channel, ...) in the
        colour basis."""
        t, r = spectra[:, None, 0], spectra[:, None, 1]
        entries = self.images(self.transfer[:, :, 0, None] * t + self.transfer[:, :, 1, None] * r)
        return _mixed(self.mixing, self.in_colors(self.canvas.crop(entries)))

    def spread(self, slopes: Tensor) -> Tensor:
        """Transpose of `simulated`: half spectra in the colour basis of slopes (capture, k, channel, h, w)."""
        entries = self.opponent(_mixed(self.mixing.mT, slopes))
        data = self.transformed(self.pad_zeros(entries))
        back = self.transfer.conj()
        layers = [sum(back[:, e, i, None] * data[:, e] for e in range(data.shape[1])) for i in (0, 1)]
        return torch.stack(layers, dim=1)  # type: ignore[arg-type]

    def opponent(self, layers: Tensor) -> Tensor:
        """Images (..., channel, h, w) in the colour basis."""
        return _turned(self.basis, layers)

    def in_colors(self, layers: Tensor) -> Tensor:
        """Images (..., channel, h, w) of the colour basis in the colours of the photographs."""
        return _turned(self.basis.mT, layers)


def batch_of(
    captures: Sequence[Capture],
    engines: Sequence[PSE],
    noises: Sequence[float | NoiseClasses],
    canvas: Canvas,
    device: str,
    basis: Basis | None = None,
) -> CaptureBatch:
    """Captures of one shape and as many photographs, with the panes before them and the noise of their pixels.

    The colour basis is the opponent one, unless another is given.
    """
    k, frame = len(captures[0].angles_deg), captures[0].shape[-2:]
    n_entries = max(engine.taps.shape[2] for engine in engines)
    mixing = np.zeros((len(captures), k, n_entries), np.float32)
    transfer = torch.zeros(
        (len(captures), n_entries, 2, canvas.shape[0], canvas.shape[1] // 2 + 1), dtype=torch.complex64, device=device
    )
    for i, engine in enumerate(engines):
        own = engine.taps.shape[2]
        mixing[i, :, :own] = engine.mixing[:, :own]
        of_ghosts, down, across = separable(engine.taps, engine.displacements, *canvas.shape)
        rows = placed((of_ghosts[:, :, None, :] * down).astype(np.complex64), device)
        transfer[i, :own] = rows @ placed(across, device)
    if basis is None:
        basis = opponent_basis(captures[0].intensities.shape[1] if captures[0].color else 1)
    shape = (len(captures), k, len(basis), *frame)
    photographs = torch.empty(shape, device=device)
    for i, capture in enumerate(captures):
        photographs[i] = torch.from_numpy(capture.intensities.reshape(shape[1:]))
    weights = [_precision(capture, noise) for capture, noise in zip(captures, noises, strict=True)]
    same = weights[0].shape if len({weight.shape for weight in weights}) == 1 else shape[1:]
    precision = np.stack([np.broadcast_to(weight, same) for weight in weights])
    return CaptureBatch(
        canvas,
        photographs,
        placed(precision, device),
        placed(mixing, device),
        transfer,
        placed(basis.astype(np.float32), device),
    )


def placed(array: NDArray[Any], device: Any) -> Tensor:
    """An array as a tensor of the device."""
    return torch.from_numpy(np.ascontiguousarray(array)).to(device)


def _precision(capture: Capture, noise: float | NoiseClasses) -> NDArray[np.float32]:
    """Inverse standard deviation of each value, 0 where it is not trusted; one number where all are alike."""
    sigma = noise.images()[None] if isinstance(noise, NoiseClasses) else np.full((1, 1, 1, 1), noise, np.float32)
    if all_are_valid(capture):
        return np.asarray(1 / sigma, dtype=np.float32)
    shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
    return np.asarray(capture.valid.reshape(shape) / sigma, dtype=np.float32)


def all_are_valid(capture: Capture) -> bool:
    """Whether every value can be trusted."""
    return capture.n_valid == capture.mask.size


def _mixed(matrix: Tensor, images: Tensor) -> Tensor:
    """A matrix (capture, m, n) for each pixel of images (capture, n, ...)."""
    mixed = torch.matmul(matrix, images.flatten(2))
    return mixed.reshape(*mixed.shape[:2], *images.shape[2:])


def _turned(basis: Tensor, images: Tensor) -> Tensor:
    """Images (capture, image, channel, h, w) in another basis of the colours."""
    if basis.ndim == 2:
        return torch.as_tensor(in_basis(basis, images, torch))
    return images if basis.shape[-1] == 1 else torch.matmul(basis, images.flatten(-2)).reshape(images.shape)


def blurred(images: Tensor, sigma_px: float, reach_px: int) -> Tensor:
    """Images (capture, channel, h, w) through a Gaussian that is nothing beyond so many pixels, mirrored around."""
    weights = np.exp(-0.5 * (np.arange(-reach_px, reach_px + 1) / sigma_px) ** 2)
    kernel = placed((weights / weights.sum()).astype(np.float32), images.device)
    planes = mirrored(images, (reach_px, reach_px), (reach_px, reach_px)).flatten(0, 1)[:, None]
    smooth: Tensor = conv2d(conv2d(planes, kernel[None, None, :, None]), kernel[None, None, None, :])
    return smooth.reshape(images.shape)


def mirrored(images: Tensor, before: Frame, after: Frame) -> Tensor:
    """Images (..., h, w) with so many rows and columns more before and after them, mirrored."""
    for axis in (0, 1):
        n = images.shape[axis - 2]
        places = np.pad(np.arange(n), (before[axis], after[axis]), mode="symmetric")
        images = images.index_select(axis - 2, placed(places, images.device))
    return images
