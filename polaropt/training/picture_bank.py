"""Pictures on a device, of which many parts are cut at once."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from polaropt.numerics import frequencies
from polaropt.solving import placed
from polaropt.training.pictures import (
    GRAIN,
    GRAIN_IN_COLOR,
    GRAIN_PX,
    GRAINY,
    LEAST_SPREAD,
    SCALES,
    Pictures,
)
from polaropt.training.samples import log_uniform

# Sizes that each picture is reduced to once, and parts that are drawn beyond those wanted, since in some there is
# nothing to see: set by hand.
_N_SIZES, _SPARE = 6, 0.25


class PictureBank:
    """Every picture in some sizes, in bytes.

    Parameters
    ----------
    pictures : Pictures
    side_px : int
        Of the parts.
    seed : int
        Of the sizes.
    device : str
    """

    def __init__(self, pictures: Pictures, side_px: int, seed: int, device: str) -> None:
        self._side, self._device = side_px, device
        random = np.random.default_rng([seed, 13])
        planes, shapes, shares = [], [], []
        for picture, share in pictures.all():
            whole = torch.from_numpy(picture).to(device).permute(2, 0, 1)[None].float()
            for scale in random.uniform(*SCALES, _N_SIZES):
                reduced = _reduced(whole, max(float(scale), side_px / min(picture.shape[:2])), side_px)
                shapes.append(reduced.shape[1:])
                planes.append(reduced.flatten())
                shares.append(share / _N_SIZES)
        sizes = np.array([each.numel() for each in planes])
        self._values = torch.cat(planes)
        self._first, self._shapes = np.cumsum(sizes) - sizes, np.array(shapes)
        self._shares = np.array(shares) / np.sum(shares)

    def frames(self, n: int, random: np.random.Generator, noise: torch.Generator) -> Tensor:
        """Parts (n, 3, side, side) in which something shows, 0 to 1; turned, mirrored and grainy at random."""
        frames = self._cut(n + round(_SPARE * n), random)
        shows = frames.flatten(1).std(dim=1) >= LEAST_SPREAD
        frames = frames[torch.argsort(~shows, stable=True)[:n]]
        return self._with_grain(frames, random, noise)

    def _cut(self, n: int, random: np.random.Generator) -> Tensor:
        chosen = random.choice(len(self._shares), size=n, p=self._shares)
        height, width = self._shapes[chosen].T
        side = np.arange(self._side)
        top, left = (
            np.floor(random.random(n) * (extent - self._side + 1)).astype(np.int64) for extent in (height, width)
        )
        rows, columns = (np.where(random.random(n)[:, None] < 0.5, side, side[::-1]) for _ in range(2))
        # Steps in memory from row to row and column to column; transposed pictures exchange them.
        is_transposed = random.random(n)[:, None] < 0.5
        down, across = (top[:, None] + rows) * width[:, None], left[:, None] + columns
        first, second = np.where(is_transposed, across, down), np.where(is_transposed, down, across)
        colors = random.permuted(np.tile(np.arange(3), (n, 1)), axis=1) * (height * width)[:, None]
        there = [placed(part, self._device) for part in (self._first[chosen][:, None] + colors, first, second)]
        index = there[0][:, :, None, None] + there[1][:, None, :, None] + there[2][:, None, None, :]
        return self._values[index].float() / 255

    def _with_grain(self, frames: Tensor, random: np.random.Generator, noise: torch.Generator) -> Tensor:
        n, channels, side = frames.shape[:3]
        grainy = random.random(n) < GRAINY
        strength = np.where(grainy, log_uniform(GRAIN, random, n), 0)
        in_color, reach = random.uniform(*GRAIN_IN_COLOR, n), random.uniform(*GRAIN_PX, n)
        numbers = np.stack([strength, in_color, reach]).astype(np.float32)
        strength, in_color, reach = placed(numbers, self._device)[..., None, None, None]
        grey, color = (
            torch.randn((n, count, side, side), device=self._device, generator=noise) for count in (1, channels)
        )
        grain = (1 - in_color.square()).sqrt() * grey + in_color * color
        spectra = torch.fft.rfft2(grain) * blur_response(reach, side)
        grain = torch.fft.irfft2(spectra, s=(side, side))
        spread = grain.flatten(1).std(dim=1)[:, None, None, None]
        return torch.where(strength > 0, (frames + strength / spread * grain).clamp(0, 1), frames)


def blur_response(sigma_px: Tensor, side: int) -> Tensor:
    """What Gaussians (..., 1, 1) do to the frequencies of square images, (..., side, side // 2 + 1)."""
    rows, columns = frequencies(side, side)
    return torch.exp(-0.5 * sigma_px.square() * placed((rows**2 + columns**2).astype(np.float32), sigma_px.device))


def _reduced(whole: Tensor, scale: float, least: int) -> Tensor:
    """A picture (1, 3, h, w) at another size, in bytes, (3, h, w)."""
    size = [max(least, round(scale * side)) for side in whole.shape[-2:]]
    small = interpolate(whole, size=size, mode="bilinear", antialias=True, align_corners=False)
    return small[0].round().clamp(0, 255).byte()
