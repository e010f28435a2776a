"""Training samples made a batch at a time on a device: as many and as fresh as a GPU takes them.

The same draws as `polaropt.training.samples`, of flat panes whose photographs nothing clips. What is a capture's own
there, its closed form and what windows expect, is worked out of all frames of a batch together, with
`polaropt.solving.tensors`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from polaropt.capture import ANGLES_DEG, sampling_of
from polaropt.inversion import Canvas
from polaropt.optics import PSE, engine_for
from polaropt.simulation import DARKEST
from polaropt.solving import BatchPanes, Mosaic, observed_photographs, observed_samples, placed
from polaropt.training.picture_bank import PictureBank, blur_response
from polaropt.training.samples import (
    BITS,
    ENCODED,
    GAMMA,
    MARGIN,
    NOISE_ERROR,
    OF_MOSAIC,
    OTHER_ANGLES_DEG,
    TrainingData,
    blind_scene,
    in_processes,
    log_uniform,
)
from priors.observation import Observation, in_color
from priors.training.trainer import Batch, no_engine

# Double images that are kept of a pane, the strongest; pixels around a frame that layers are found in; the error of
# the noise that a mosaic's photographs are interpolated with: set by hand.
_N_IMAGES, _MARGIN_PX, _OWN_NOISE_ERROR = 48, 32, 0.05
# Scenes that are drawn once, of which each batch takes some.
N_SCENES = 12000

Kind = Literal["photographs", "grey", "mono", "color"]


@dataclass(frozen=True)
class BatchScenes:
    """Scenes as they are, and as blind estimates have them, with the noise of their photographs, (scene,)."""

    true: BatchPanes
    seen: BatchPanes
    noise: Tensor
    known_noise: Tensor

    def __getitem__(self, index: Tensor) -> BatchScenes:
        return BatchScenes(self.true[index], self.seen[index], self.noise[index], self.known_noise[index])


@dataclass(frozen=True)
class _SceneDraw:
    """Draws a scene by its number; sent to every process."""

    data: TrainingData

    def __call__(self, number: int) -> dict[str, NDArray[np.float32]]:
        """Scenes of raw mosaics have even numbers, those of photographs odd ones."""
        random = np.random.default_rng([self.data.seed, 11, number])
        scene = self.data.flat_scene(random)
        noise = float(log_uniform(self.data.variety.noise, random))
        seen = blind_scene(scene, noise * (1.0 if number % 2 else OF_MOSAIC), random)
        known = noise * float(np.exp(random.normal(0, NOISE_ERROR)))
        there = engine_for(seen, ANGLES_DEG, known, (self.data.side_px, self.data.side_px))
        arrays: dict[str, Any] = {"noise": noise, "known_noise": known}
        for name, engine in (("true", PSE(scene, ANGLES_DEG)), ("seen", there)):
            assert isinstance(engine, PSE)
            arrays |= {f"{name}_{key}": value for key, value in _numbers_of(engine).items()}
        return {name: np.asarray(array, dtype=np.float32) for name, array in arrays.items()}


def _numbers_of(engine: PSE) -> dict[str, NDArray[Any]]:
    """The strongest double images of an engine, the light of the others with the last of them, and its numbers."""
    strength = np.abs(engine.taps).max(axis=(0, 2))
    order = np.argsort(-strength, kind="stable")
    kept = order[:_N_IMAGES]
    taps = np.zeros((2, _N_IMAGES, 3))
    taps[:, : len(kept), : engine.taps.shape[2]] = engine.taps[:, kept]
    taps[:, len(kept) - 1, : engine.taps.shape[2]] += engine.taps[:, order[_N_IMAGES:]].sum(axis=1)
    places = np.zeros((_N_IMAGES, 2))
    places[: len(kept)] = np.array(engine.displacements)[kept]
    return {"taps": taps, "places": places, "numbers": np.array([*engine.scene.values(), engine.taps.shape[2] == 3])}


def batch_scenes(data: TrainingData, device: str, n: int = N_SCENES) -> tuple[BatchScenes, BatchScenes]:
    """So many scenes of photographs and as many of raw mosaics, drawn by the processes of the data."""
    draw = _SceneDraw(data.alone())
    drawn = list(in_processes(draw, range(2 * n), data.workers) if data.workers else map(draw, range(2 * n)))
    there = {name: placed(np.stack([each[name] for each in drawn]), device) for name in drawn[0]}
    true, seen = (
        BatchPanes(*(there[f"{kind}_{key}"] for key in ("taps", "places", "numbers"))) for kind in ("true", "seen")
    )
    both = BatchScenes(true, seen, there["noise"], there["known_noise"])
    numbers = torch.arange(2 * n, device=device)
    return both[numbers[1::2]], both[numbers[::2]]


@dataclass(frozen=True)
class Taken:
    """What a camera made of pictures behind and before panes.

    Attributes
    ----------
    kind : str
        See `Kind`.
    scenes : BatchScenes
    angles_deg : sequence of float
    seen : Tensor
        Photographs (frame, k, channel, h, w), or samples of a mosaic (frame, h, w).
    layers : Tensor, shape (frame, 2, channel, h, w)
    parts : Tensor, shape (frame, view, 2, channel, h, w)
        Of both layers in the views along and across the plane of incidence.
    """

    kind: Kind
    scenes: BatchScenes
    angles_deg: Sequence[float]
    seen: Tensor
    layers: Tensor
    parts: Tensor


class BatchMaker:
    """Makes samples of one kind at a time.

    Parameters
    ----------
    data : TrainingData
        What is drawn from: pictures, variety, side and seed; its processes draw the scenes.
    device : str
    """

    def __init__(self, data: TrainingData, device: str, n_scenes: int = N_SCENES) -> None:
        self._data, self._device, self._side = data, device, data.side_px
        self._bank = PictureBank(data.pictures, data.side_px + 2 * MARGIN, data.seed, device)
        self._of_photographs, self._of_mosaics = batch_scenes(data, device, n_scenes)
        self._noise = torch.Generator(device).manual_seed(data.seed)
        margins = (_MARGIN_PX, _MARGIN_PX)
        self._canvas = Canvas(self._side, self._side, *margins, *margins)
        self._mosaics = {
            kind: Mosaic(sampling_of(kind == "color")[0], self._side, self._side, device) for kind in ("mono", "color")
        }

    def make(self, kind: Kind, n: int, random: np.random.Generator) -> Batch:
        """So many samples."""
        taken = self.photographed(kind, n, random)
        return Batch(self.observed(taken), in_color(taken.layers), in_color(taken.parts), no_engine)

    def photographed(self, kind: Kind, n: int, random: np.random.Generator) -> Taken:
        """Pictures behind and before panes, and what a camera makes of them."""
        is_mosaic = kind in self._mosaics
        pool = self._of_mosaics if is_mosaic else self._of_photographs
        scenes = pool[placed(random.integers(len(pool.noise), size=n), self._device)]
        angles_deg: Sequence[float] = ANGLES_DEG
        if not is_mosaic and random.random() < self._data.variety.other_angles:
            angles_deg = OTHER_ANGLES_DEG[int(random.integers(len(OTHER_ANGLES_DEG)))]
        layers, parts, light = self._through_panes(kind, scenes, angles_deg, random)
        exact = self._mosaics[kind].sample(light) if is_mosaic else light
        return Taken(kind, scenes, angles_deg, self._read(exact, scenes.noise), layers, parts)

    def observed(self, taken: Taken) -> Observation:
        """What the networks are shown of it."""
        panes, noise = taken.scenes.seen, taken.scenes.known_noise
        if taken.kind not in self._mosaics:
            return observed_photographs(taken.seen, panes, noise, taken.angles_deg, self._canvas)
        # As exactly as a mosaic tells its noise.
        off = torch.randn(noise.shape, device=self._device, generator=self._noise)
        own_noise = taken.scenes.noise * torch.exp(_OWN_NOISE_ERROR * off)
        return observed_samples(taken.seen, self._mosaics[taken.kind], panes, noise, own_noise, self._canvas)

    def _through_panes(
        self, kind: Kind, scenes: BatchScenes, angles_deg: Sequence[float], random: np.random.Generator
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Layers, parts and exact photographs of pictures behind and before the panes."""
        n = len(scenes.noise)
        frames = torch.unflatten(self._bank.frames(2 * n, random, self._noise), 0, (n, 2))
        encoded = random.random(n) < ENCODED
        brightness = log_uniform(self._data.variety.exposure, random, (n, 2)).astype(np.float32)
        layers = torch.where(placed(encoded, self._device)[:, None, None, None, None], frames, frames**GAMMA)
        layers = layers * placed(brightness, self._device)[..., None, None, None]
        if kind in ("grey", "mono"):
            layers = layers.mean(dim=2, keepdim=True)
        spectra = torch.fft.rfft2(layers)
        side = layers.shape[-1]
        if kind in self._mosaics:
            blur = placed(random.uniform(*self._data.variety.lens_blur_px, n).astype(np.float32), self._device)
            spectra = spectra * blur_response(blur[:, None, None], side)[:, None, None]
            layers = torch.fft.irfft2(spectra, s=(side, side))
        transfer = scenes.true.transfer(side, side)
        each = self._inside(torch.fft.irfft2(transfer[:, :, :, None] * spectra[:, None], s=(side, side)))
        mixing = scenes.true.mixing(angles_deg)
        entries = each.sum(dim=2)
        light = torch.unflatten(mixing @ entries.flatten(2), 2, entries.shape[2:])
        return self._inside(layers), each[:, :2], light

    def _inside(self, images: Tensor) -> Tensor:
        return images[..., MARGIN:-MARGIN, MARGIN:-MARGIN]

    def _read(self, light: Tensor, noise: Tensor) -> Tensor:
        """What a sensor stores of light (frame, ...)."""
        white = 2**BITS - 1
        drawn = torch.randn(light.shape, device=light.device, generator=self._noise)
        noisy: Tensor = light + noise.reshape(-1, *[1] * (light.ndim - 1)) * drawn
        steps = (noisy * white).round().clamp(math.ceil(DARKEST * white), white)
        read: Tensor = steps / white
        return read
