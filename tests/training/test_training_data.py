"""Training samples: always the same, and true to the engine."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from skimage import data

from polaropt.capture import ANGLES_DEG
from polaropt.capture.files.write import write_png
from polaropt.errors import InputError
from polaropt.optics import PSE, SceneParameters, VaryingPSE
from polaropt.simulation.leaves import dead_leaves
from polaropt.training.pictures import Pictures
from polaropt.training.samples import TrainingData, Variety, shifted_sum
from priors.networks.fusionnet import Form
from priors.training.engines import BatchEngine, ShiftedSum
from priors.training.trainer import Sample

FORMS: tuple[Form, ...] = get_args(Form)
PLAIN = Variety(overexposed=0, grey=0, other_angles=0, mosaics=0, several_panes=0, polarized=0, wide=0)
MOSAICS = replace(PLAIN, mosaics=1)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Pictures:
    """Two small photographs of a folder."""
    folder = tmp_path_factory.mktemp("photographs")
    for name, image in (("a", data.astronaut()), ("b", data.coffee())):
        write_png(folder / f"{name}.png", np.ascontiguousarray(image[100:260, 150:330]))
    return Pictures(Path(folder), leaves_share=0)


@cache
def sample_of(pictures: Pictures, form: Form, variety: Variety, size: int, number: int) -> Sample:
    """A sample, made once."""
    return source(pictures, form, variety, size).sample(number)


def source(pictures: Pictures, form: Form, variety: Variety = PLAIN, size: int = 48) -> TrainingData:
    return TrainingData(pictures, form, size, seed=3, variety=variety)


@pytest.mark.parametrize("form", FORMS)
def test_a_sample_is_always_the_same_and_no_other_is(pictures: Pictures, form: Form) -> None:
    data_set = source(pictures, form)
    first, again, other = (data_set.sample(number) for number in (5, 5, 6))
    assert torch.equal(first.observation.views, again.observation.views)
    assert torch.equal(first.layers, again.layers)
    assert not torch.equal(first.layers, other.layers)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("number", range(3))
def test_parts_add_up_to_the_views_but_for_the_noise(pictures: Pictures, form: Form, number: int) -> None:
    sample = source(pictures, form).sample(number)
    noise = float(sample.observation.view_errors.mean())
    off = sample.parts.sum(2) - sample.observation.views
    # The azimuth that the views are taken along is an estimate, too.
    assert float(off.std()) < 1.6 * noise + 0.004
    assert float(sample.parts.min()) > -1e-3


def test_the_engine_makes_the_views_of_the_true_layers(pictures: Pictures) -> None:
    for number in range(4):
        sample = source(pictures, "paper").sample(number)
        made = sample.engine(sample.layers[0])
        off = (made - sample.observation.views[0])[..., 12:-12, 12:-12]
        assert float(off.std()) < 2 * float(sample.observation.view_errors.mean()) + 0.01


def test_processes_make_the_same_samples_in_the_same_order(pictures: Pictures) -> None:
    numbers = range(3, 5)
    here = source(pictures, "conditioned").samples(numbers)
    there = TrainingData(pictures, "conditioned", size=48, seed=3, variety=PLAIN, workers=1).samples(numbers)
    for mine, theirs in zip(here, there, strict=True):
        assert torch.equal(mine.observation.views, theirs.observation.views)
        assert torch.equal(mine.engine(mine.layers[0]), theirs.engine(mine.layers[0]))


@pytest.mark.parametrize(
    "scene",
    [
        SceneParameters(60.0, 20.0, 4.3),
        SceneParameters(72.0, 160.0, -3.0, 1.4, reflection_polarization=(0.4, 30.0)),
        SceneParameters(50.0, 75.0, 2.0, n_panes=2, gap_shift=5.5),
        SceneParameters(86.0, 45.0, 0.0),
    ],
    ids=["pane", "polarized", "panes", "in place"],
)
def test_shifted_layers_add_up_to_the_engines_photographs(scene: SceneParameters) -> None:
    layers = torch.rand(2, 3, 24, 37, generator=torch.Generator().manual_seed(0))
    engine = PSE(scene, ANGLES_DEG)
    assert torch.allclose(shifted_sum(engine)(layers), engine.forward(layers), atol=1e-5)


def test_a_batch_is_engineered_as_its_samples_are_alone(pictures: Pictures) -> None:
    variety = replace(PLAIN, incidences_deg=(40.0, 60.0), wide=0.5)
    samples = [source(pictures, "paper", variety).sample(number) for number in range(6)]
    engines = tuple(sample.engine for sample in samples)
    assert 0 < sum(isinstance(engine, ShiftedSum) for engine in engines) < 6
    layers = torch.cat([sample.layers for sample in samples]).requires_grad_()
    alone = torch.stack([engine(each) for engine, each in zip(engines, layers, strict=True)])
    together = BatchEngine(engines)(layers)
    assert torch.allclose(together, alone, atol=1e-6)
    gradients = [torch.autograd.grad(views.square().sum(), layers)[0] for views in (together, alone)]
    assert torch.allclose(*gradients, atol=1e-5)


def test_gradients_come_through_the_engine(pictures: Pictures) -> None:
    sample = source(pictures, "paper").sample(0)
    layers = sample.layers[0].clone().requires_grad_()
    sample.engine(layers).square().mean().backward()
    assert layers.grad is not None
    assert float(layers.grad.abs().sum()) > 0


@pytest.mark.parametrize("kind", ["polarized", "wide"])
def test_in_other_light_and_through_wide_lenses_the_engine_makes_the_views_too(pictures: Pictures, kind: str) -> None:
    """To the noise, and to what the pane's estimated azimuth is off; and it passes gradients on."""
    variety = replace(PLAIN, incidences_deg=(40.0, 60.0), **{kind: 1.0})
    samples = [source(pictures, "conditioned", variety).sample(number) for number in range(4)]
    for sample in samples:
        layers = sample.layers[0].clone().requires_grad_()
        made = sample.engine(layers)
        off = (made.detach() - sample.observation.views[0])[..., 12:-12, 12:-12]
        assert float(off.std()) < 2 * float(sample.observation.view_errors.mean()) + 0.02
        made.square().mean().backward()
        assert layers.grad is not None
        assert float(layers.grad.abs().sum()) > 0
    if kind == "wide":
        assert any(isinstance(sample.engine.pse, VaryingPSE) for sample in samples)


def test_what_noise_leaves_unexplained_is_as_large_as_noise(pictures: Pictures) -> None:
    """At the truth it would be 1 in units of itself; the closed form explains a part of the noise."""
    for variety in (PLAIN, MOSAICS):
        for number in range(3):
            seen = sample_of(pictures, "conditioned", variety, 64, number).observation
            assert seen.unexplained is not None
            assert 0.1 < float(seen.unexplained.std()) < 1.5


def test_a_pixel_of_a_mosaic_tells_of_its_own_colour_and_by_its_own_polarizer(pictures: Pictures) -> None:
    """Photographs tell of both layers the same everywhere; a pixel of a colour sensor's pattern of one colour."""
    full = source(pictures, "conditioned").sample(0).observation.told
    assert full is not None
    assert torch.allclose(full, torch.ones_like(full))
    for number in range(3):
        told = sample_of(pictures, "conditioned", MOSAICS, 64, number).observation.told
        assert told is not None
        assert torch.allclose(told.mean(dim=(2, 3, 4)), torch.ones(1, 2), atol=1e-4)
        assert torch.allclose(told[..., 4:, 4:], told[..., :-4, :-4])
        brightest = told[0, 0].max(dim=0).values
        if not torch.equal(told[0, 0, 0], told[0, 0, 2]):
            assert float((told[0, 0].sum(0) / brightest).max()) < 1.1


def test_grey_captures_are_shown_as_three_equal_channels(pictures: Pictures) -> None:
    sample = source(pictures, "conditioned", Variety(grey=1, overexposed=0)).sample(1)
    for images in (sample.layers, sample.observation.views, sample.observation.layers):
        assert images is not None
        assert torch.equal(images[..., 0, :, :], images[..., 2, :, :])
    assert sample.observation.errors is not None
    assert not sample.observation.errors[..., 1:].any()


@pytest.mark.parametrize("variety", [PLAIN, MOSAICS, replace(PLAIN, several_panes=1)], ids=["four", "mosaic", "panes"])
def test_a_transmission_is_as_far_from_the_truth_as_it_tells(pictures: Pictures, variety: Variety) -> None:
    data_set = source(pictures, "conditioned", replace(variety, incidences_deg=(45.0, 70.0)), 64)
    for sample in map(data_set.sample, range(2)):
        seen = sample.observation
        assert seen.layers is not None
        assert seen.errors is not None
        # The luminance in the networks' basis is the sum of the colours over the root of three. What the pane's own
        # errors do, to the reflection above all, is not in the standard errors.
        off = (seen.layers - sample.layers)[0, 0].sum(0)[8:-8, 8:-8] / 3**0.5
        assert float(off.square().mean().sqrt()) < 5 * float(seen.errors[0, 0, 0])


def test_a_mosaic_leaves_more_open_than_four_photographs(pictures: Pictures) -> None:
    """Of the same pictures behind the same panes."""

    def errors(variety: Variety) -> np.ndarray:
        variety = replace(variety, noise=(0.005, 0.005))
        of_each = [source(pictures, "conditioned", variety, 64).sample(number).observation for number in range(3)]
        return np.array([float(one.errors[0, 0, 0]) for one in of_each])

    assert np.median(errors(MOSAICS) / errors(PLAIN)) > 1.5


def test_clipped_highlights_are_told(pictures: Pictures) -> None:
    clipping = source(pictures, "conditioned", Variety(overexposed=1))
    shares = [float((clipping.sample(number).observation.trusted < 1).float().mean()) for number in range(2)]
    # The brightest light of some captures lies beside the frame.
    assert 0 < max(shares) < 0.5


def test_dead_leaves_are_in_range_and_follow_their_seed() -> None:
    image = dead_leaves(64, 1)
    assert image.shape == (64, 64, 3)
    assert image.dtype == np.float32
    assert image.min() >= 0
    assert image.max() <= 1
    assert image.std() > 0.03
    assert np.array_equal(image, dead_leaves(64, 1))
    assert not np.array_equal(image, dead_leaves(64, 2))


def test_a_folder_without_photographs_and_tiny_frames_are_errors(tmp_path: Path, pictures: Pictures) -> None:
    with pytest.raises(InputError, match="at least 2"):
        Pictures(tmp_path)
    with pytest.raises(InputError, match="32 or more"):
        TrainingData(pictures, "paper", size=16)
