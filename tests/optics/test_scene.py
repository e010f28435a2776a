"""The scene's parameters and the step from one ghost to the next."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal

import numpy as np
import pytest

from polaropt import InputError, SceneParameters, ghost_step
from polaropt.optics.scene import (
    FIELDS,
    GHOST_SHIFT_SEARCH_PX,
    INCIDENCE_LIMITS_DEG,
    INCIDENCE_SEARCH_DEG,
    SEARCHED,
    Field,
    SceneErrors,
    largest_search_shift,
    scale_between,
)
from polaropt.optics.stokes import stokes_vector


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


def test_every_quantity_of_a_scene_is_one_row_of_the_table_of_fields() -> None:
    names = [field.name for field in FIELDS]
    settings = {"n_bounces", "single_surface", "literal_eq3", "signal"}
    assert len(set(names)) == len(names)
    assert set(names) | settings == {field.name for field in dataclasses.fields(SceneParameters)}
    assert not set(names) & settings


def test_what_can_be_estimated_has_a_standard_error() -> None:
    estimable = {field.name for field in FIELDS if field.estimable}
    assert estimable == {field.name for field in dataclasses.fields(SceneErrors)}
    assert set(SEARCHED) <= estimable


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.name)
def test_a_field_has_as_many_components_as_the_scene_has_numbers(field: Field) -> None:
    value = getattr(SceneParameters(transmission_ghost_shift=1.0, focal_px=500.0), field.name)
    assert len(field.components) == np.size(value)
    # The name ends in the unit of what has one of several.
    unit = {"incidence": "deg", "azimuth": "deg", "focal": "px", "bend": "deg/px"}.get(field.name.split("_")[0])
    assert unit is None or all(component.unit == unit for component in field.components)


def test_fields_are_called_by_words_of_their_own() -> None:
    for called in ([field.words for field in FIELDS], [field.label for field in FIELDS]):
        assert len(set(called)) == len(called)
        assert all(name and name == name.strip() and not name[0].isupper() for name in called)
    assert all(bool(part.words) == (len(field.components) > 1) for field in FIELDS for part in field.components)


def test_angles_that_come_round_are_the_same_after_a_period() -> None:
    vectors = [stokes_vector(0.4, angle) for angle in (20.0, 200.0)]
    np.testing.assert_allclose(vectors[0], vectors[1], atol=1e-15)
    periods = {field.name: [part.period for part in field.components] for field in FIELDS}
    assert periods["azimuth_deg"] == [180.0]
    assert periods["transmission_polarization"] == periods["reflection_polarization"] == [None, 180.0]
    cyclic = {name for name, own in periods.items() if any(own)}
    assert cyclic == {"azimuth_deg", "gap_azimuth_deg", "transmission_polarization", "reflection_polarization"}


def test_what_is_searched_lies_within_what_can_be_worked_with() -> None:
    assert 0 < INCIDENCE_LIMITS_DEG[0] <= INCIDENCE_SEARCH_DEG[0]
    assert INCIDENCE_SEARCH_DEG[1] <= INCIDENCE_LIMITS_DEG[1] < 90


def test_in_small_frames_only_near_ghosts_are_searched() -> None:
    assert largest_search_shift(60) == 10
    assert largest_search_shift(4000) == GHOST_SHIFT_SEARCH_PX


PANE = SceneParameters(60.0, 20.0, 6.0)


@pytest.mark.parametrize(
    ("changes", "rung"),
    [
        ({"ghost_shift": 0.0}, "pixelwise"),
        ({}, "ghosts"),
        ({"ghost_shift": 0.0, "transmission_ghost_shift": 2.0}, "ghosts"),
        ({"ghost_shift": 0.0, "n_panes": 2, "gap_shift": 3.0}, "ghosts"),
        ({"ghost_shift": 0.0, "n_panes": 2}, "pixelwise"),
        ({"ghost_shift": 0.0, "gap_shift": 3.0}, "pixelwise"),
        ({"single_surface": True}, "pixelwise"),
        ({"focal_px": 500.0}, "perspective"),
        ({"bend_deg_per_px": (0.0, 0.0, 0.1)}, "curved"),
        ({"focal_px": 500.0, "bend_deg_per_px": (0.1, 0.0, 0.0)}, "curved"),
        ({"focal_px": 500.0, "reflection_polarization": (0.1, 0.0)}, "polarized"),
        ({"signal": False}, "none"),
    ],
)
def test_the_rung_is_what_varies_shifts_or_arrives_polarized(changes: dict[str, Any], rung: str) -> None:
    scene = PANE.replace(**changes)
    assert scene.rung == rung
    assert scene.varies == ("focal_px" in changes or "bend_deg_per_px" in changes)


@pytest.mark.parametrize(
    ("changes", "complete"),
    [
        ({}, True),
        ({"gap_shift": None}, True),
        ({"n_panes": 2}, True),
        ({"n_panes": 2, "gap_shift": None}, False),
        ({"n_panes": None}, False),
        ({"absorption": None}, False),
        ({"refractive_index": None}, False),
        ({"incidence_deg": None}, False),
        ({"transmission_ghost_shift": None, "focal_px": None}, True),
    ],
)
def test_a_scene_is_complete_where_nothing_is_left_to_be_found(changes: dict[str, Any], complete: bool) -> None:
    assert PANE.replace(**changes).complete == complete


@pytest.mark.parametrize("name", SEARCHED)
def test_a_scene_that_lacks_one_number_says_which(name: str) -> None:
    with pytest.raises(InputError, match=f"lacks {name};"):
        PANE.replace(**{name: None}).values()
    with pytest.raises(InputError, match="lacks refractive_index"):
        _ = PANE.replace(refractive_index=None).index


def test_the_plainest_pane_is_one_clear_one_unless_panes_are_told() -> None:
    found = SceneParameters(60.0, 20.0, 6.0, n_panes=None, gap_shift=None, absorption=None).plainest
    assert (found.n_panes, found.gap_shift, found.absorption) == (1, 0.0, 0.0)
    told = PANE.replace(n_panes=2, gap_shift=None, absorption=0.1).plainest
    assert (told.n_panes, told.gap_shift, told.absorption) == (2, None, 0.1)
    assert PANE.replace(n_panes=2, gap_shift=3.0).plainest.gap_shift == 3.0


def test_faces_and_tint_are_those_of_all_panes() -> None:
    window = PANE.replace(n_panes=3, absorption=0.1)
    assert (window.n_faces, window.sheets, window.stacked) == (6, (False, 3, 0.1), True)
    assert window.tint == pytest.approx(math.exp(-0.3))
    water = PANE.replace(single_surface=True)
    assert (water.n_faces, water.sheets, water.tint, water.stacked) == (1, (True, 1, 0.0), 1.0, False)
    unknown = PANE.replace(n_panes=None, absorption=None)
    assert (unknown.n_faces, unknown.sheets, unknown.tint) == (2, (False, 1, 0.0), 1.0)


def test_in_photographs_of_twice_the_side_lengths_are_doubled_and_bends_halved() -> None:
    scene = PANE.replace(transmission_ghost_shift=2.0, gap_shift=3.0, focal_px=500.0, bend_deg_per_px=(0.1, 0.2, 0.4))
    larger = scene.scaled(2)
    assert larger == PANE.replace(
        ghost_shift=12.0, transmission_ghost_shift=4.0, gap_shift=6.0, focal_px=1000.0, bend_deg_per_px=(0.05, 0.1, 0.2)
    )
    assert scene.scaled(1) is scene
    assert SceneParameters(None, None, None).scaled(2) == SceneParameters(None, None, None)
    errors = SceneErrors(0.1, 0.2, 0.3, focal_px=5.0, bend_deg_per_px=(0.1, 0.2, 0.4), gap_shift=0.5)
    twice = SceneErrors(0.1, 0.2, 0.6, focal_px=10.0, bend_deg_per_px=(0.05, 0.1, 0.2), gap_shift=1.0)
    assert errors.scaled(2) == twice
    assert SceneErrors(0.1).scaled(2) == SceneErrors(0.1)


@pytest.mark.parametrize("bend", [(0.1, 0.1), (0.1, math.nan, 0.1), (0.1, 0.1, 0.1, 0.1)])
def test_a_bend_is_three_finite_numbers(bend: Any) -> None:
    with pytest.raises(InputError, match="three finite numbers"):
        SceneParameters(bend_deg_per_px=bend)


@pytest.mark.parametrize(
    ("size", "shape", "scale"),
    [((300, 400), (300, 400), 1.0), ((300, 400), (600, 800), 2.0), ((150, 400), (300, 400), None)],
)
def test_photographs_of_one_view_have_sides_in_the_same_proportion(
    size: tuple[int, int], shape: tuple[int, int], scale: float | None
) -> None:
    assert scale_between(size, shape) == scale
