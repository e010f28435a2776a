"""Results as plain values for JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from polaropt.optics.scene import SceneParameters
from polaropt.reporting.report import capture_report, plain, scene_report, versions
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
    assert json.loads(json.dumps(plain(values), allow_nan=False)) == {
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


def test_a_capture_from_memory_has_no_origin() -> None:
    report = capture_report(photographed((3, 32, 48)))
    assert report == {"width": 48, "height": 32, "channels": 3, "angles_deg": [0, 45, 90, 135]}


def test_versions_are_told() -> None:
    assert all(versions().values())
