"""What layers are expected to be in each place (`polaropt.solving.local_spectra`), for a batch of captures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from polaropt.inversion import RESOLUTION, Canvas, left_open
from polaropt.solving.local_spectra import (
    BESIDE,
    LEAST_POWER,
    LENGTHS,
    OF_LIGHT,
    OPEN,
    TOWARDS_LARGEST,
    TURNS,
    TURNS_OF_SAMPLES,
    first_length,
)
from polaropt.solving.tensors.batch import CaptureBatch, mirrored, placed
from polaropt.solving.tensors.closed_form import BatchClosedForm
from polaropt.solving.windows import WindowSize


@dataclass(frozen=True)
class BatchExpectation:
    """What is expected of the layers before the sparse penalties.

    Attributes
    ----------
    layers : Tensor, shape (capture, 2, channel, H, W)
        On the canvas, in the colour basis.
    variance : Tensor, shape (capture, 2, channel, H, W // 2 + 1)
        What is left open per frequency, mean over the frame.
    """

    layers: Tensor
    variance: Tensor


def expected_layers(
    batch: CaptureBatch,
    known: BatchClosedForm,
    misfit_gradient: Callable[[Tensor], Tensor],
    precision: Tensor,
    fast_alone: Sequence[bool],
    *,
    sampled: bool = False,
) -> BatchExpectation:
    """Layers under spectra of their own in each window, from the closed form on.

    Parameters
    ----------
    batch : CaptureBatch
    known : BatchClosedForm
    misfit_gradient : callable
        Gradient of the photographs' misfit at canvas layers (capture, 2, channel, H, W) in the colour basis.
    precision : Tensor, shape (capture, h or 1, w or 1)
        What a pixel's photographs tell, beside what `known` takes for it.
    fast_alone : sequence of bool
        Of which captures windows are shown what is fast alone.
    sampled : bool
        Whether the photographs are samples of a mosaic.
    """
    layers, share, last = known.layers, None, None
    for size, times in TURNS_OF_SAMPLES if sampled else TURNS:
        last = BatchWindows(batch, known, size, fast_alone, sampled=sampled)
        of_windows = last.sure_precision(precision)
        length, before = layers.new_full((len(layers),), first_length(times)), None
        for _ in range(times):
            change, share = last.step(layers, misfit_gradient(layers), of_windows)
            if before is not None:
                length = _next_lengths(length, *((before * other).flatten(1).sum(dim=1) for other in (before, change)))
            before = change
            layers = layers.clone()
            batch.canvas.crop(layers).add_(length[:, None, None, None, None] * change)
    assert last is not None
    assert share is not None
    left = _left_open(known.told[:, :, None], known.cross[:, None], known.prior)
    return BatchExpectation(layers, left * last.on_canvas(share))


def _next_lengths(length: Tensor, square: Tensor, left: Tensor) -> Tensor:
    """`next_length` of each capture, (capture,)."""
    least, most = LENGTHS
    stepped = (length * square / (square - left)).clamp(least, most)
    return torch.where(square > left, stepped, most)


class BatchWindows:
    """Overlapping windows of the frames, each with a spectrum of its own.

    Parameters
    ----------
    batch : CaptureBatch
    known : BatchClosedForm
    size : WindowSize
    fast_alone : sequence of bool
        Of which captures windows are shown what is fast alone.
    sampled : bool
        Whether the photographs are samples of a mosaic.
    """

    def __init__(
        self,
        batch: CaptureBatch,
        known: BatchClosedForm,
        size: WindowSize,
        fast_alone: Sequence[bool],
        *,
        sampled: bool = False,
    ) -> None:
        self._batch, self._canvas, self._size = batch, batch.canvas, size
        device = batch.device
        alone = placed(np.array(fast_alone), device)[:, None, None, None, None]
        # Without what is slow there is no mean, either.
        self._mean = torch.where(alone, 0, known.mean)
        self._shown = None
        if any(fast_alone):
            self._shown = torch.where(alone, placed(size.faster(*batch.canvas.shape), device), 1)
        profile = size.profile
        self._window = placed(np.outer(profile, profile), device)
        self._fast, self._along = placed(size.fast, device), placed(size.along, device)
        spectra = torch.cat([known.told.to(known.cross.dtype), known.cross[:, None]], dim=1)
        through = _through_window(spectra, size, batch.canvas)
        self._of_pattern = _of_pattern(size, device) if sampled else None
        # Axes for the colours and for the windows down and across.
        self._told_t, self._told_r = (through[:, i, None, None, None].real for i in (0, 1))
        self._cross = through[:, 2, None, None, None]
        rows, columns = (placed(places, device) for places in size.nearest(*batch.canvas.shape))
        prior = known.prior[..., rows, :][..., columns].clamp(min=LEAST_POWER)
        self._open = _left_open(through[:, :2, None].real, through[:, 2, None], prior)
        self._prior = prior[:, :, :, None, None]
        untold = (self._open / prior).clamp(max=1)
        self._counted = ((OPEN + (1 - OPEN) * untold) * self._open)[:, :, :, None, None]

    def sure_precision(self, precision: Tensor) -> Tensor:
        """Precision of each window from that of the pixels, (capture, windows down or 1, across or 1)."""
        if precision.shape[-2:] == (1, 1):
            return precision
        around = mirrored(precision**TOWARDS_LARGEST, *self._around(precision))
        squares = self._window.square()
        return ((self._pieces(around) * (squares / squares.sum())).sum(dim=(-1, -2))) ** (1 / TOWARDS_LARGEST)

    def step(self, layers: Tensor, gradient: Tensor, precision: Tensor) -> tuple[Tensor, Tensor]:
        """From the layers at hand to what is expected.

        Parameters
        ----------
        layers : Tensor, shape (capture, 2, channel, H, W)
            On the canvas, in the colour basis.
        gradient : Tensor, same shape
            Of the misfit there.
        precision : Tensor
            `sure_precision` of what a pixel's photographs tell.

        Returns
        -------
        change : Tensor, shape (capture, 2, channel, h, w)
        share : Tensor, shape (capture, 2, channel, side, side // 2 + 1)
            How much less is then open than without windows, mean of all.
        """
        if self._shown is not None:
            spectra = (self._batch.transformed(images) * self._shown for images in (layers, gradient))
            layers, gradient = map(self._batch.images, spectra)
        here, down = self._spectra(self._canvas.crop(layers) - self._mean), self._spectra(-self._canvas.crop(gradient))
        power = self._bounded(self._shared(here.real.square() + here.imag.square()))
        stiff_t, stiff_r = (1 / (power[:, i] + self._counted[:, i]).clamp(min=LEAST_POWER) for i in (0, 1))
        slope_t, slope_r = down[:, 0] - stiff_t * here[:, 0], down[:, 1] - stiff_r * here[:, 1]
        p = precision[:, None, :, :, None, None]
        of_t, of_r, cross = p * self._told_t + stiff_t, p * self._told_r + stiff_r, p * self._cross
        product = of_t * of_r
        inverse = 1 / torch.maximum(product - cross.abs().square(), float(RESOLUTION) * product)
        moved = inverse * self._fast
        change = torch.stack(
            [moved * (of_r * slope_t - cross * slope_r), moved * (of_t * slope_r - cross.conj() * slope_t)], dim=1
        )
        left = torch.stack([(of_r * inverse).mean(dim=(2, 3)), (of_t * inverse).mean(dim=(2, 3))], dim=1)
        share = torch.where(self._fast > 0, left / self._open, torch.ones_like(left))
        return self._put(change), share

    def _shared(self, power: Tensor) -> Tensor:
        """Power of layers in windows, drawn to what is alike there: see `BESIDE`."""
        busy = (power + self._counted) / self._prior
        outward, inward = (busy.flatten(-2)[..., places].reshape(busy.shape) for places in self._along)
        shared = (1 - BESIDE) * busy + BESIDE / 2 * (outward + inward)
        light, others = shared[:, :, :1], shared[:, :, 1:]
        shared = torch.cat([light, (1 - OF_LIGHT) * others + OF_LIGHT * light], dim=2)
        return (shared * self._prior - self._counted).clamp(min=0)

    def _bounded(self, power: Tensor) -> Tensor:
        """Power of a mosaic's layers where it is like that of others of its direction, see `limit_power`."""
        if self._of_pattern is None:
            return power
        means, bounded = self._of_pattern
        most = ((power + self._counted) / self._prior).flatten(-2) @ means
        most = most.reshape(power.shape) * self._prior - self._counted
        return torch.where(bounded, torch.minimum(power, most).clamp(min=0), power)

    def on_canvas(self, share: Tensor) -> Tensor:
        """A share at the frequencies of a window (..., side, side // 2 + 1) at those of the canvas."""
        height, width = self._canvas.shape
        side = self._size.side_px
        rows, columns = (np.fft.fftfreq(height) % 1) * side, np.fft.rfftfreq(width) * side
        periodic = torch.cat([share, share[..., :1, :]], dim=-2)
        return _between(_between(periodic, rows, -2), columns, -1)

    def _around(self, images: Tensor) -> tuple[tuple[int, int], tuple[int, int]]:
        """Rows and columns around a frame that windows need, before and after it."""
        step = self._size.step_px
        height, width = images.shape[-2:]
        return (step, step), (step + -height % step, step + -width % step)

    def _pieces(self, images: Tensor) -> Tensor:
        """Windows (..., down, across, side, side) of extended images (..., h, w)."""
        side, step = self._size.side_px, self._size.step_px
        return images.unfold(-2, side, step).unfold(-2, side, step)

    def _spectra(self, frames: Tensor) -> Tensor:
        """Half spectra of the windows of frames (..., h, w), as if these were of the windows' pixels alone."""
        pieces = self._pieces(mirrored(frames, *self._around(frames))) * (2 * self._window)
        spectra: Tensor = torch.fft.rfft2(pieces, norm="ortho")
        return spectra

    def _put(self, spectra: Tensor) -> Tensor:
        """What windows of half spectra add up to on the frame."""
        side, step = self._size.side_px, self._size.step_px
        pieces = torch.fft.irfft2(spectra, s=(side, side), norm="ortho") * (self._window / 2)
        down, across = pieces.shape[-4:-2]
        total = pieces.new_zeros((*pieces.shape[:-4], (down + 1) * step, (across + 1) * step))
        for y in (0, 1):
            for x in (0, 1):
                # A quarter of each window; those of all windows lie side by side.
                part = pieces[..., y * step : (y + 1) * step, x * step : (x + 1) * step].transpose(-3, -2)
                whole = part.reshape(*total.shape[:-2], down * step, across * step)
                total[..., y * step : (down + y) * step, x * step : (across + x) * step] += whole
        canvas = self._canvas
        inside: Tensor = total[..., step : step + canvas.height, step : step + canvas.width]
        return inside


def _of_pattern(size: WindowSize, device: torch.device) -> tuple[Tensor, Tensor]:
    """Weights of frequencies in the mean of each one's direction (n, n), and which are bounded by it, (side, ...)."""
    weight, direction = size.of_pattern
    alike = (direction[:, None] == direction) & (direction >= 0)
    of_each = weight[:, None] * alike
    means = of_each / np.maximum(of_each.sum(axis=0), np.float32(LEAST_POWER))
    bounded = ((weight == 0) & (direction >= 0)).reshape(size.fast.shape)
    return placed(means.astype(np.float32), device), placed(bounded, device)


def _left_open(told: Tensor, cross: Tensor, prior: Tensor) -> Tensor:
    """`left_open` of each capture, (capture, 2, channel, ...), under a prior of this shape."""
    of_each, stiffness = (x.transpose(0, 1) for x in (told, 1 / prior.clamp(min=LEAST_POWER)))
    left: Tensor = left_open(of_each, cross, stiffness)[0]
    return left.transpose(0, 1)


def _through_window(spectra: Tensor, size: WindowSize, canvas: Canvas) -> Tensor:
    """Filters (..., H, W // 2 + 1) as windows see them: of their kernels what lies as far apart within one."""
    part = size.kernel_within(*canvas.shape)
    kernels = torch.fft.irfft2(spectra, s=canvas.shape)
    rows, columns = (placed(places.ravel(), spectra.device) for places in (part.rows, part.columns))
    values = kernels[..., rows, :][..., columns] * placed(part.weights, spectra.device)
    places = placed(np.eye(size.side_px, dtype=np.float32)[part.places], spectra.device)
    through: Tensor = torch.fft.rfft2(places.mT @ values @ places)
    return through


def _between(values: Tensor, places: NDArray[Any], axis: int) -> Tensor:
    """Values at fractional places along an axis, linearly."""
    first = np.minimum(places.astype(int), values.shape[axis] - 2)
    weight = placed((places - first).astype(np.float32), values.device).reshape(-1, *[1] * (-1 - axis))
    before, after = (values.index_select(axis, placed(first + i, values.device)) for i in (0, 1))
    return torch.lerp(before, after, weight)
