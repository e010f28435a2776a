"""The starts by name, and the learned one: what it gives, where its solve ends, what it refuses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import polaropt
from polaropt.errors import InputError
from polaropt.optics.scene import SceneParameters
from polaropt.reporting.report import separation_report
from polaropt.reporting.words import solver_sentence
from polaropt.separation import separate
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem
from polaropt.solving.starts import (
    check_start,
    pulled_to_start,
    start_names,
    take_start,
)
from priors import learned
from priors.networks.checkpoint import save_network
from priors.networks.fusionnet import Form, SeparationNetwork
from tests.blends import blend
from tests.observations import small_network


def ship(path: Path, network: SeparationNetwork) -> None:
    path.with_suffix(".json").write_text(json.dumps({"sha256": save_network(path, network)}))
    learned.shipped_initializer.cache_clear()


@pytest.fixture
def untrained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A network that changes nothing, in the place of the shipped one."""
    path = tmp_path / "conditioned.safetensors"
    ship(path, small_network())
    monkeypatch.setattr(learned, "WEIGHTS", tmp_path)
    yield path
    learned.shipped_initializer.cache_clear()


@pytest.fixture
def shaken(untrained: Path) -> None:
    """A network that spoils the closed form so much that the photographs are not explained."""
    network = small_network()
    with torch.no_grad():
        network.fusionnet._hourglass._exit.bias += 4.0
    ship(untrained, network)


def problem_of(**how: object) -> Problem:
    blended = blend(size=64, **how)
    return Problem(blended.capture, blended.scene, 0.005, Weights())


PROBLEM = problem_of()


def test_the_list_of_starts() -> None:
    assert start_names() == ("closed-form", "cold", "learned", "per-pixel")
    assert all(start.sentence.endswith(".") for start in polaropt.initializers())


def test_unknown_starts_and_missing_packages_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="there are: closed-form, cold, learned, per-pixel"):
        check_start("warm")
    monkeypatch.setattr("solvers.base.find_spec", lambda package: None)
    with pytest.raises(InputError, match=r"pip install 'polaropt\[torch\]'"):
        check_start("learned")


@pytest.mark.parametrize(
    "how", [{}, {"color": False}, {"angles_deg": (0.0, 60.0, 120.0)}, {"focal_px": 150.0, "ghost_shift": 0.0}]
)
def test_a_network_that_changes_nothing_starts_at_what_is_known(untrained: Path, how: dict[str, object]) -> None:
    problem = problem_of(**how)
    expected = problem.canvas.continued(problem.canvas.crop(problem.best_known()))
    np.testing.assert_allclose(take_start(problem, "learned"), expected, atol=2e-6)


def test_the_same_capture_always_starts_at_the_same(shaken: None) -> None:
    starts = [take_start(problem_of(), "learned") for _ in range(2)]
    assert np.array_equal(*starts)


@pytest.mark.parametrize("incidence_deg", [10.0, 75.0])
def test_every_start_ends_at_the_same_layers(shaken: None, incidence_deg: float) -> None:
    """A start is a start: what is returned is where the solver ended."""
    blended = blend(incidence_deg, size=64)
    stopping = polaropt.StoppingRule(200, relative_change=1e-7)
    ends = [
        separate(blended.capture, blended.scene, init=init, stopping=stopping)
        for init in ("closed-form", "learned", "per-pixel", "cold")
    ]
    values = [end.solver.value for end in ends]
    assert max(values) - min(values) < 1e-3 * abs(min(values))
    for end in ends[1:]:
        assert np.abs(end.layers - ends[0].layers)[0].mean() < 0.002


@given(share=st.floats(0, 1))
def test_the_way_back_to_a_start_is_straight(share: float) -> None:
    problem = PROBLEM
    start = problem.canvas.continued(problem.canvas.crop(problem.known.layers))
    objective = problem.compiled(start)
    end = np.zeros_like(start)
    layers, terms = pulled_to_start(objective, start, end, share)
    np.testing.assert_allclose(layers, share * start, atol=1e-4)
    assert terms["misfit"].value >= 0


def test_layers_are_pulled_back_only_where_that_is_asked_for(shaken: None) -> None:
    blended = blend(60.0, size=64)
    stopping = polaropt.StoppingRule(60)
    first = separate(blended.capture, blended.scene, init="learned", keep_start=1.0).layers
    half, end = (
        separate(blended.capture, blended.scene, init="learned", keep_start=share, stopping=stopping)
        for share in (0.5, 0.0)
    )
    np.testing.assert_allclose(half.layers, (first + end.layers) / 2, atol=1e-4)
    assert half.solver.value > end.solver.value
    assert half.solver.value == pytest.approx(sum(term.weight * term.value for term in half.terms.values()))
    report = separation_report(half, blended.capture, blended.scene)
    assert report["solver"]["keep_start"] == 0.5
    assert "50% of the way back" in solver_sentence(report["solver"])
    assert "back" not in solver_sentence({**report["solver"], "keep_start": 0.0})


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_outside_of_the_way_is_refused(share: float) -> None:
    blended = blend(60.0, size=64)
    with pytest.raises(InputError, match="0 \\(the solve's end\\) to 1"):
        separate(blended.capture, blended.scene, keep_start=share)


def test_the_true_layers_have_the_misfit_of_the_noise() -> None:
    blended = blend(size=96)
    noise = 0.005
    problem = Problem(blended.capture, blended.scene, noise, Weights())
    residual = problem.pse.forward(blended.layers) - blended.capture.intensities
    inside = (..., slice(16, -16), slice(16, -16))
    assert float(np.square(residual[inside] / noise).mean()) == pytest.approx(1, abs=0.05)


def test_a_missing_file_of_weights_is_told(untrained: Path) -> None:
    untrained.unlink()
    with pytest.raises(InputError, match="no such file"):
        separate(blend(size=64).capture, SceneParameters(60.0, 25.0, 5.3), init="learned")


@pytest.mark.parametrize("form", ["conditioned", "paper"])
def test_the_shipped_weights_are_those_of_their_record_and_small(form: Form) -> None:
    learned.shipped_initializer.cache_clear()
    network = learned.shipped_initializer(form).network
    assert network.architecture.form == form
    assert (learned.WEIGHTS / f"{form}.safetensors").stat().st_size <= 20e6
    assert (learned.WEIGHTS / f"{form}.md").is_file()


def test_other_weights_than_the_record_tells_of_are_refused(untrained: Path) -> None:
    save_network(untrained, small_network(seed=1))
    learned.shipped_initializer.cache_clear()
    with pytest.raises(InputError, match="digest"):
        separate(blend(size=64).capture, SceneParameters(60.0, 25.0, 5.3), init="learned")
