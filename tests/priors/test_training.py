"""Training: it lowers the loss, goes on where it stopped, and always comes to the same."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from polaropt.capture import ANGLES_DEG
from polaropt.optics import PSE, SceneParameters
from priors.observation import Observation
from priors.training.engines import BatchEngine
from priors.training.losses import DECIBEL, LossWeights
from priors.training.trainer import (
    LOG,
    STATE,
    Batch,
    NotFinite,
    Sample,
    Training,
    TrainingOptions,
    Turn,
    TurnedEngine,
    WrongState,
    turned,
)
from tests.observations import Mixtures, small_network

OPTIONS = TrainingOptions(
    steps=12, batch_size=2, learning_rate=3e-3, weights=DECIBEL, window=4, averaging=0.5, test_samples=2, test_every=4
)


def weights_of(training: Training) -> torch.Tensor:
    return torch.cat([parameter.detach().flatten() for parameter in training.network.parameters()])


def test_training_lowers_the_loss(tmp_path: Path) -> None:
    log = Training(small_network(), Mixtures(), replace(OPTIONS, steps=40, test_every=20)).run(tmp_path)
    assert [row["step"] for row in log] == [20, 40]
    assert log[-1]["loss"] < log[0]["loss"]
    # The closed form of these samples is the truth with white noise, which is easily taken off.
    assert log[-1]["transmission_db"] > log[-1]["closed_form_transmission_db"] + 0.3
    assert log[-1]["reflection_db"] > log[-1]["closed_form_reflection_db"] + 0.3


def test_what_makes_samples_is_started_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Where processes make them, each start costs a minute.
    begun, samples = [], Mixtures.samples

    def counted(source: Mixtures, numbers: Sequence[int]) -> Iterator[Sample]:
        begun.append(len(numbers))
        return samples(source, numbers)

    monkeypatch.setattr(Mixtures, "samples", counted)
    Training(small_network(), Mixtures(), OPTIONS).run(tmp_path / "tested")
    log = Training(small_network(), Mixtures(), replace(OPTIONS, test_samples=0)).run(tmp_path / "untested")
    assert len(begun) == 2
    assert begun[0] == begun[1] + OPTIONS.test_samples
    assert "transmission_db" not in log[-1]


def test_the_same_seed_comes_to_the_same_weights(tmp_path: Path) -> None:
    runs = [Training(small_network(seed=1), Mixtures(), OPTIONS) for _ in range(2)]
    for number, training in enumerate(runs):
        training.run(tmp_path / str(number))
    assert torch.equal(*(weights_of(training) for training in runs))


def test_a_resumed_training_comes_to_the_same_weights(tmp_path: Path) -> None:
    weights = LossWeights(perceptual=0.1)
    options = replace(OPTIONS, weights=weights)
    whole = Training(small_network(), Mixtures(), options)
    whole.run(tmp_path / "whole")
    torch.manual_seed(0)
    first = Training(small_network(), Mixtures(), options)
    while first.step < 8:
        first._train_step(options.rate(first.step, options.done(first.step, 0.0)))
        first.step += 1
    first.save(tmp_path / "halves" / STATE)
    second = Training(small_network(seed=5), Mixtures(), options)
    second.resume(tmp_path / "halves" / STATE)
    log = second.run(tmp_path / "halves")
    assert torch.equal(weights_of(whole), weights_of(second))
    assert log[-1]["step"] == 12
    assert (tmp_path / "halves" / LOG).read_text().startswith("step,")


def test_resuming_from_something_else_is_told(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no state to resume from"):
        Training(small_network(), Mixtures(), OPTIONS).resume(tmp_path / STATE)
    Training(small_network("paper"), Mixtures(), OPTIONS).save(tmp_path / STATE)
    with pytest.raises(ValueError, match="no state of this training"):
        Training(small_network(), Mixtures(), OPTIONS).resume(tmp_path / STATE)
    Training(small_network(), Mixtures(), OPTIONS).save(tmp_path / STATE)
    with pytest.raises(ValueError, match="seed 0, not 3"):
        Training(small_network(), Mixtures(), replace(OPTIONS, seed=3)).resume(tmp_path / STATE)


def test_what_is_no_state_is_told_and_a_bug_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / STATE).write_bytes(b"no state at all")
    with pytest.raises(WrongState, match="cannot be read"):
        Training(small_network(), Mixtures(), OPTIONS).resume(tmp_path / STATE)
    torch.save({"step": 3}, tmp_path / STATE)
    with pytest.raises(WrongState, match="no state of this training"):
        Training(small_network(), Mixtures(), OPTIONS).resume(tmp_path / STATE)
    adversarial = replace(OPTIONS, weights=replace(OPTIONS.weights, adversarial=0.1))
    Training(small_network(), Mixtures(), adversarial).save(tmp_path / STATE)
    with pytest.raises(WrongState, match="no state of this training"):
        Training(small_network(), Mixtures(), OPTIONS).resume(tmp_path / STATE)
    training = Training(small_network(), Mixtures(), adversarial)

    def broken(state: object) -> None:
        raise TypeError("a bug")

    monkeypatch.setattr(training._optimizer, "load_state_dict", broken)
    with pytest.raises(TypeError, match="a bug"):
        training.resume(tmp_path / STATE)


def test_a_loss_that_is_no_number_ends_the_training(tmp_path: Path) -> None:
    network = small_network()
    with torch.no_grad():
        next(network.parameters())[0] = float("nan")
    with pytest.raises(NotFinite, match="before step"):
        Training(network, Mixtures(), OPTIONS).run(tmp_path)


def test_the_rate_rises_and_falls() -> None:
    options = TrainingOptions(steps=1000, learning_rate=1e-4)
    rates = [options.rate(step, options.done(step, 0.0)) for step in range(1000)]
    assert rates[0] < rates[49]
    assert rates[100] > rates[500] > rates[999] > 0
    assert max(rates) <= 1e-4


def test_a_training_ends_in_its_time(tmp_path: Path) -> None:
    """However few steps that takes, and at the rate of the last one."""
    options = replace(OPTIONS, steps=10**6, seconds=0.5)
    training = Training(small_network(), Mixtures(), options)
    log = training.run(tmp_path)
    assert 0 < training.step < 10**4
    assert log[-1]["step"] == training.step
    assert log[-1]["seconds"] == pytest.approx(0.5, abs=0.4)
    assert options.done(training.step, log[-1]["seconds"]) == 1


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_step_that_is_recorded_is_the_step() -> None:
    options = replace(OPTIONS, device="cuda", half_precision=False, test_samples=0)
    plain, recorded = (Training(small_network(), Mixtures(), options) for _ in range(2))
    assert recorded._recorded is not None
    plain._recorded = None
    for training in (plain, recorded):
        for training.step in range(3):
            training._train_step(1e-3)
    torch.testing.assert_close(weights_of(recorded), weights_of(plain), rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("ways", list(itertools.product([False, True], repeat=3)))
def test_a_batch_that_is_turned_is_that_of_a_turned_camera(ways: tuple[bool, bool, bool]) -> None:
    """An engine with a ghost: its views of turned layers are the turned views, the ghost lies along the turned step."""
    turn = Turn(*ways)
    down, right = 2, 3

    def engine_of(step: tuple[int, int]) -> Callable[[torch.Tensor], torch.Tensor]:
        return lambda layers: layers + 0.3 * layers.roll(step, dims=(-2, -1))

    layers = torch.rand(2, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    vector = turn.vectors(torch.tensor([[float(right), float(down)]]))[0]
    turned_step = (int(vector[1]), int(vector[0]))
    wanted = engine_of(turned_step)(turn.images(layers))
    torch.testing.assert_close(TurnedEngine(engine_of((down, right)), turn)(turn.images(layers)), wanted)
    torch.testing.assert_close(turn.images_back(turn.images(layers)), layers)


@pytest.mark.parametrize("ways", list(itertools.product([False, True], repeat=3)))
def test_photographs_at_fixed_angles_are_turned_to_those_of_the_turned_pane(ways: tuple[bool, bool, bool]) -> None:
    turn = Turn(*ways)
    layers = torch.rand(1, 2, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    plane = (math.cos(math.radians(25)), math.sin(math.radians(25)))
    vector = turn.vectors(torch.tensor([plane]))[0].tolist()

    def engine_of(azimuth_deg: float) -> Callable[[torch.Tensor], torch.Tensor]:
        return PSE(SceneParameters(60.0, azimuth_deg, 0.0), ANGLES_DEG).forward

    views = engine_of(25.0)(layers[0])[None]
    seen = Observation(views, torch.tensor([[1.0, 2.0, 3.0, 4.0]]), torch.ones(1, 1, 1, 16, 16))
    batch = Batch(seen, layers, torch.stack([views, views], dim=2), BatchEngine((engine_of(25.0),)))
    found = turned(batch, turn)
    wanted = engine_of(math.degrees(math.atan2(vector[1], vector[0])))(found.layers[0])[None]
    torch.testing.assert_close(found.observation.views, wanted)
    torch.testing.assert_close(found.parts[:, :, 1], wanted)
    torch.testing.assert_close(found.engine(found.layers), wanted)
    assert found.observation.view_errors[0].tolist() == [1.0 + number for number in turn.views]


class Harm:
    """What runs a program where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self._path,)


@pytest.mark.parametrize("where", ["step", "network", "critics"])
def test_a_state_is_data_and_never_a_program(tmp_path: Path, where: str) -> None:
    training = Training(small_network(), Mixtures(), OPTIONS)
    training.save(tmp_path / STATE)
    state = torch.load(tmp_path / STATE, weights_only=True)
    torch.save({**state, where: Harm(tmp_path / "harm")}, tmp_path / STATE)
    with pytest.raises(WrongState, match="cannot be read as a state"):
        training.resume(tmp_path / STATE)
    assert not (tmp_path / "harm").exists()


@pytest.mark.parametrize(
    "damage",
    [{"network": [1]}, {"network": {"a": 1}}, {"critics": 3}, {"optimizer": {}}, {"averaged": {}}, {"step": "third"}],
    ids=str,
)
def test_a_damaged_state_is_told(tmp_path: Path, damage: dict[str, object]) -> None:
    training = Training(small_network(), Mixtures(), OPTIONS)
    training.save(tmp_path / STATE)
    torch.save({**torch.load(tmp_path / STATE, weights_only=True), **damage}, tmp_path / STATE)
    with pytest.raises(WrongState, match=r"is damaged|is no state"):
        Training(small_network(), Mixtures(), OPTIONS).resume(tmp_path / STATE)
