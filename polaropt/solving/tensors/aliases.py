"""Frequencies that a mosaic mixes (`polaropt.numerics.aliases`), for a batch of frames that one sensor took.

A group of aliases is one small system: those of all frames and groups are solved together, in double precision, which
on a device costs no more than to keep positive what rounding leaves of single precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from polaropt.numerics import AliasGroups, alias_steps
from polaropt.optics import Sampling
from polaropt.solving.tensors.batch import placed


class Mosaic:
    """A sensor's pattern on frames of one size.

    Parameters
    ----------
    sampling : Sampling
        Of the frame's first pixel on.
    height, width : int
        Whole patterns.
    device : str or torch.device
    """

    def __init__(self, sampling: Sampling, height: int, width: int, device: Any) -> None:
        self.sampling, self.height, self.width, self.device = sampling, height, width, device
        period = sampling.period
        own = np.array(sampling.photographs) * sampling.n_channels + np.array(sampling.channels)
        self._of_pixel = placed(np.tile(own, (height // period, width // period)), device)

    def sample(self, images: Tensor) -> Tensor:
        """Samples (frame, h, w) of photographs (frame, k, channel, h, w)."""
        planes = images.flatten(1, 2)
        samples: Tensor = planes.gather(1, self._of_pixel.expand(len(planes), 1, -1, -1))[:, 0]
        return samples

    def laid_out(self, values: Tensor) -> Tensor:
        """Values (frame, k, channel) where they are sampled, (frame, h, w)."""
        laid: Tensor = values.flatten(1)[:, self._of_pixel]
        return laid

    def sampled(self, n_photographs: int) -> Tensor:
        """Which photograph and colour a pixel has, (k, channel, h, w)."""
        planes = torch.arange(n_photographs * self.sampling.n_channels, device=self.device)
        return torch.unflatten(planes[:, None, None] == self._of_pixel, 0, (n_photographs, -1))

    def means(self, samples: Tensor, n_photographs: int) -> Tensor:
        """Mean of each photograph and colour, (frame, k, channel), of samples (frame, h, w)."""
        here = self.sampled(n_photographs).flatten(2).float()
        return (here @ samples.flatten(1).T).permute(2, 0, 1) / here.sum(dim=-1)

    def combs(self, mixing: Tensor, basis: Tensor) -> Tensor:
        """`AliasGroups.combs` of each frame, (frame, color, entry, measured, true), in double precision.

        Parameters
        ----------
        mixing : Tensor, shape (frame, k, entry)
        basis : Tensor, shape (frame, color, channel)
        """
        period = self.sampling.period
        photographs, channels = (
            placed(np.ravel(pattern), self.device) for pattern in (self.sampling.photographs, self.sampling.channels)
        )
        weights = mixing[:, photographs].mT[:, None] * basis[:, :, channels][:, :, None]
        lines = torch.fft.fft2(torch.unflatten(weights.double(), -1, (period, period))).flatten(-2) / period**2
        combs: Tensor = lines[..., placed(alias_steps(period), self.device)]
        return combs


@dataclass(frozen=True)
class Groups:
    """Where the members (alias, group) of groups stand in a half spectrum, see `polaropt.numerics.Members`."""

    index: Tensor
    is_mirrored: Tensor
    is_own: Tensor

    def of(self, spectra: Tensor) -> Tensor:
        """Values (..., alias, group) of half spectra (..., H, W // 2 + 1)."""
        return self._conjugated(spectra.flatten(-2)[..., self.index])

    def written(self, values: Tensor, shape: tuple[int, int]) -> Tensor:
        """Half spectra (..., *shape) of values (..., alias, group) of all groups."""
        spectra = values.new_zeros((*values.shape[:-2], shape[0] * shape[1]))
        spectra[..., self.index[self.is_own]] = self._conjugated(values)[..., self.is_own]
        return torch.unflatten(spectra, -1, shape)

    def _conjugated(self, values: Tensor) -> Tensor:
        return torch.where(self.is_mirrored, values.conj(), values) if values.is_complex() else values


@dataclass(frozen=True)
class GroupsOfFrame:
    """All groups of a frame, some that stand for them, and for how many groups each of those does, (group,)."""

    every: Groups
    some: Groups
    counts: NDArray[np.float64]


@lru_cache(maxsize=8)
def groups_of(height: int, width: int, period: int, n: int, device: Any) -> GroupsOfFrame:
    """Groups of a frame, about n of which stand for all as of `AliasGroups.sample`."""
    groups = AliasGroups(height, width, period)
    some, counts = groups.sample(n)
    every = groups.members(*(grid.ravel() for grid in np.mgrid[: groups.n_rows, : groups.n_columns]))
    all_groups, some_groups = (
        Groups(*(placed(part, device) for part in (members.index, members.mirrored, members.own)))
        for members in (every, some)
    )
    return GroupsOfFrame(all_groups, some_groups, counts)


def explained(combs: Tensor, power: Tensor, noise: Tensor, data: Tensor) -> Tensor:
    """`polaropt.numerics.explained_groups` of each frame: the mean, (frame, color, entry, alias, group).

    Parameters
    ----------
    combs : Tensor, shape (frame or 1, color, entry, measured, true)
    power : Tensor, shape (frame, color, entry, entry, true, group)
    noise : Tensor, shape (frame,)
        Standard deviation of a sample's noise.
    data : Tensor, shape (frame, measured, group)
    """
    return _of_inverse(combs, _inverse_covariance(combs, power, noise), data)


def explained_with_information(combs: Tensor, power: Tensor, noise: Tensor, data: Tensor) -> tuple[Tensor, Tensor]:
    """The same with it: mean (frame, color, entry, alias, group), information (frame, color, entry, entry, ...)."""
    inverse = _inverse_covariance(combs, power, noise)
    # What is told needs no more than single precision.
    n_entries, ahead = combs.shape[2], combs[:, :, :, None].to(torch.complex64)
    told = [inverse[:, None].to(torch.complex64) @ ahead[:, :, f] for f in range(n_entries)]
    information = torch.stack(
        [
            torch.stack([(ahead[:, :, e].conj() * told[f]).sum(dim=-2).mT for f in range(n_entries)], dim=2)
            for e in range(n_entries)
        ],
        dim=2,
    )
    return _of_inverse(combs, inverse, data), information


def _of_inverse(combs: Tensor, inverse: Tensor, data: Tensor) -> Tensor:
    """Mean (frame, color, entry, alias, group)."""
    right = inverse @ data.to(combs.dtype).mT[..., None]
    return (combs[:, :, :, None].mH @ right[:, None, None])[..., 0].mT


def _inverse_covariance(combs: Tensor, power: Tensor, noise: Tensor) -> Tensor:
    """Inverse covariance (frame, group, measured, measured) of the samples of each group."""
    n = combs.shape[-1]
    power = power.to(combs.dtype).movedim(-1, 1)
    covariance = torch.eye(n, dtype=combs.dtype, device=combs.device) * noise.double().square()[:, None, None, None]
    for c in range(combs.shape[1]):
        for f in range(combs.shape[2]):
            left = [combs[:, c, e, None] * power[:, :, c, e, f, None, :] for e in range(combs.shape[2])]
            covariance = covariance + torch.stack(left).sum(dim=0) @ combs[:, c, f, None].mH
    return _inverse(covariance)


def _inverse(matrices: Tensor) -> Tensor:
    """Inverse of positive definite matrices (..., n, n) by Gauss and Jordan, all at once a column at a time.

    With it and without Cholesky's factors an H200 makes 64 samples of mono mosaics in 0.2 s instead of 0.37 s.
    """
    left = matrices.clone()
    for j in range(matrices.shape[-1]):
        pivot = 1 / left[..., j, j, None]
        row, column = left[..., j, :] * pivot, left[..., :, j].clone()
        row[..., j] = pivot[..., 0]
        column[..., j] = 0
        left[..., :, j] = 0
        left = left - column[..., None] * row[..., None, :]
        left[..., j, :] = row
    return left
