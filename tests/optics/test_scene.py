"""The scene's parameters and the step from one ghost to the next."""

from __future__ import annotations

import math
from typing import Any, Literal

import pytest

from polaropt import InputError, SceneParameters, ghost_step


@pytest.mark.parametrize(
    ("kind", "steps"),
    [("paper", (0.3, 4.1, 8.2, 10.1, 11.4, 11.8)), ("plate", (2.3, 7.3, 7.1, 5.5, 3.0, 1.5))],
)
def test_ghost_step_of_a_pane_of_ten_pixels(kind: Literal["paper", "plate"], steps: tuple[float, ...]) -> None:
    found = [ghost_step(incidence_deg, 1.5, 10, kind) for incidence_deg in (10, 40, 60, 70, 80, 85)]
    assert found == pytest.approx(steps, abs=0.05)


def test_plate_step_is_the_distance_of_the_parallel_rays() -> None:
    # Two rays leave the front face 2 d tan(theta_t) apart; seen at theta that is foreshortened.
    refracted = math.asin(math.sin(math.radians(50)) / 1.33)
    assert ghost_step(50, 1.33, 3, "plate") == pytest.approx(6 * math.tan(refracted) * math.cos(math.radians(50)))


def test_ghosts_lie_on_each_other_at_normal_incidence() -> None:
    assert ghost_step(0, 1.5, 10) == ghost_step(0, 1.5, 10, "plate") == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"incidence_deg": 90}, r"\[0, 90\)"),
        ({"incidence_deg": -1}, r"\[0, 90\)"),
        ({"incidence_deg": math.nan}, r"\[0, 90\)"),
        ({"refractive_index": 0.9}, "1 or more"),
        ({"refractive_index": math.inf}, "1 or more"),
        ({"azimuth_deg": math.nan}, "azimuth_deg"),
        ({"transmission_ghost_shift": math.inf}, "transmission_ghost_shift"),
        ({"ghost_shift": math.inf}, "ghost_shift"),
        ({"n_bounces": -1}, "n_bounces"),
        ({"n_bounces": 2.5}, "n_bounces"),
        ({"transmission_polarization": (1.2, 0)}, "degree"),
        ({"reflection_polarization": (-0.1, 0)}, "degree"),
        ({"reflection_polarization": (0.1, math.nan)}, "angle"),
    ],
)
def test_values_out_of_range_are_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        SceneParameters(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "arguments", [(90, 1.5, 1), (10, 0.5, 1), (10, 1.5, -1), (10, 1.5, math.nan), (10, 1.5, 1, "thick")]
)
def test_ghost_step_refuses_what_no_pane_is(arguments: tuple[Any, ...]) -> None:
    with pytest.raises(InputError):
        ghost_step(*arguments)


def test_a_scene_says_what_it_lacks() -> None:
    scene = SceneParameters(azimuth_deg=None, ghost_shift=None)
    assert not scene.complete
    with pytest.raises(InputError, match="azimuth_deg, ghost_shift"):
        scene.values()
    assert scene.replace(azimuth_deg=10.0, ghost_shift=2.0).values() == (60.0, 10.0, 2.0)


def test_a_scene_knows_whether_its_light_is_polarized() -> None:
    assert not SceneParameters().polarized
    assert SceneParameters(reflection_polarization=(0.1, 0)).polarized
    assert SceneParameters(transmission_polarization=(0.1, 0)).polarized
