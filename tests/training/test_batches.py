"""Samples made a batch at a time are those that a capture by itself would be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage import data

from polaropt.capture import Capture
from polaropt.capture.files.write import write_png
from polaropt.optics import SceneParameters
from polaropt.simulation import simulated_mosaic
from polaropt.solving import Problem, Weights, conditioned_observation
from polaropt.training.batches import BatchMaker, Kind, Taken
from polaropt.training.pictures import Pictures
from polaropt.training.pool import Kept, SamplePool
from polaropt.training.samples import TrainingData, Variety
from priors.networks.fusionnet import Architecture, SeparationNetwork
from priors.observation import Observation
from priors.training.losses import DECIBEL
from priors.training.trainer import Training, TrainingOptions

KINDS: tuple[Kind, ...] = ("photographs", "grey", "mono", "color")
PLAIN = Variety(
    incidences_deg=(40.0, 70.0),
    noise=(0.004, 0.01),
    thickness_px=(1.0, 5.0),
    other_angles=0,
    other_index=0,
    several_panes=0,
    polarized=0,
)
# Mosaics in colour take seconds each on a processor.
COUNTS: dict[Kind, int] = {"photographs": 2, "grey": 2, "mono": 2, "color": 1}


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Pictures:
    """Two small photographs, and two drawn ones."""
    folder = tmp_path_factory.mktemp("photographs")
    for name, image in (("a", data.astronaut()), ("b", data.coffee())):
        write_png(folder / f"{name}.png", np.ascontiguousarray(image[100:260, 150:330]))
    return Pictures(folder, leaves=2, leaves_share=0.5)


def data_of(pictures: Pictures, variety: Variety, size: int) -> TrainingData:
    return TrainingData(pictures, "conditioned", size, 5, variety=variety)


@pytest.fixture(scope="module")
def maker() -> BatchMaker:
    return BatchMaker(data_of(Pictures(leaves=2, leaves_share=0.5), PLAIN, 64), "cpu", n_scenes=8)


def own_observation(taken: Taken, i: int) -> Observation:
    """What the networks are shown of one of the captures by itself."""
    incidence_deg, azimuth_deg, shift, _ = taken.scenes.seen.numbers[i].tolist()
    seen = taken.seen[i].numpy()
    if taken.kind in ("mono", "color"):
        capture = simulated_mosaic(seen, taken.kind == "color")
    else:
        capture = Capture.of_planes(seen if taken.kind == "photographs" else seen[:, 0], tuple(taken.angles_deg))
    scene = SceneParameters(incidence_deg, azimuth_deg, shift)
    return conditioned_observation(Problem(capture, scene, float(taken.scenes.known_noise[i]), Weights()))


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_seen_of_a_batch_is_what_is_seen_of_each_capture(maker: BatchMaker, kind: Kind) -> None:
    taken = maker.photographed(kind, COUNTS[kind], np.random.default_rng(1))
    together = maker.observed(taken)
    for i in range(COUNTS[kind]):
        alone = own_observation(taken, i)
        for name in ("view_errors", "mixing", "step", "told"):
            np.testing.assert_allclose(getattr(together, name)[i], getattr(alone, name)[0], rtol=1e-3, atol=1e-3)
        # A capture by itself tells its noise and the margin that its ghosts need.
        for name, off in (("views", 2e-3), ("layers", 1e-2), ("unexplained", 0.2)):
            difference = getattr(together, name)[i] - getattr(alone, name)[0]
            assert float(difference.square().mean().sqrt()) < off, name
        np.testing.assert_allclose(together.errors[i], alone.errors[0], rtol=0.5)


def test_a_batch_is_made_of_what_is_photographed(maker: BatchMaker) -> None:
    """The parts of both layers add up to the views, but for the noise and the error of the azimuth."""
    made = maker.make("photographs", 2, np.random.default_rng(2))
    off = (made.parts.sum(dim=2) - made.observation.views).flatten(1).std(dim=1)
    assert bool((off < 1.6 * made.observation.view_errors.mean(dim=1) + 0.004).all())
    assert made.layers.shape == (2, 2, 3, 64, 64)
    assert float(made.layers.min()) >= 0


@pytest.fixture(scope="module")
def maker_of_all(pictures: Pictures) -> BatchMaker:
    variety = Variety(several_panes=0.5, polarized=0.5, other_angles=0.5, other_index=0.5)
    return BatchMaker(data_of(pictures, variety, 32), "cpu", n_scenes=16)


@pytest.mark.parametrize(("kind", "batches"), [("photographs", 6), ("grey", 2), ("mono", 1), ("color", 1)])
def test_all_of_a_variety_can_be_made(maker_of_all: BatchMaker, kind: Kind, batches: int) -> None:
    """Other angles, several panes, polarized light, far ghosts, strong noise: nothing is without bounds."""
    random = np.random.default_rng(3)
    for _ in range(batches):
        seen = maker_of_all.make(kind, COUNTS[kind], random).observation
        for name in ("views", "view_errors", "layers", "errors", "mixing", "step", "unexplained", "told"):
            assert bool(getattr(seen, name).isfinite().all()), name


@pytest.fixture(scope="module")
def pool(pictures: Pictures) -> Iterator[SamplePool]:
    """Of few samples."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("polaropt.training.pool._FIRST", 4.0)
        yield SamplePool(data_of(pictures, PLAIN, 32), "cpu", n_scenes=4, at_a_time=2)


def test_a_training_draws_from_the_newest_samples(pool: SamplePool, tmp_path: Path) -> None:
    network = SeparationNetwork(Architecture(polar_widths=(4, 4, 4), fusion_widths=(8, 8), fusion_blocks=(1, 1)))
    options = TrainingOptions(steps=3, batch_size=2, weights=DECIBEL, test_samples=0, test_every=3)
    log = Training(network, pool, options).run(tmp_path)
    assert np.isfinite(log[-1]["loss"])
    first, second = (pool.batch(step, 2) for step in (3, 4))
    assert not torch.equal(first.layers, second.layers)


def test_samples_without_sense_are_left_out() -> None:
    kept = Kept(5, "cpu")
    layers = torch.tensor([0.5, float("nan"), 100.0, 0.25, 0.75])[:, None]
    errors = torch.tensor([0.1, 0.1, 0.1, 0.1, 1e6])[:, None]
    kept.put({"layers": layers, "errors": errors})
    drawn = kept.drawn(64, np.random.default_rng(0))["layers"]
    assert set(drawn.flatten().tolist()) == {0.5, 0.25}


def test_losses_that_simulate_need_samples_of_processes(pool: SamplePool) -> None:
    batch = pool.batch(0, 2)
    with pytest.raises(ValueError, match="pse"):
        batch.engine(batch.layers)
