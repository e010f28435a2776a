"""The list of ways: the default is what `separate` does, and each name is one way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polaropt import separate
from polaropt.estimation.ladder import model_names
from polaropt.solving.starts import start_names
from solvers.registry import solver_names
from studies.camera import take
from studies.photographs import shipped_pairs
from studies.scenes import SCENES, protocol
from studies.ways import CLOSED_FORM, DEFAULT, METHODS, PARTS, RUNGS, WITH_SCENE, alone, one_at_a_time, starts

PAIR = shipped_pairs(64, 32)[0]


def test_every_rung_solver_and_start_is_there():
    ways = one_at_a_time()
    assert len(set(ways)) == len(ways)
    assert {way.solver for way in ways} == set(solver_names())
    assert {way.start for way in ways} == set(start_names())
    assert set(RUNGS) == set(model_names()) - {"none"}
    assert set(starts()) < set(start_names())
    assert len({part.name for part in PARTS}) == len(PARTS)


def test_the_default_is_given_what_the_scene_gives_and_with_the_scene_all_of_it():
    sample = take(SCENES["water, single surface"], PAIR)
    result = DEFAULT.separation(sample)
    assert result.scene.single_surface
    np.testing.assert_array_equal(result.layers, separate(sample.capture, sample.hint).layers)
    assert WITH_SCENE.separation(sample).scene == sample.scene
    assert not WITH_SCENE.blind


def test_the_start_alone_takes_one_evaluation():
    sample = take(protocol(60), PAIR)
    first = alone(DEFAULT).separation(sample)
    assert first.solver.n_evaluations == 1
    np.testing.assert_array_equal(METHODS[CLOSED_FORM].run(sample)[0], first.layers[0])
    assert alone(DEFAULT).label == "default"
    assert replace(DEFAULT, start="cold").label == "start cold"
