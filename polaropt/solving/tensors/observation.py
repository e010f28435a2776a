"""What the networks of `priors` are shown of captures (`polaropt.solving.observation`), for a batch of frames.

Of frames whose pixels are all good, behind flat panes that are seen from far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from polaropt.capture import ANGLES_DEG
from polaropt.inversion import Canvas
from polaropt.numerics import frequencies, opponent_basis
from polaropt.optics import analyzer_matrix, frame_matrix
from polaropt.solving.local_spectra import REACH_PX
from polaropt.solving.observation import LEAST_TOLD, layer_errors
from polaropt.solving.problem import SLOW_IS_TOLD_DEG
from polaropt.solving.tensors.aliases import Mosaic
from polaropt.solving.tensors.batch import CaptureBatch, placed
from polaropt.solving.tensors.closed_form import BatchClosedForm, least_squares, natural_images
from polaropt.solving.tensors.mosaic_closed_form import mosaic_layers, natural_photographs, principal_colors
from polaropt.solving.tensors.objective import BatchMisfit
from polaropt.solving.tensors.windows import expected_layers
from priors.observation import Observation, in_color


@dataclass(frozen=True)
class BatchPanes:
    """Panes of a batch of frames.

    Attributes
    ----------
    taps : Tensor, shape (frame, 2, image, 3)
        Weight of each double image of each layer in the light along and across the plane of incidence, and between.
    places : Tensor, shape (frame, image, 2)
        Columns to the right and rows down.
    numbers : Tensor, shape (frame, 4)
        Incidence and azimuth in degrees, shift of the ghosts in pixels, and 1 where light is polarized by itself.
    """

    taps: Tensor
    places: Tensor
    numbers: Tensor

    def __getitem__(self, index: Tensor) -> BatchPanes:
        return BatchPanes(self.taps[index], self.places[index], self.numbers[index])

    def of_any_light(self) -> BatchPanes:
        """The same before light that may be polarized any way."""
        polarized = torch.ones_like(self.numbers[:, 3:])
        return BatchPanes(self.taps, self.places, torch.cat([self.numbers[:, :3], polarized], dim=1))

    @property
    def sums(self) -> Tensor:
        """Shares of both layers in these entries, all images in place, (frame, 3, 2), in double precision."""
        return self.taps.double().sum(dim=2).mT

    def mixing(self, angles_deg: Sequence[float]) -> Tensor:
        """Photographs from these entries, (frame, k, 3), of unpolarized light of two alone."""
        angles = 2 * torch.deg2rad(torch.tensor(angles_deg, device=self.taps.device) - self.numbers[:, 1, None])
        cos, sin = angles.cos(), angles.sin() * self.numbers[:, 3, None]
        return torch.stack([1 + cos, 1 - cos, sin], dim=2) / 2

    def transfer(self, height: int, width: int) -> Tensor:
        """From the layers to these entries on a periodic frame, (frame, 3, 2, height, width // 2 + 1)."""
        rows, columns = (
            placed(axis.ravel().astype(np.float32), self.taps.device) for axis in frequencies(height, width)
        )
        across, down = (_shifts(self.places[:, :, i, None], axis) for i, axis in enumerate((columns, rows)))
        of_images = self.taps.permute(0, 3, 1, 2)[..., None] * down[:, None, None]
        return of_images.mT @ across[:, None, None]


def _shifts(distance: Tensor, omega: Tensor) -> Tensor:
    """What bilinear shifts along an axis do to each frequency, (..., n)."""
    whole = distance.floor()
    fraction = distance - whole
    return (1 - fraction + fraction * torch.exp(-1j * omega)) * torch.exp(-1j * omega * whole)


@dataclass(frozen=True)
class _Known:
    """A batch with its closed forms, the photographs to see, and what they tell of the layers: a mean (frame, 2), and
    the share of it in each pixel (frame, 2, channel, h, w)."""

    batch: CaptureBatch
    closed_form: BatchClosedForm
    photographs: Tensor
    told: Tensor
    share_told: Tensor


def observed_photographs(
    photographs: Tensor, panes: BatchPanes, noise: Tensor, angles_deg: Sequence[float], canvas: Canvas
) -> Observation:
    """What is seen of full photographs.

    Parameters
    ----------
    photographs : Tensor, shape (frame, k, channel, h, w)
    panes : BatchPanes
        As they are known.
    noise : Tensor, shape (frame,)
        Standard deviation of a photograph's noise (white = 1).
    angles_deg : sequence of float
        Polarizer angle of each photograph.
    canvas : Canvas
        That the layers are found in.
    """
    mixing = panes.mixing(angles_deg)
    basis = placed(opponent_basis(photographs.shape[2]).astype(np.float32), photographs.device)
    precision = (1 / noise)[:, None, None, None, None]
    batch = CaptureBatch(canvas, photographs, precision, mixing, panes.transfer(*canvas.shape), basis)
    known = natural_images(batch, batch.opponent(least_squares(mixing, photographs)), panes.sums, noise)
    squares = (mixing.double() @ panes.sums).square().float()
    told = squares.sum(dim=1) + LEAST_TOLD * squares.mean(dim=(1, 2))[:, None]
    alike = torch.ones_like(photographs[:, :1]).expand(-1, 2, -1, -1, -1)
    return _observed(_Known(batch, known, photographs, told, alike), panes, noise, angles_deg, sampled=False)


def observed_samples(
    samples: Tensor, mosaic: Mosaic, panes: BatchPanes, noise: Tensor, own_noise: Tensor, canvas: Canvas
) -> Observation:
    """What is seen of samples of a mosaic with polarizers at 0, 45, 90 and 135 degrees.

    Parameters
    ----------
    samples : Tensor, shape (frame, h, w)
    mosaic : Mosaic
    panes : BatchPanes
        As they are known.
    noise, own_noise : Tensor, shape (frame,)
        Standard deviation of a sample's noise (white = 1), and as the samples themselves tell it.
    canvas : Canvas
        That the layers are found in; its sides are multiples of the pattern's.
    """
    photographs = natural_photographs(samples, mosaic, ANGLES_DEG, own_noise)
    mixing = panes.mixing(ANGLES_DEG)
    entries = least_squares(mixing, photographs)
    basis = principal_colors(entries[:, 0] + entries[:, 1])[:, None].float()
    has = mosaic.sampled(len(ANGLES_DEG)).float()
    batch = CaptureBatch(
        canvas,
        samples[:, None, None] * has,
        has / noise[:, None, None, None, None],
        mixing,
        panes.transfer(*canvas.shape),
        basis,
    )
    known = mosaic_layers(batch, samples, mosaic, photographs, panes.sums, noise)
    squares = (mixing.double() @ panes.sums).square().float()
    told = torch.einsum("fkl,kchw->flchw", squares, has)
    told = told + LEAST_TOLD * squares.mean(dim=(1, 2))[:, None, None, None, None]
    average = told.mean(dim=(2, 3, 4))
    share = told / average[..., None, None, None]
    return _observed(_Known(batch, known, photographs, average, share), panes, noise, ANGLES_DEG, sampled=True)


def _observed(
    known: _Known, panes: BatchPanes, noise: Tensor, angles_deg: Sequence[float], *, sampled: bool
) -> Observation:
    batch, misfit = known.batch, BatchMisfit(known.batch)
    ones = torch.ones((len(noise), 1, 1), device=noise.device)
    slow_is_known = (panes.numbers[:, 0] > SLOW_IS_TOLD_DEG) & (not sampled)
    form = known.closed_form
    share = placed(form.bands.share, noise.device)
    expected = expected_layers(batch, form, misfit.gradient, ones, slow_is_known.tolist(), sampled=sampled)
    near = panes.numbers[:, 2].abs() <= REACH_PX
    layers = torch.where(near[:, None, None, None, None], expected.layers, form.layers)
    slope = batch.canvas.crop(batch.in_colors(misfit.gradient(layers)))
    azimuth = torch.deg2rad(panes.numbers[:, 1])
    usual = known.told.sqrt() / noise[:, None]
    weights = frame_matrix(0.0)[:2] @ np.linalg.pinv(analyzer_matrix(angles_deg))
    of_views = placed(np.sqrt(np.square(weights).sum(axis=1)).astype(np.float32), noise.device)
    views = least_squares(panes.of_any_light().mixing(angles_deg), known.photographs)[:, :2]
    return Observation(
        views=in_color(views),
        view_errors=noise[:, None] * of_views,
        trusted=torch.ones_like(views[:, :1, :1]),
        layers=in_color(batch.canvas.crop(batch.in_colors(layers))),
        errors=layer_errors((form.fit.uncertainty @ share).transpose(0, 1)),
        mixing=panes.sums[:, :2].float(),
        step=panes.numbers[:, 2, None] * torch.stack([azimuth.cos(), -azimuth.sin()], dim=1),
        unexplained=in_color(-slope / usual[..., None, None, None]),
        told=in_color(known.share_told),
    )
