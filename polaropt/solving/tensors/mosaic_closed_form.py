"""Photographs and closed forms straight from the samples of mosaics, for a batch of frames that one sensor took.

The counterpart of `polaropt.capture.mosaic` and of `polaropt.inversion.mosaic_closed_form`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import conv2d, pad

from polaropt.capture import (
    LEAST_STOKES_POWER,
    MIRRORED_PX,
    STOKES_SAMPLED,
    STOKES_START,
    STOKES_TURNS,
    frame_sides,
    low_pass,
    mirrored_patterns,
    natural_law,
)
from polaropt.inversion import (
    COLORS_BLUR_PX,
    LEAST_LEFT_OPEN,
    SAMPLED_ALIASES,
    SCORING_INERTIA,
    SCORING_LEAST_TOLD,
    SCORING_LONGEST_STEP,
    SCORING_TURNS_LAW,
    SCORING_TURNS_NODES,
    DirectionalBands,
)
from polaropt.numerics import ALWAYS_OPPONENT, LEAST_ENERGY, NATURAL_POWER_LAW, AliasGroups, opponent_basis
from polaropt.optics import analyzer_matrix
from polaropt.solving.tensors.aliases import Mosaic, explained, explained_with_information, groups_of
from polaropt.solving.tensors.batch import CaptureBatch, blurred, mirrored, placed
from polaropt.solving.tensors.closed_form import (
    BatchClosedForm,
    Fit,
    everywhere,
    flat_means,
    initial_power,
    least_squares,
    normal_equations,
)

# Widths of a Gaussian beyond which it is nothing.
_REACH = 4


def natural_photographs(samples: Tensor, mosaic: Mosaic, angles_deg: Sequence[float], noise: Tensor) -> Tensor:
    """`polaropt.capture.mosaic.wiener_photographs` of frames whose samples are all good, (frame, k, channel, h, w).

    Parameters
    ----------
    samples : Tensor, shape (frame, h, w)
    mosaic : Mosaic
    angles_deg : sequence of float
        Polarizer angle of each photograph.
    noise : Tensor, shape (frame,)
        Standard deviation of a sample's noise.
    """
    device, period, k = samples.device, mosaic.sampling.period, len(angles_deg)
    analyzer = placed(analyzer_matrix(angles_deg), device).double()
    basis = placed(opponent_basis(mosaic.sampling.n_channels), device).double()
    to_stokes = torch.linalg.pinv(analyzer)
    level = to_stokes @ mosaic.means(samples, k).double()
    off_level = samples - mosaic.laid_out(analyzer @ level).float()
    rows, columns = (
        (mirrored_patterns(side // period, period)[:, None] * period + np.arange(period)).ravel()
        for side in (mosaic.height, mosaic.width)
    )
    shape = (rows.size, columns.size)
    window = placed(np.outer(*frame_sides((mosaic.height, mosaic.width), shape)).astype(np.float32), device)
    framed = off_level[:, placed(rows, device)][:, :, placed(columns, device)] * window
    data = torch.fft.rfft2(framed, norm="ortho")
    groups = groups_of(*shape, period, STOKES_SAMPLED // period**2, device)
    law = placed(natural_law(*shape), device).double()
    combs = mosaic.combs(analyzer[None], basis[None])
    powers = _initial_powers(samples, mosaic, k, to_stokes, basis)
    share = placed(groups.counts / (groups.counts.sum() * period**2), device)
    of_law, seen = groups.some.of(law), groups.some.of(data)
    for _ in range(STOKES_TURNS):
        found, information = explained_with_information(combs, powers[..., None, None] * of_law, noise, seen)
        mean = torch.einsum("fbst,fbtag,ag->fbsag", powers.to(combs.dtype), found, of_law.to(combs.dtype))
        told = (information.real * (of_law * share)).sum(dim=(-2, -1))
        power = torch.einsum("fbsag,fbuag,ag->fbsu", mean, mean.conj(), (share / of_law).to(combs.dtype)).real
        powers = power + powers - powers @ told @ powers
        powers = (powers + powers.mT) / 2
    of_law = groups.every.of(law)
    found = explained(combs, powers[..., None, None] * of_law, noise, groups.every.of(data))
    stokes = torch.einsum("fbst,fbtag,ag->fbsag", powers.to(combs.dtype), found, of_law.to(combs.dtype))
    whole = torch.fft.irfft2(groups.every.written(stokes, (shape[0], shape[1] // 2 + 1)), s=shape, norm="ortho")
    inside = whole[..., MIRRORED_PX : MIRRORED_PX + mosaic.height, MIRRORED_PX : MIRRORED_PX + mosaic.width]
    images = inside + (basis @ level.mT)[..., None, None]
    return torch.einsum("ks,bc,fbshw->fkchw", analyzer, basis, images).float()


def _initial_powers(samples: Tensor, mosaic: Mosaic, k: int, to_stokes: Tensor, basis: Tensor) -> Tensor:
    """Covariance of the Stokes images (frame, color, 3, 3) per unit of the law, where the fit starts."""
    intensity = torch.einsum("k,fkchw->fchw", to_stokes[0], registered_cells(samples, mosaic, k).double())
    own = torch.einsum("bc,fchw->fbhw", basis, intensity)
    power = sum(own.diff(dim=axis).square().mean(dim=(-1, -2)) for axis in (-1, -2)) + LEAST_STOKES_POWER
    start = torch.tensor(STOKES_START, device=samples.device, dtype=torch.float64)
    return torch.as_tensor(power)[..., None, None] * torch.diag(start)


def registered_cells(samples: Tensor, mosaic: Mosaic, n_photographs: int) -> Tensor:
    """`polaropt.capture.mosaic.registered_cells` of frames whose samples are all good, (frame, k, channel, ...)."""
    period, places = mosaic.sampling.period, mosaic.sampling.places
    shape = (len(samples), n_photographs, mosaic.sampling.n_channels, mosaic.height // period, mosaic.width // period)
    cells, count = samples.new_zeros(shape), np.zeros(shape[1:3])
    for photograph, channel, row, column in places:
        kernel = np.outer(low_pass(row, period), low_pass(column, period)).astype(np.float32)
        reach = len(kernel) // 2
        around = pad(samples[:, None, row::period, column::period], (reach,) * 4, mode="replicate")
        cells[:, photograph, channel] += conv2d(around, placed(kernel, samples.device)[None, None])[:, 0]
        count[photograph, channel] += 1
    return cells / placed(count.astype(np.float32), samples.device)[..., None, None]


def principal_colors(total: Tensor) -> Tensor:
    """`polaropt.numerics.principal_colors` of each of some images (frame, channel, h, w), (frame, channel, channel)."""
    n = total.shape[1]
    basis = placed(opponent_basis(n), total.device).double()
    if n == 1:
        return basis.expand(len(total), 1, 1)
    smooth = blurred(total, COLORS_BLUR_PX, round(_REACH * COLORS_BLUR_PX))
    edges = [smooth.diff(dim=axis).flatten(2).double() for axis in (-2, -1)]
    energy = (edges[0] @ edges[0].mT + edges[1] @ edges[1].mT) / smooth[0, 0].numel()
    always = ALWAYS_OPPONENT * energy.diagonal(dim1=1, dim2=2).sum(dim=1) + LEAST_ENERGY
    order = torch.diag(torch.arange(n, 0, -1, device=total.device, dtype=torch.float64))
    rows: Tensor = torch.linalg.eigh(energy + always[:, None, None] * (basis.T @ order @ basis))[1].mT.flip(1)
    largest = rows.gather(2, rows.abs().argmax(dim=2, keepdim=True))
    return rows * largest.sign()


def mosaic_layers(
    batch: CaptureBatch, samples: Tensor, mosaic: Mosaic, photographs: Tensor, sums: Tensor, noise: Tensor
) -> BatchClosedForm:
    """`polaropt.inversion.mosaic_layers` of frames whose samples are all good.

    Parameters
    ----------
    batch : CaptureBatch
        Its own photographs are not looked at; its basis is `principal_colors` of what follows.
    samples : Tensor, shape (frame, h, w)
    mosaic : Mosaic
    photographs : Tensor, shape (frame, k, channel, h, w)
        They continue the samples beyond the frame.
    sums : Tensor of float64, shape (frame, entry, 2)
        Of all double images' shares in the entries.
    noise : Tensor, shape (frame,)
        Standard deviation of a sample's noise.
    """
    canvas, basis = batch.canvas, batch.basis[:, 0].double()
    entries = batch.opponent(least_squares(batch.mixing, photographs))
    level = entries.mean(dim=(-1, -2))
    on_canvas = Mosaic(mosaic.sampling.moved(-canvas.top, -canvas.left), *canvas.shape, batch.device)
    levels = batch.mixing.double() @ level.double() @ basis
    whole = on_canvas.sample(mirrored(photographs, (canvas.top, canvas.left), (canvas.bottom, canvas.right)))
    canvas.crop(whole)[...] = samples
    whole = whole - on_canvas.laid_out(levels).float()
    data = batch.transformed(whole * placed(canvas.window(), batch.device))
    period = mosaic.sampling.period
    groups = groups_of(*canvas.shape, period, SAMPLED_ALIASES // period**2, batch.device)
    bands = _bands(canvas.shape, period)
    combs = on_canvas.combs(batch.mixing, basis)
    fit = _fitted(combs, groups.some.of(batch.transfer), groups.some.of(data), bands, noise, entries)
    prior = everywhere(fit, bands)
    transfer, power = groups.every.of(batch.transfer).to(combs.dtype), groups.every.of(prior)
    found = explained(combs, _covariance(transfer, power), noise, groups.every.of(data))
    spectra = power * _of_layers(transfer, found)
    precision = (batch.mixing.mT @ batch.mixing) / noise.square()[:, None, None]
    precision = precision / (mosaic.sampling.n_channels * batch.mixing.shape[1])
    nothing = data.new_zeros((len(data), batch.transfer.shape[1], 1, 1, 1))
    told, cross, _ = normal_equations(batch.transfer, precision, nothing)
    mean = flat_means(level, sums, precision * (canvas.height * canvas.width), batch.basis)
    own = groups.every.written(spectra, (canvas.shape[0], canvas.shape[1] // 2 + 1)).to(data.dtype)
    return BatchClosedForm(told, cross, prior, mean, batch.images(own) + mean, fit, bands)


@lru_cache(maxsize=4)
def _bands(shape: tuple[int, int], period: int) -> DirectionalBands:
    """Nodes of the spectra of a canvas."""
    members, counts = AliasGroups(*shape, period).sample(SAMPLED_ALIASES // period**2)
    return DirectionalBands(*shape, members.index.ravel(), np.broadcast_to(counts, members.index.shape).ravel())


def _covariance(transfer: Tensor, power: Tensor) -> Tensor:
    """Covariance (frame, color, entry, entry, alias, group) of entries of layers of a power (frame, 2, color, ...)."""
    n_entries = range(transfer.shape[1])
    rows = [torch.stack([_both(transfer[:, e], transfer[:, m], power) for m in n_entries], dim=2) for e in n_entries]
    return torch.stack(rows, dim=2)


def _both(first: Tensor, second: Tensor, power: Tensor) -> Tensor:
    """Covariance (frame, color, alias, group) of two entries, given the transfers (frame, 2, ...) to them."""
    products = first * second.conj()
    return products[:, 0, None] * power[:, 0] + products[:, 1, None] * power[:, 1]


def _of_layers(transfer: Tensor, entries: Tensor) -> Tensor:
    """Layers (frame, 2, color, alias, group) of which these entries (frame, color, entry, ...) are the transposed."""
    each = transfer.conj()[:, :, :, None] * entries.transpose(1, 2)[:, :, None]
    return each.sum(dim=1)


def _told(transfer: Tensor, information: Tensor) -> Tensor:
    """What is told of each layer, (frame, 2, color, alias, group), by what is told of the entries."""
    n_entries = range(transfer.shape[1])
    each = [
        (transfer[:, e].conj() * transfer[:, m])[:, :, None] * information[:, None, :, e, m]
        for e in n_entries
        for m in n_entries
    ]
    return torch.stack([part.real for part in each]).sum(dim=0)


def _fitted(
    combs: Tensor, transfer: Tensor, data: Tensor, bands: DirectionalBands, noise: Tensor, entries: Tensor
) -> Fit:
    """`fit_directional_spectra` of all frames."""
    device, groups = data.device, data.shape[-2:]
    transfer = transfer.to(combs.dtype)
    law = placed(bands.squared_frequency ** (NATURAL_POWER_LAW / 2), device).double()
    share, weights = placed(bands.share, device).double(), placed(bands.weights, device).double()

    def moments(prior: Tensor) -> tuple[Tensor, Tensor]:
        power = torch.unflatten(prior, -1, groups)
        found, information = explained_with_information(combs, _covariance(transfer, power), noise, data)
        mean = power * _of_layers(transfer, found)
        told = _told(transfer, information)
        left = torch.maximum(power - power * told * power, float(LEAST_LEFT_OPEN) * power)
        return (mean.abs().square() + left).flatten(-2), left.flatten(-2)

    def bounded(step: Tensor) -> Tensor:
        return step.clamp(-SCORING_LONGEST_STEP, SCORING_LONGEST_STEP)

    gradient = initial_power(entries[:, 0] + entries[:, 1])
    level = torch.stack([gradient, gradient], dim=1)
    prior = level[..., None] / law
    for _ in range(SCORING_TURNS_LAW):
        expected, left = moments(prior)
        excess, told = (expected / prior - 1) @ share, (1 - left / prior).square() @ share
        level = level * bounded(excess / told.clamp(min=SCORING_LEAST_TOLD)).exp()
        prior = level[..., None] / law
    logarithms = level.new_zeros((*level.shape, bands.n_nodes))
    size = weights @ share
    for _ in range(SCORING_TURNS_NODES):
        expected, left = moments(prior)
        told = ((1 - left / prior).square() * share) @ weights.T
        information = torch.maximum(told, SCORING_LEAST_TOLD * size) + SCORING_INERTIA
        step = bounded(((expected / prior - 1) * share) @ weights.T / information)
        logarithms = logarithms + step
        prior = prior * (step @ weights).exp()
    left = moments(prior)[1]
    # As those of full photographs: layers first.
    of_all = (level, logarithms, prior, left)
    level, logarithms, prior, left = (x.transpose(0, 1) for x in of_all)
    nothing = level.new_zeros(0)
    return Fit(level, logarithms, prior.float(), left.float(), nothing, nothing)
