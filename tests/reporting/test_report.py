"""Results as plain values for JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from polaropt.capture import Matching
from polaropt.capture.registration import Motions
from polaropt.optics.scene import SceneParameters
from polaropt.reporting.report import (
    capture_report,
    json_values,
    matching_report,
    scene_report,
    separation_report,
    versions,
)
from polaropt.separation import separate
from solvers.base import StoppingRule
from tests.blends import blend
from tests.captured import photographed


class Color(Enum):
    RED = "The colour of blood."


@dataclass(frozen=True)
class Box:
    color: Color
    values: tuple[float, ...]


def test_everything_becomes_json() -> None:
    values = {
        "box": Box(Color.RED, (1.0, np.nan, np.inf)),
        "number": np.float32(0.5),
        "short": np.arange(3),
        "long": np.zeros(1000),
        "path": Path("a"),
        "nothing": None,
        "yes": True,
    }
    assert json.loads(json.dumps(json_values(values), allow_nan=False)) == {
        "box": {"color": "RED", "values": [1.0, None, None]},
        "number": 0.5,
        "short": [0, 1, 2],
        "long": None,
        "path": "a",
        "nothing": None,
        "yes": True,
    }


def test_the_scene_tells_what_was_estimated() -> None:
    given = SceneParameters(None, 30.0, None)
    found = given.replace(incidence_deg=50.0, ghost_shift=2.0)
    assert scene_report(found, given)["estimated"] == ["incidence_deg", "ghost_shift"]
    water = given.replace(single_surface=True)
    assert scene_report(water.replace(incidence_deg=50.0, ghost_shift=0.0), water)["estimated"] == ["incidence_deg"]


def test_what_nobody_says_was_not_estimated() -> None:
    asked = SceneParameters(None, None, None, n_panes=None, gap_shift=None, absorption=None)
    clear = SceneParameters(50.0, 30.0, 2.0)
    searched = ["incidence_deg", "azimuth_deg", "ghost_shift"]
    assert scene_report(clear, asked)["estimated"] == searched
    window = clear.replace(n_panes=2, gap_shift=3.0, absorption=0.1)
    assert scene_report(window, asked)["estimated"] == [*searched, "n_panes", "gap_shift", "absorption"]
    # A focal length that the camera told was not estimated.
    lens = clear.replace(focal_px=900.0)
    assert scene_report(lens, asked)["estimated"] == [*searched, "focal_px"]
    assert scene_report(lens, asked, 900.0)["estimated"] == searched
    assert scene_report(clear, asked, 900.0)["estimated"] == searched
    assert scene_report(lens, asked, 800.0)["estimated"] == [*searched, "focal_px"]


def test_light_without_a_degree_is_unpolarized_whatever_its_angle() -> None:
    asked = SceneParameters(None, None, None)
    for polarization, told in (((0.0, 30.0), False), ((0.2, 0.0), True)):
        found = SceneParameters(50.0, 30.0, 2.0, transmission_polarization=polarization)
        assert ("transmission_polarization" in scene_report(found, asked)["estimated"]) == told
    given = asked.replace(transmission_polarization=(0.2, 30.0))
    found = SceneParameters(50.0, 30.0, 2.0, transmission_polarization=(0.2, 30.0))
    assert "transmission_polarization" not in scene_report(found, given)["estimated"]
    bent = SceneParameters(50.0, 30.0, 2.0, bend_deg_per_px=(0.0, 0.1, 0.0))
    assert "bend_deg_per_px" in scene_report(bent, asked)["estimated"]


def test_the_bounces_kept_are_those_of_the_solve() -> None:
    # At the noise that the solve reckons with, where it grows with the light, a third bounce stands out; at the
    # noise of the diagnostics it would not.
    example = blend(74.42, 64, noise=0.001, shot_noise=0.02)
    result = separate(example.capture, example.scene, stopping=StoppingRule(max_evaluations=1))
    kept = len(result.judge.args[3][0].pse.displacements) - 1
    assert separation_report(result, example.capture, example.scene)["n_bounces_kept"] == kept == 3


# Of a capture the report asks whether it is a mosaic's.
PHOTOGRAPHS = SimpleNamespace(cells=None)


def test_how_photographs_were_moved_is_told_with_turns_only_where_they_were_turned() -> None:
    still, lying = np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])
    moved = SimpleNamespace(shifts_px=np.array([[0.0, 0.0], [1.0, 2.0]]), layers=None, blurs_px=np.zeros(2))
    for second, turns, scales in ((still, None, None), (1.5 * lying, [0.0, 90.0], [1.0, 1.5])):
        motions = Motions(np.stack([still, second]), np.array([[0.0, 0.0], [3.0, -1.0]]))
        told = matching_report(Matching(PHOTOGRAPHS, moved, PHOTOGRAPHS, motions=motions, exposures=(1.0, 2.0)))
        assert told["shifts_px"] == [[0.0, 0.0], [4.0, 1.0]]
        assert (told["rotations_deg"], told["scales"]) == (turns, scales)
        assert (told["exposures"], told["gains"]) == ([1.0, 2.0], None)
    alone = matching_report(Matching(PHOTOGRAPHS, moved, PHOTOGRAPHS))
    assert (alone["shifts_px"], alone["rotations_deg"], alone["exposures"]) == ([[0.0, 0.0], [1.0, 2.0]], None, None)


def test_a_capture_from_memory_has_no_origin() -> None:
    report = capture_report(photographed((3, 32, 48)))
    assert report == {"width": 48, "height": 32, "channels": 3, "angles_deg": [0, 45, 90, 135]}


def test_versions_are_told() -> None:
    assert all(versions().values())
