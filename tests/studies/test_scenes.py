"""The list of scenes: each has one name, and is what its name says."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from studies.kit.run import job_key
from studies.scenes import (
    LADDER,
    MAP,
    PROTOCOL,
    SATURATION,
    SCENES,
    SCREEN,
    STABILITY,
    STABILITY_QUICK,
    STARTS,
    STRONG_NOISE,
    protocol,
    starts,
)


def test_every_set_has_names_of_its_own_and_equal_names_are_equal_scenes():
    for scenes in (PROTOCOL, LADDER, STABILITY, STARTS):
        assert len({scene.name for scene in scenes}) == len(scenes)
        assert all(SCENES[scene.name] == scene for scene in scenes)


def test_about_190_scenes_each_with_its_name_and_every_family_with_one_easy_end():
    assert 170 <= len(STABILITY) <= 200
    assert set(Counter(scene.family for scene in STABILITY if scene.easy).values()) == {1}
    assert {scene.family for scene in STABILITY_QUICK} == {scene.family for scene in STABILITY}
    assert set(STABILITY_QUICK) <= set(STABILITY)


def test_scenes_of_starts_are_told_apart_and_the_quick_ones_are_among_them():
    assert set(starts(quick=True)) < set(STARTS)
    assert {scene.family for scene in starts(quick=True)} == {MAP, SCREEN, SATURATION, STRONG_NOISE}


def test_a_scene_of_the_protocol_says_what_is_not_as_in_the_paper():
    assert protocol(60) == SCENES["60 deg"]
    assert protocol(60, "plate", 0.02).name == "60 deg, plate, noise 0.02"
    assert protocol(60).pane.ghost_shift == pytest.approx(8.165, abs=0.01)
    assert replace(protocol(60).pane, ghosts="in place").ghost_shift == 0


def test_a_scene_is_plain_values_that_tell_it_apart():
    assert len({job_key(scene) for scene in SCENES.values()}) == len(SCENES)
    assert job_key(protocol(60)) == job_key(protocol(60.0))
