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
from polaropt.capture.noise import noise_level
from polaropt.errors import InputError
from polaropt.optics.scene import SceneParameters
from polaropt.separation import separate
from polaropt.simulation.metrics import psnr_db
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem
from polaropt.solving.starts import (
    check_start,
    first_crossing,
    least_share_of_way,
    near_clipped,
    start_names,
    take_start,
)
from priors import learned
from priors.networks.checkpoint import save_network
from priors.networks.fusionnet import Form, SeparationNetwork
from solvers.base import Status
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


def test_the_list_of_starts() -> None:
    assert start_names() == ("closed-form", "cold", "learned", "per-pixel")
    assert all(start.sentence.endswith(".") for start in polaropt.initializers())


def test_unknown_starts_and_missing_packages_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="there are: closed-form, cold, learned, per-pixel"):
        check_start("warm")
    monkeypatch.setattr("polaropt.solving.starts.find_spec", lambda package: None)
    with pytest.raises(InputError, match=r"pip install 'polaropt\[torch\]'"):
        check_start("learned")


@pytest.mark.parametrize(
    "how", [{}, {"color": False}, {"angles_deg": (0.0, 60.0, 120.0)}, {"focal_px": 150.0, "ghost_shift": 0.0}]
)
def test_a_network_that_changes_nothing_starts_at_the_closed_form(untrained: Path, how: dict[str, object]) -> None:
    problem = problem_of(**how)
    expected = problem.canvas.continued(problem.canvas.crop(problem.known.layers))
    np.testing.assert_allclose(take_start(problem, "learned"), expected, atol=2e-6)


def test_the_same_capture_always_starts_at_the_same(shaken: None) -> None:
    starts = [take_start(problem_of(), "learned") for _ in range(2)]
    assert np.array_equal(*starts)


def test_where_the_photographs_leave_the_reflection_open_a_start_that_explains_them_is_the_end(untrained: Path) -> None:
    blended = blend(10.0, size=64)
    result = separate(blended.capture, blended.scene, init="learned")
    assert result.solver.status is Status.EXPLAINED
    assert result.solver.n_evaluations == 1


def test_where_the_photographs_tell_the_layers_the_end_is_halfway_to_the_minimum(untrained: Path) -> None:
    blended = blend(75.0, size=64)
    first, end, minimum = (
        separate(blended.capture, blended.scene, init=init, stopping=polaropt.StoppingRule(n)).layers
        for init, n in (("learned", 1), ("learned", 60), ("closed-form", 60))
    )
    way = (minimum - first).ravel()
    gone = float((end - first).ravel() @ way / (way @ way))
    assert 0.35 < gone <= 0.55


def test_near_clipped_pixels_the_minimum_is_taken(untrained: Path) -> None:
    blended = blend(75.0, size=96, exposure=2.2)
    layers = [separate(blended.capture, blended.scene, init=init).layers for init in ("learned", "closed-form")]
    near = near_clipped(blended.capture)
    assert near is not None
    assert np.abs(layers[0] - layers[1])[..., near > 0.999].max() < 0.02 * blended.layers.max()
    assert near_clipped(blend(size=64, exposure=0.5).capture) is None


@pytest.mark.parametrize("solver", ["lbfgs", "scipy", "nlopt", "torch"])
def test_a_solve_goes_on_until_the_photographs_are_explained(shaken: None, solver: str) -> None:
    blended = blend(12.0, size=64)
    problem = Problem(blended.capture, blended.scene, noise_level(blended.capture), Weights())
    result = separate(blended.capture, blended.scene, init="learned", solver=solver)
    assert result.solver.n_evaluations == len(result.solver.trace) > 1
    assert result.solver.status.success
    assert result.terms["misfit"].value == pytest.approx(problem.misfit_of_noise, rel=0.02)
    assert result.solver.value == pytest.approx(sum(term.weight * term.value for term in result.terms.values()))


@pytest.mark.parametrize("incidence_deg", [20.0, 60.0, 80.0])
def test_a_start_better_than_the_minimum_is_kept_though_the_photographs_contradict_it(
    monkeypatch: pytest.MonkeyPatch, incidence_deg: float
) -> None:
    """Errors of its own, 3 dB below those of the closed form: the solve may go on, but not past what explains them."""
    blended = blend(incidence_deg, size=64)
    errors = np.random.default_rng(0).standard_normal(blended.layers.shape)
    inside = (..., slice(8, -8), slice(8, -8))

    def better(problem: Problem) -> np.ndarray:
        known = problem.canvas.crop(problem.known.layers)
        spread = np.sqrt(np.square(known - blended.layers)[inside].mean(axis=(1, 2, 3)) / 2)
        return (blended.layers + spread[:, None, None, None] * errors).astype(np.float32)

    monkeypatch.setattr("polaropt.solving.starts._learned_layers", better)
    at_once = separate(blended.capture, blended.scene, init="learned", stopping=polaropt.StoppingRule(1))
    kept = separate(blended.capture, blended.scene, init="learned")
    converged = separate(blended.capture, blended.scene)
    assert kept.solver.n_evaluations > 1
    for i in (0, 1):
        start, end, minimum = (psnr_db(each.layers[i], blended.layers[i], 8) for each in (at_once, kept, converged))
        assert end > max(start, minimum)


@given(st.floats(1.1, 9), st.floats(0, 1), st.floats(0.01, 0.99))
def test_a_parabola_is_left_where_it_first_falls_to_the_level(start: float, end: float, share: float) -> None:
    curvature = share * (start - end)
    middle = start + (end - start - curvature) / 2 + curvature / 4
    at = first_crossing(start, middle, end, 1.0)
    assert start + (end - start - curvature) * at + curvature * at**2 == pytest.approx(1.0, abs=1e-9)


@given(st.floats(0, 1))
def test_what_is_left_open_is_left_to_the_start(unknown: float) -> None:
    assert 0 <= least_share_of_way(unknown) <= 0.5
    assert least_share_of_way(1.0) == 0
    assert least_share_of_way(unknown) <= least_share_of_way(unknown / 2)


def test_where_nothing_is_explained_the_end_is_taken() -> None:
    assert first_crossing(3.0, 2.0, 1.5, 1.0) == 1
    assert first_crossing(3.0, 3.5, 4.0, 1.0) == 1
    assert first_crossing(0.9, 0.8, 0.7, 1.0) == 0


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
    assert (learned.WEIGHTS / f"{form}.safetensors").stat().st_size <= 8 * 2**20
    assert (learned.WEIGHTS / f"{form}.md").is_file()


def test_other_weights_than_the_record_tells_of_are_refused(untrained: Path) -> None:
    save_network(untrained, small_network(seed=1))
    learned.shipped_initializer.cache_clear()
    with pytest.raises(InputError, match="digest"):
        separate(blend(size=64).capture, SceneParameters(60.0, 25.0, 5.3), init="learned")
