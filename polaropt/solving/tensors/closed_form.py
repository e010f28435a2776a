"""The closed form of `polaropt.inversion` for a batch: a Wiener filter per frequency, its spectra fitted to each
capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from polaropt.capture import Capture
from polaropt.inversion import (
    BAND_INERTIA,
    TURNS_BANDS,
    TURNS_POWER_LAW,
    ClosedForm,
    FrequencyBands,
    Knowledge,
    at_least_a_trifle,
    closed_form_of,
    flat_means,
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
    each : tuple of ClosedForm
        Of each capture, without the images and spectra above.
    """

    told: Tensor
    cross: Tensor
    prior: Tensor
    mean: Tensor
    layers: Tensor
    each: tuple[ClosedForm, ...]


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
    canvas = batch.canvas
    entries = batch.opponent(_entries(batch, captures, engines))
    level = entries.mean(dim=(-1, -2), keepdim=True)
    around = mirrored(entries - level, (canvas.top, canvas.left), (canvas.bottom, canvas.right))
    data = batch.transformed(around * placed(canvas.window(), batch.device))
    squares = batch.mixing.mT @ batch.mixing
    precision = squares / torch.tensor(noises, device=batch.device, dtype=torch.float32)[:, None, None] ** 2
    told, cross, right = _normal_equations(batch.transfer, precision, data)
    levels = level[..., 0, 0].cpu().numpy()
    area = canvas.height * canvas.width
    basis = batch.basis.cpu().numpy().astype(np.float64)
    means = []
    for i, (engine, noise) in enumerate(zip(engines, noises, strict=True)):
        own = engine.mixing[:, : engine.taps.shape[2]]
        means.append(flat_means(levels[i, : own.shape[1]], engine, own.T @ own / noise**2 * area, basis))
    mean = placed(np.stack(means), batch.device)
    power = np.stack([at_least_a_trifle(each) for each in _gradient_power(entries[:, 0] + entries[:, 1])])
    bands = _bands_of(canvas.shape)
    fit = _fitted(told, cross, right, bands, power)
    prior = _everywhere(fit, bands, batch)
    found, _ = two_layers(
        told.transpose(0, 1)[:, :, None], cross[:, None], right.transpose(0, 1), prior.transpose(0, 1)
    )
    layers = batch.images(found.transpose(0, 1)) + mean
    each = tuple(_known(fit, bands, i, basis, means[i]) for i in range(len(captures)))
    return BatchClosedForm(told, cross, prior, mean, layers, each)


@lru_cache(maxsize=4)
def _bands_of(shape: tuple[int, int]) -> FrequencyBands:
    """Bands of a canvas, which all captures of one size share."""
    return FrequencyBands(*shape)


def _gradient_power(total: Tensor) -> NDArray[np.float64]:
    """Mean squared gradient of images (capture, channel, h, w), (capture, channel)."""
    power = sum(total.diff(dim=axis).square().mean(dim=(-1, -2), dtype=torch.float64) for axis in (-1, -2))
    return np.asarray(torch.as_tensor(power).cpu())


def _entries(batch: CaptureBatch, captures: Sequence[Capture], engines: Sequence[PSE]) -> Tensor:
    """Least-squares entries (capture, entry, channel, h, w) in the photographs' colours."""
    if all(map(all_are_valid, captures)):
        inverse = torch.linalg.pinv(batch.mixing.double()).float()
        flat = torch.matmul(inverse, batch.photographs.flatten(2))
        return flat.reshape(*flat.shape[:2], *batch.photographs.shape[2:])
    # What pixels lack is filled from those around them.
    entries = np.zeros((*batch.mixing.shape[::2], *batch.photographs.shape[2:]), np.float32)
    for i, (capture, engine) in enumerate(zip(captures, engines, strict=True)):
        own = plate_entries(capture, engine)
        entries[i, : len(own)] = own
    return placed(entries, batch.device)


def _normal_equations(transfer: Tensor, precision: Tensor, data: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What spectra (capture, entry, channel, ...) tell of the layers: diagonal, upper entry and right-hand side."""
    weighted = (precision[:, :, :, None, None, None] * transfer.conj()[:, None]).sum(dim=2)
    told = (weighted * transfer).real.sum(dim=1)
    cross = (weighted[:, :, 0] * transfer[:, :, 1]).sum(dim=1)
    right = (weighted[:, :, :, None] * data[:, :, None]).sum(dim=1)
    return told, cross, right


@dataclass(frozen=True)
class _Fit:
    """Spectra of all captures: the power law, the bands' logarithms, and what follows at the sample."""

    power: Tensor
    logarithms: Tensor
    prior: Tensor
    uncertainty: Tensor
    told: Tensor
    cross: Tensor


def _fitted(told: Tensor, cross: Tensor, right: Tensor, bands: FrequencyBands, power: Any) -> _Fit:
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

    level = placed(np.stack([power, power]), device)
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
    return _Fit(level, logarithms, prior, moments(prior)[1], of_each[:, :, 0], off[:, 0].abs().square())


def _everywhere(fit: _Fit, bands: FrequencyBands, batch: CaptureBatch) -> Tensor:
    """Power of every frequency before the photographs are seen, (capture, 2, channel, H, W // 2 + 1)."""
    power, logarithms = fit.power.cpu().numpy(), fit.logarithms.cpu().numpy()
    tables = np.stack([bands.table(float(power[where]), logarithms[where]) for where in np.ndindex(power.shape)])
    entry = placed(bands.entry.astype(np.int64), batch.device)
    everywhere = placed(tables, batch.device)[:, entry]
    return everywhere.reshape(*power.shape, *entry.shape).transpose(0, 1)


def _known(fit: _Fit, bands: FrequencyBands, i: int, basis: Any, mean: Any) -> ClosedForm:
    """The numbers of one capture."""
    told, prior, uncertainty = (x[:, i].cpu().numpy() for x in (fit.told, fit.prior, fit.uncertainty))
    sampled = Knowledge(told, fit.cross[i].cpu().numpy(), prior, bands.share, bands.squared_frequency, basis)
    nothing = np.empty(0, dtype=np.float32)
    return closed_form_of((nothing, mean, nothing, nothing, nothing.astype(np.complex64)), uncertainty, sampled)
