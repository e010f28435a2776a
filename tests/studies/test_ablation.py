"""What the ablation leaves out is left out, and its intervals are those of the differences over pairs."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from polaropt import separate
from polaropt.capture.noise import noise_level
from polaropt.estimation import find_scene
from polaropt.simulation.metrics import psnr_db
from polaropt.solving import Weights
from polaropt.solving.objective import term_names
from studies.ablation import FACTORS, NEIGHBOURS, WEIGHTINGS, Row, difference, run, tables
from studies.camera import SceneJob
from studies.kit.frames import frame_of
from studies.scenes import protocol
from studies.ways import PARTS, WHOLE, judged_starts, seen_in_training
from tests.blends import blend


@pytest.fixture(scope="module")
def example():
    return blend(60, 96)


@pytest.fixture(scope="module")
def whole(solved):
    return solved(WHOLE)


def named(name):
    (part,) = [part for part in PARTS if part.name == name]
    return part


@pytest.fixture(scope="module")
def found(example):
    """The scene as it is estimated, for the same hint once."""

    @cache
    def estimate(hint):
        return find_scene(example.capture, hint, noise_level(example.capture)).scene

    return estimate


@pytest.fixture(scope="module")
def solved(example, found):
    def solution(name):
        part = named(name)
        return part.solved(example.capture, found(part.hint), example.scene)

    return solution


def test_the_whole_is_what_separate_does(example, found, whole):
    assert found(named(WHOLE).hint) == named(WHOLE).estimate(example.capture, noise_level(example.capture))
    layers = separate(example.capture).layers
    assert np.abs(whole.layers.reshape(layers.shape) - layers).max() < 2e-3


def test_without_polarization_the_layers_cannot_be_told_apart(example, solved, whole):
    with_it, without = whole.layers, solved("polarization").layers
    quality = [
        psnr_db(layers[1].reshape(example.layers[1].shape), example.layers[1], 8) for layers in (with_it, without)
    ]
    assert quality[0] > quality[1] + 6


@pytest.mark.parametrize("name", ["preconditioner", "closed-form start"])
def test_another_way_to_the_minimum_ends_near_it(solved, whole, name):
    assert solved(name).solver.value == pytest.approx(whole.solver.value, rel=0.05)


def frame(gains):
    scene = {"incidence_deg": 60.0, "reflection": 30.0, "transmission_ssim": 1.0, "reflection_ssim": 1.0}
    rest = {**scene, "evaluations": 5, "seconds": 1.0}
    worse = [
        (part.name, pair, 0.0 if part.name == WHOLE else gain) for pair, gain in enumerate(gains) for part in PARTS
    ]
    return frame_of(Row, [Row(name, pair, transmission=40 - less, **rest) for name, pair, less in worse])


def test_a_gain_has_an_interval_over_pairs():
    found = frame([1.0, 2.0, 3.0, 2.0, 1.0, 3.0])
    mean, low, high = difference(found, named("misfit"), "transmission")
    assert mean == pytest.approx(2)
    assert 1 < low < 2 < high < 3
    assert "| earns its place |" in tables(found)


def test_what_is_put_in_gains_where_it_is_better_with_it():
    better = frame([-1.0, -2.0, -3.0, -2.0, -1.0, -3.0])
    assert difference(better, named("learned start"), "transmission")[0] == pytest.approx(2)
    assert "| would earn a place |" in tables(better)


def test_the_learned_start_is_what_separate_does(example, found, solved):
    pytest.importorskip("torch")
    layers = separate(example.capture, found(named(WHOLE).hint), init="learned").layers
    assert np.abs(solved("learned start").layers.reshape(layers.shape) - layers).max() < 2e-3


def test_without_torch_the_learned_start_is_not_run(monkeypatch):
    monkeypatch.setattr("solvers.base.find_spec", lambda package: None)
    monkeypatch.setattr("studies.ablation.PARTS", (named(WHOLE), named("learned start")))
    monkeypatch.setattr("studies.ablation.WEIGHTINGS", ())
    made = run(SceneJob(protocol(60.0), 0, size=48))
    assert [bool(row.not_run) for row in made] == [False, True]
    text = tables(frame_of(Row, made))
    assert "| not run: the start 'learned' needs the package torch" in text
    assert "| with learned start | not run |" in text


def test_networks_are_not_judged_on_photographs_that_they_were_trained_on(monkeypatch, tmp_path):
    pytest.importorskip("torch")
    (tmp_path / "conditioned.json").write_text('{"data": "astronaut, gravel"}', encoding="utf-8")
    monkeypatch.setattr("priors.learned.WEIGHTS", tmp_path)
    monkeypatch.setattr("studies.ablation.PARTS", (named("learned start"),))
    monkeypatch.setattr("studies.ablation.WEIGHTINGS", ())
    (row,) = run(SceneJob(protocol(60.0), 0, size=48))
    assert row.not_run == seen_in_training(None) != ""
    assert seen_in_training("a folder") == ""
    assert "learned" not in judged_starts(None)


def test_few_pairs_have_none():
    few = frame([1.0, 2.0])
    assert math.isnan(difference(few, named("misfit"), "transmission")[1])
    assert "too few pairs" in tables(few)


def test_parts_have_names_of_their_own():
    assert len({part.name for part in PARTS}) == len(PARTS)


def test_every_term_stands_at_every_factor_with_and_without_its_neighbour(monkeypatch):
    assert set(NEIGHBOURS) == set(term_names())
    assert (
        len({weighting.part.name for weighting in WEIGHTINGS}) == len(WEIGHTINGS) == 2 * len(FACTORS) * len(NEIGHBOURS)
    )
    (heavy,) = [one for one in WEIGHTINGS if one.part.name == "edge independence x100 without gradient sparsity"]
    assert heavy.weights == Weights(edge_independence=100.0, gradient_sparsity=0.0)
    monkeypatch.setattr("studies.ablation.PARTS", (named(WHOLE),))
    shown = tuple(one for one in WEIGHTINGS if one.term == "nonnegativity")
    monkeypatch.setattr("studies.ablation.WEIGHTINGS", shown)
    monkeypatch.setattr("studies.ablation.NEIGHBOURS", {"nonnegativity": NEIGHBOURS["nonnegativity"]})
    made = run(SceneJob(protocol(60.0), 0, size=48))
    whole, *weighed = made
    at_one = next(row for row in weighed if row.variant == "nonnegativity x1")
    assert at_one.transmission == whole.transmission
    text = tables(frame_of(Row, made))
    assert "| term |  | x0 | x1 | x10 | x100 |" in text
    assert "| nonnegativity | without natural-image prior |" in text
