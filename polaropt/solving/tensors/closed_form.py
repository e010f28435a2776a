"""The closed form of `polaropt.inversion` for a batch: a Wiener filter per frequency, its spectra fitted to each
capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from polaropt.capture import Capture
from polaropt.inversion import (
    BAND_INERTIA,
    LEAST_COLOR_SHARE,
    LEAST_EDGE_POWER,
    LEAST_INTENSITY,
    MEAN_SPREAD,
    TURNS_BANDS,
    TURNS_POWER_LAW,
    ClosedForm,
    DirectionalBands,
    FrequencyBands,
    Knowledge,
    closed_form_of,
    plate_entries,
    two_layers,
)
from polaropt.numerics import NATURAL_POWER_LAW
from polaropt.optics import PSE
from polaropt.solving.tensors.batch import CaptureBatch, all_are_valid, mirrored, placed


@dataclass(frozen=True)
class BatchClosedForm:
    """What closed forms tell, as tensors; the numbers of each capture beside them.

    Attributes
    ----------
    told : Tensor, shape (capture, 2, H, W // 2 + 1)
    cross : Tensor of complex64, shape (capture, H, W // 2 + 1)
    prior : Tensor, shape (capture, 2, channel, H, W // 2 + 1)
    mean : Tensor, shape (capture, 2, channel, 1, 1)
        These four as of `ClosedForm`.
    layers : Tensor, shape (capture, 2, channel, H, W)
        On the canvas, in the colour basis.
    fit : Fit
        Spectra at a sample of the frequencies.
    bands : FrequencyBands or DirectionalBands
        That sample.
    """

    told: Tensor
    cross: Tensor
    prior: Tensor
    mean: Tensor
    layers: Tensor
    fit: Fit
    bands: FrequencyBands | DirectionalBands

    def each(self, basis: Tensor) -> tuple[ClosedForm, ...]:
        """The numbers of each capture, without images and spectra."""
        rows, means = basis.cpu().numpy().astype(np.float64), self.mean.cpu().numpy()
        return tuple(_known(self.fit, self.bands, i, rows, mean) for i, mean in enumerate(means))


def closed_form(
    batch: CaptureBatch, captures: Sequence[Capture], engines: Sequence[PSE], noises: Sequence[float]
) -> BatchClosedForm:
    """Layers per frequency, with all ghosts.

    Parameters
    ----------
    batch : CaptureBatch
    captures, engines
        Those of the batch.
    noises : sequence of float
        Standard deviation of a photograph's noise, one for each capture.
    """
    entries = batch.opponent(_entries(batch, captures, engines))
    sums = np.zeros((len(engines), batch.mixing.shape[2], 2))
    for i, engine in enumerate(engines):
        sums[i, : engine.taps.shape[2]] = engine.taps.sum(axis=1).T
    noise = torch.tensor(noises, device=batch.device, dtype=torch.float32)
    return natural_images(batch, entries, placed(sums, batch.device), noise)


def natural_images(batch: CaptureBatch, entries: Tensor, sums: Tensor, noise: Tensor) -> BatchClosedForm:
    """Layers per frequency that explain what each pixel shows, of full photographs.

    Parameters
    ----------
    batch : CaptureBatch
        Its photographs are not looked at.
    entries : Tensor, shape (capture, entry, channel, h, w)
        Least-squares entries in the colour basis.
    sums : Tensor of float64, shape (capture, entry, 2)
        Of all double images' shares in them.
    noise : Tensor, shape (capture,)
        Standard deviation of a photograph's noise.
    """
    canvas = batch.canvas
    level = entries.mean(dim=(-1, -2), keepdim=True)
    around = mirrored(entries - level, (canvas.top, canvas.left), (canvas.bottom, canvas.right))
    data = batch.transformed(around * placed(canvas.window(), batch.device))
    precision = (batch.mixing.mT @ batch.mixing) / noise.square()[:, None, None]
    told, cross, right = normal_equations(batch.transfer, precision, data)
    area = canvas.height * canvas.width
    mean = flat_means(level[..., 0, 0], sums, precision * area, batch.basis)
    bands = _bands_of(canvas.shape)
    fit = _fitted(told, cross, right, bands, initial_power(entries[:, 0] + entries[:, 1]))
    prior = everywhere(fit, bands)
    found, _ = two_layers(
        told.transpose(0, 1)[:, :, None], cross[:, None], right.transpose(0, 1), prior.transpose(0, 1)
    )
    layers = batch.images(found.transpose(0, 1)) + mean
    return BatchClosedForm(told, cross, prior, mean, layers, fit, bands)


def flat_means(level: Tensor, sums: Tensor, precision: Tensor, basis: Tensor) -> Tensor:
    """`polaropt.inversion.flat_means` of each capture, (capture, 2, channel, 1, 1).

    Parameters
    ----------
    level : Tensor, shape (capture, entry, channel)
    sums : Tensor of float64, shape (capture, entry, 2)
    precision : Tensor, shape (capture, entry, entry)
    basis : Tensor
        Of the batch.
    """
    told, rows = sums.mT @ precision.double(), basis.double()
    intensity = (level[:, 0] + level[:, 1]).norm(dim=1).double()
    grey = rows.mean(dim=-1) * rows.shape[-1] ** 0.5
    expected = (intensity[:, None] * (grey if rows.ndim == 2 else grey[:, 0]))[:, None]
    spread = (MEAN_SPREAD * intensity.clamp(min=LEAST_INTENSITY)) ** -2
    known = torch.eye(2, device=level.device, dtype=torch.float64) * spread[:, None, None]
    means: Tensor = torch.linalg.solve(told @ sums + known, told @ level.double() + known @ expected.expand(-1, 2, -1))
    return means.float()[..., None, None]


@lru_cache(maxsize=4)
def _bands_of(shape: tuple[int, int]) -> FrequencyBands:
    """Bands of a canvas, which all captures of one size share."""
    return FrequencyBands(*shape)


def initial_power(total: Tensor) -> Tensor:
    """`polaropt.inversion.initial_power` of images (capture, channel, h, w), (capture, channel), in float64."""
    across, down = (total.diff(dim=axis).square().mean(dim=(-1, -2), dtype=torch.float64) for axis in (-1, -2))
    power = across + down
    return torch.maximum(power, LEAST_COLOR_SHARE * power.amax(dim=1, keepdim=True) + LEAST_EDGE_POWER)


def _entries(batch: CaptureBatch, captures: Sequence[Capture], engines: Sequence[PSE]) -> Tensor:
    """Least-squares entries (capture, entry, channel, h, w) in the photographs' colours."""
    if all(map(all_are_valid, captures)):
        return least_squares(batch.mixing, batch.photographs)
    # What pixels lack is filled from those around them.
    entries = np.zeros((*batch.mixing.shape[::2], *batch.photographs.shape[2:]), np.float32)
    for i, (capture, engine) in enumerate(zip(captures, engines, strict=True)):
        own = plate_entries(capture, engine)
        entries[i, : len(own)] = own
    return placed(entries, batch.device)


def least_squares(mixing: Tensor, photographs: Tensor) -> Tensor:
    """Entries (capture, entry, channel, h, w) that explain photographs (capture, k, channel, h, w) best.

    Entries that nothing is mixed of are zero.
    """
    inverse = torch.linalg.pinv(mixing.double()).float()
    flat = torch.matmul(inverse, photographs.flatten(2))
    return torch.unflatten(flat, 2, photographs.shape[2:])


def normal_equations(transfer: Tensor, precision: Tensor, data: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What spectra (capture, entry, channel, ...) tell of the layers: diagonal, upper entry and right-hand side."""
    weighted = (precision[:, :, :, None, None, None] * transfer.conj()[:, None]).sum(dim=2)
    told = (weighted * transfer).real.sum(dim=1)
    cross = (weighted[:, :, 0] * transfer[:, :, 1]).sum(dim=1)
    right = (weighted[:, :, :, None] * data[:, :, None]).sum(dim=1)
    return told, cross, right


@dataclass(frozen=True)
class Fit:
    """Spectra of all captures: the power law, the bands' logarithms, and what follows at the sample."""

    power: Tensor
    logarithms: Tensor
    prior: Tensor
    uncertainty: Tensor
    told: Tensor
    cross: Tensor


def _fitted(told: Tensor, cross: Tensor, right: Tensor, bands: FrequencyBands, power: Tensor) -> Fit:
    """`fit_spectra` of all captures."""
    device = told.device
    sample = placed(bands.sample, device)
    of_each = told.flatten(2).transpose(0, 1)[:, :, None, sample]
    off, seen = cross.flatten(1)[:, None, sample], right.flatten(3).transpose(0, 1)[..., sample]
    share, weights = placed(bands.share, device), placed(bands.weights, device)
    law = placed(bands.squared_frequency ** (NATURAL_POWER_LAW / 2), device)
    size = weights.double() @ share.double() + BAND_INERTIA

    def moments(prior: Tensor) -> tuple[Tensor, Tensor]:
        coefficients, uncertainty = two_layers(of_each, off, seen, prior)
        return coefficients.real.square() + coefficients.imag.square() + uncertainty, uncertainty

    level = torch.stack([power, power])
    logarithms = level.new_zeros((*level.shape, len(weights)))
    prior = (level[..., None] / law).float()
    for _ in range(TURNS_POWER_LAW):
        level = (moments(prior)[0] * (law * share)).sum(dim=-1, dtype=torch.float64)
        prior = (level[..., None] / law).float()
    for _ in range(TURNS_BANDS):
        ratio = moments(prior)[0] / prior
        step = (((ratio * share).double() @ weights.double().T + BAND_INERTIA) / size).log()
        logarithms = logarithms + step
        prior = prior * (step.float() @ weights).exp()
    return Fit(level, logarithms, prior, moments(prior)[1], of_each[:, :, 0], off[:, 0].abs().square())


def everywhere(fit: Fit, bands: FrequencyBands | DirectionalBands) -> Tensor:
    """Power of every frequency before the photographs are seen, (capture, 2, channel, H, W // 2 + 1)."""
    logs, weights = (placed(table, fit.power.device) for table in bands.tables)
    tables = fit.logarithms @ weights.T + fit.power.log()[..., None] + logs
    entry = placed(bands.entry.astype(np.int64), fit.power.device)
    return tables.exp().float()[..., entry].transpose(0, 1)


def _known(fit: Fit, bands: FrequencyBands | DirectionalBands, i: int, basis: Any, mean: Any) -> ClosedForm:
    """The numbers of one capture."""
    told, prior, uncertainty = (x[:, i].cpu().numpy() for x in (fit.told, fit.prior, fit.uncertainty))
    sampled = Knowledge(told, fit.cross[i].cpu().numpy(), prior, bands.share, bands.squared_frequency, basis)
    nothing = np.empty(0, dtype=np.float32)
    return closed_form_of((nothing, mean, nothing, nothing, nothing.astype(np.complex64)), uncertainty, sampled)
