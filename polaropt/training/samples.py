"""Training samples on the fly: random pictures behind random panes, photographed, with the truth."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from polaropt.capture import ANGLES_DEG, SMALLEST_SIDE, Capture, sampling_of
from polaropt.errors import InputError
from polaropt.optics import (
    PSE,
    SceneParameters,
    VaryingPSE,
    analyzer_matrix,
    change_basis,
    ghost_step,
    ghosts_that_matter,
)
from polaropt.simulation import digitized, exact_engine, simulated_mosaic
from polaropt.solving import Problem, Weights, conditioned_observation, plain_observation, plate_views
from polaropt.training.pictures import LEAST_SPREAD, Pictures

if TYPE_CHECKING:
    from priors.networks.fusionnet import Form
    from priors.training.engines import ShiftedSum
    from priors.training.trainer import Sample


# Samples that each process works ahead: a batch or two; changes nothing.
_AHEAD = 8


def in_processes(sample: Callable[[int], Any], numbers: Sequence[int], workers: int) -> Iterator[Any]:
    """What `sample` makes of each number, in their order.

    Parameters
    ----------
    sample : callable
        Sent to every process.
    numbers : sequence of int
    workers : int
        Processes; each works up to 8 samples ahead.
    """
    from torch.utils.data import DataLoader

    loader: DataLoader[Any] = DataLoader(
        _Numbered(sample),  # type: ignore[arg-type]
        batch_size=None,
        sampler=numbers,
        num_workers=workers,
        prefetch_factor=_AHEAD,
        collate_fn=_as_it_is,
        worker_init_fn=_one_thread,
        # A process with threads of its own, or with a GPU, must not be forked.
        multiprocessing_context="spawn",
    )
    return iter(loader)


class _Numbered:
    """What torch's loader asks for its items."""

    def __init__(self, sample: Callable[[int], Any]) -> None:
        self._sample = sample

    def __getitem__(self, number: int) -> Any:
        return self._sample(number)


def _as_it_is(sample: Any) -> Any:
    return sample


def _one_thread(_: int) -> None:
    """As many processes as cores must not have as many threads each; torch sees to its own."""
    import numba
    from threadpoolctl import threadpool_limits

    os.environ["OMP_NUM_THREADS"] = "1"
    numba.set_num_threads(1)
    threadpool_limits(1)


Images = NDArray[np.float32]

PAPER_INCIDENCES_DEG = (10.0, 40.0, 60.0, 70.0, 80.0, 85.0)
# Pixels around a frame from which ghosts bring light. What follows was set by hand.
MARGIN = 56
OTHER_ANGLES_DEG = ((0.0, 60.0, 120.0), (20.0, 65.0, 110.0, 155.0), (0.0, 30.0, 60.0, 90.0, 120.0, 150.0))
# Depth of the photographs, as of a camera's raw file; share of the pictures whose values are taken for light as they
# are, and the gamma by which the others are linearized; error of a noise that is measured, as a share.
BITS, ENCODED, GAMMA, NOISE_ERROR = 12, 0.6, 2.2, 0.02
# Share of the first ghost, below which ghosts are put to the last one that is kept.
_FAINT_GHOST = 0.01
# Errors of a raw mosaic's blind scene in those of four photographs, and the most in those at usual noise: set by hand.
OF_MOSAIC, _WORST = 2.5, 3.0
# Incidences at the middle of a wide lens's frame.
_WIDE_DEG = (30.0, 65.0)
# Share of sensors without colour; side of the larger pattern, that of colours.
_MONO_MOSAICS, PATTERN_PX = 0.5, 4


@dataclass(frozen=True)
class Variety:
    """What is drawn at random; each sample draws all of it anew.

    Parameters
    ----------
    incidences_deg : (float, float)
        Range that half of the samples come from; the others have one of the paper's incidences.
    noise : (float, float)
        Standard deviation of a photograph's noise (white = 1), equally likely in its logarithm.
    thickness_px : (float, float)
        Of the pane; a fifth of the panes show no ghosts beside their origin.
    exposure : (float, float)
        Brightness of a layer's white, equally likely in its logarithm.
    overexposed, grey, other_angles, other_index, several_panes : float
        Share of samples with clipped highlights, without colour, with other polarizer angles than 0, 45, 90 and 135
        degrees, with another index than 1.5, and behind two or three panes.
    polarized, wide : float
        Share of samples whose light from behind or before the pane is polarized, and of those seen through a wide lens.
    mosaics : float
        Share of raw mosaics of a polarization camera, half of them of colour sensors; for the conditioned form alone,
        and for frames of whole patterns, 64 px or more.
    gap_px : (float, float)
        From a pane to the next.
    lens_blur_px : (float, float)
        What a mosaic's lens makes of a point.
    view_deg : (float, float)
        Of a wide lens, along the frame's side.
    """

    incidences_deg: tuple[float, float] = (6.0, 87.0)
    noise: tuple[float, float] = (0.001, 0.06)
    thickness_px: tuple[float, float] = (1.0, 13.0)
    exposure: tuple[float, float] = (0.35, 1.0)
    overexposed: float = 0.12
    grey: float = 0.08
    other_angles: float = 0.1
    other_index: float = 0.15
    several_panes: float = 0.08
    polarized: float = 0.08
    wide: float = 0.04
    mosaics: float = 0.5
    gap_px: tuple[float, float] = (2.0, 14.0)
    lens_blur_px: tuple[float, float] = (0.0, 0.9)
    view_deg: tuple[float, float] = (15.0, 50.0)


def log_uniform(limits: tuple[float, float], random: np.random.Generator, size: Any = None) -> Any:
    """Numbers that are equally likely in their logarithm between two limits."""
    low, high = np.log(limits)
    return np.exp(random.uniform(low, high, size))


_NONE = Pictures(leaves=0, leaves_share=0.0)


class TrainingData:
    """Samples by number.

    Parameters
    ----------
    pictures : Pictures
    form : {"paper", "conditioned"}
    size : int
        Side of the square frames.
    seed : int
        With a sample's number it decides everything.
    variety : Variety
    workers : int
        Processes that make samples ahead; 0 makes each as it is taken. The samples are the same.
    """

    def __init__(
        self,
        pictures: Pictures,
        form: Form,
        size: int = 128,
        seed: int = 0,
        *,
        variety: Variety | None = None,
        workers: int = 0,
    ) -> None:
        if size < 32:
            raise InputError(f"training frames of {size} px; give 32 or more")
        self.pictures, self._form, self.side_px, self.seed = pictures, form, size, seed
        self.variety, self.workers = variety or Variety(), workers
        whole = size % PATTERN_PX == 0 and size >= SMALLEST_SIDE * PATTERN_PX
        self.takes_mosaics = form == "conditioned" and whole

    def alone(self) -> TrainingData:
        """The same, without its pictures and processes: to draw scenes with."""
        return TrainingData(_NONE, self._form, self.side_px, self.seed, variety=self.variety)

    def of(self, variety: Variety) -> TrainingData:
        """The same, of another variety."""
        return TrainingData(self.pictures, self._form, self.side_px, self.seed, variety=variety, workers=self.workers)

    def samples(self, numbers: Sequence[int]) -> Iterator[Sample]:
        """Samples in the order of these numbers."""
        if self.workers:
            return in_processes(self.sample, numbers, self.workers)
        return map(self.sample, numbers)

    def sample(self, number: int) -> Sample:
        """Sample `number`, always the same."""
        random = np.random.default_rng([self.seed, number])
        mosaic = self.takes_mosaics and random.random() < self.variety.mosaics
        layers = self._layers(random, _MONO_MOSAICS if mosaic else self.variety.grey)
        scene = self._scene(random)
        if mosaic:
            layers = gaussian_filter(layers, random.uniform(*self.variety.lens_blur_px), axes=(-2, -1))
        angles_deg = ANGLES_DEG if mosaic else self._angles(random)
        noise = float(log_uniform(self.variety.noise, random))
        components = exact_engine(scene, angles_deg).components(layers)
        light = components[0] + components[1]
        if random.random() < self.variety.overexposed:
            gain = np.float32(1 / np.quantile(light, random.uniform(0.95, 0.995)))
            layers, components, light = layers * gain, components * gain, light * gain
        truth, parts, light = self._inside(layers), self._inside(components), self._inside(light)
        if mosaic:
            capture = _mosaic_of(light, noise, random)
        else:
            photographs = digitized(light + noise * random.standard_normal(light.shape), BITS)
            capture = Capture.of_planes(photographs, angles_deg)
        if self._form == "paper":
            return _plain_sample(capture, noise, scene, truth, parts)
        seen = blind_scene(scene, noise * (OF_MOSAIC if mosaic else 1.0), random)
        measured = noise * float(np.exp(random.normal(0, NOISE_ERROR)))
        return _conditioned_sample(capture, measured, (scene, seen), truth, parts)

    def _layers(self, random: np.random.Generator, grey_share: float) -> Images:
        """Two pictures (2, channel, h, w) with margins, encoded or linear, of random brightness; a share is grey."""
        frames = []
        encoded = random.random() < ENCODED
        for _ in range(2):
            frame = self._frame(random)
            frames.append(log_uniform(self.variety.exposure, random) * (frame if encoded else frame**GAMMA))
        layers = np.moveaxis(np.stack(frames), -1, 1).astype(np.float32)
        grey = random.random() < grey_share
        return np.ascontiguousarray(layers.mean(axis=1, keepdims=True) if grey else layers)

    def _frame(self, random: np.random.Generator) -> Images:
        """A frame in which there is something to see."""
        size = self.side_px + 2 * MARGIN
        frame = self.pictures.frame(size, random)
        for _ in range(3):
            if frame.std() >= LEAST_SPREAD:
                break
            frame = self.pictures.frame(size, random)
        return frame

    def _scene(self, random: np.random.Generator) -> SceneParameters:
        low, high = self.variety.incidences_deg
        paper = random.random() < 0.5
        incidence = float(random.choice(PAPER_INCIDENCES_DEG) if paper else random.uniform(low, high))
        index = float(random.uniform(1.33, 1.7)) if random.random() < self.variety.other_index else 1.5
        thickness = 10.0 if paper and random.random() < 0.5 else random.uniform(*self.variety.thickness_px)
        kind: Any = "paper" if random.random() < 0.7 else "plate"
        shift = float(random.choice([-1, 1])) * ghost_step(incidence, index, float(thickness), kind)
        azimuth = float(random.uniform(0, 180))
        scene = SceneParameters(incidence, azimuth, 0.0 if random.random() < 0.2 else shift, index)
        scene = self._in_other_light(scene, random)
        if random.random() >= self.variety.several_panes:
            return scene
        gap = float(np.copysign(random.uniform(*self.variety.gap_px), shift))
        return scene.replace(n_panes=int(random.choice([2, 2, 3])), gap_shift=gap, focal_px=None)

    def _in_other_light(self, scene: SceneParameters, random: np.random.Generator) -> SceneParameters:
        """The same with polarized light, or through a wide lens."""
        drawn, angle_deg = random.random(), float(random.uniform(0, 180))
        if drawn < self.variety.polarized:
            light = (float(random.uniform(0.1, 0.6)), angle_deg)
            if random.random() < 0.5:
                return scene.replace(transmission_polarization=light)
            return scene.replace(reflection_polarization=light)
        # Of a wide lens the incidence varies: that at the middle leaves room for both sides.
        if drawn < self.variety.polarized + self.variety.wide and _WIDE_DEG[0] <= scene.values()[0] <= _WIDE_DEG[1]:
            view = math.radians(float(random.uniform(*self.variety.view_deg)))
            return scene.replace(focal_px=self.side_px / (2 * math.tan(view / 2)))
        return scene

    def flat_scene(self, random: np.random.Generator) -> SceneParameters:
        """A scene of the variety, but seen from far."""
        return self._scene(random).replace(focal_px=None)

    def _angles(self, random: np.random.Generator) -> tuple[float, ...]:
        if random.random() >= self.variety.other_angles:
            return ANGLES_DEG
        return OTHER_ANGLES_DEG[int(random.integers(len(OTHER_ANGLES_DEG)))]

    def _inside(self, images: NDArray[Any]) -> NDArray[Any]:
        return np.ascontiguousarray(images[..., MARGIN:-MARGIN, MARGIN:-MARGIN])


def _mosaic_of(light: Images, noise: float, random: np.random.Generator) -> Capture:
    """What a polarization camera's sensor stores of exact photographs (4, channel, h, w), as it is read."""
    color = light.shape[1] > 1
    sampling, _ = sampling_of(color)
    raw = sampling.sample(light)
    raw = digitized(raw + noise * random.standard_normal(raw.shape), BITS).astype(np.float32)
    return simulated_mosaic(raw, color)


def blind_scene(scene: SceneParameters, noise: float, random: np.random.Generator) -> SceneParameters:
    """The scene as a blind estimate might have it: most uncertain near normal incidence and under strong noise."""
    incidence, azimuth, shift = scene.values()
    size = min(_WORST, noise / 0.005) * float(random.choice([0.0, 1.0, 1.0]))
    # The errors of the blind estimates on the paper's protocol.
    incidence_error = size * (0.15 + 1.2 * np.exp(-((incidence / 25) ** 2)))
    azimuth_error = size * (0.05 + 0.8 * np.exp(-((incidence / 20) ** 2)))
    found = incidence + incidence_error * float(np.clip(random.normal(), -2.5, 2.5))
    return scene.replace(
        incidence_deg=float(np.clip(found, 4, 88)),
        azimuth_deg=azimuth + azimuth_error * float(random.normal()),
        ghost_shift=shift + size * 0.06 * float(random.normal()) if shift else 0.0,
    )


def _conditioned_sample(
    capture: Capture, noise: float, scenes: tuple[SceneParameters, SceneParameters], truth: Images, parts: Images
) -> Sample:
    """A sample whose truth belongs to the first scene, and whose closed form takes the second for true."""
    import torch

    from priors.observation import in_color
    from priors.training.trainer import Sample

    problem = Problem(capture, scenes[1], noise, Weights())
    true = _engine(scenes[0], capture.angles_deg)
    inverse = np.asarray(np.linalg.pinv(analyzer_matrix(capture.angles_deg)), dtype=np.float64)
    views = [plate_views(change_basis(inverse, part), true) for part in parts]
    return Sample(
        conditioned_observation(problem),
        in_color(torch.from_numpy(truth))[None],
        in_color(torch.from_numpy(np.ascontiguousarray(np.stack(views, axis=1))))[None],
        PlateEngine(true),
    )


@dataclass(frozen=True)
class PlateEngine:
    """An engine whose views are those along and across the plane of incidence."""

    pse: PSE | VaryingPSE

    def __call__(self, both: Any) -> Any:
        """Views (2, 3, h, w) of layers (2, 3, h, w)."""
        if isinstance(self.pse, PSE):
            return self.pse.entries(both)[:2]
        to_stokes = np.asarray(np.linalg.pinv(self.pse.analyzer), dtype=np.float64)
        return plate_views(change_basis(to_stokes, self.pse.forward(both)), self.pse)


def _engine(scene: SceneParameters, angles_deg: tuple[float, ...]) -> PSE | VaryingPSE:
    """The engine for a loss: what the faintest ghosts carry is added to the last one kept."""
    if scene.varies:
        return exact_engine(scene, angles_deg)
    return PSE(scene, angles_deg, n_ghosts=ghosts_that_matter(scene, _FAINT_GHOST))


def shifted_sum(engine: PSE) -> ShiftedSum:
    """An engine of one scene as the shifted layers that its photographs are sums of."""
    from priors.training.engines import ShiftedSum

    weights = np.einsum("ve,lge->gvl", engine.mixing[:, : engine.taps.shape[2]], engine.taps)
    return ShiftedSum(np.array(engine.displacements, dtype=np.float32), weights.astype(np.float32))


def _plain_sample(capture: Capture, noise: float, scene: SceneParameters, truth: Images, parts: Images) -> Sample:
    import torch

    from priors.observation import in_color
    from priors.training.trainer import Sample

    to_views = analyzer_matrix(ANGLES_DEG) @ np.linalg.pinv(analyzer_matrix(capture.angles_deg))
    views = np.stack([change_basis(to_views, part) for part in parts], axis=1)
    engine = _engine(scene, ANGLES_DEG)
    return Sample(
        plain_observation(capture, noise, scene.index),
        in_color(torch.from_numpy(truth))[None],
        in_color(torch.from_numpy(np.ascontiguousarray(views)))[None],
        shifted_sum(engine) if isinstance(engine, PSE) else engine.forward,
    )
