"""The study of starts: what its rows hold, and that its conclusions follow from them."""

from __future__ import annotations

import math

import pytest
from pandas import DataFrame

from studies.kit.frames import frame_of
from studies.learned_init import CLOSED_FORM, COLD, LEARNED, Row, compare, conclusions, figures, kept, regime, rows_of
from studies.learned_init import tables as page
from studies.photographs import shipped_pairs
from studies.scenes import MAP, SCREEN, STARTS
from studies.scenes import START_NOISES as NOISES
from studies.ways import starts as start_names


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    (scene,) = [scene for scene in STARTS if (scene.pane.incidence_deg, scene.taking.noise) == (60, NOISES[0])][:1]
    return rows_of(scene, shipped_pairs(64, 32)[0], most_evaluations=20)


def test_every_start_runs_on_the_same_scene(rows: list[Row]) -> None:
    assert tuple(row.start for row in rows) == start_names()
    assert len({row.cpu_scene for row in rows}) == 1
    assert min(row.gap for row in rows) == 0
    for row in rows:
        assert 0 < len(row.path) <= 20
        assert row.path[0] == row.transmission_start
        assert row.cpu_stopped > row.cpu_scene > 0


def test_the_plain_intensity_has_the_longest_way(rows: list[Row]) -> None:
    (cold,) = [row for row in rows if row.start == COLD]
    assert all(cold.transmission_start <= row.transmission_start for row in rows)
    # A learned start leads to an objective of its own, whose minimum may lie elsewhere.
    assert all(not cold.evaluations_gap < row.evaluations_gap for row in rows if row.start != LEARNED)


def test_regimes_divide_the_map_and_name_the_special_cases() -> None:
    assert regime(MAP, 25, 0.02) == "incidence <= 25 deg, noise 0.02"
    assert regime(MAP, 30, 0.005) == "beyond 25 deg, noise 0.005"
    assert regime(SCREEN, 60, 0.005) == SCREEN


def made_up(start: str, incidence_deg: float, *, alone: float, stopped: float, seconds: float, gap: float = 0) -> Row:
    quality = {f"{layer}_{moment}": 30.0 for layer in ("transmission", "reflection") for moment in ("converged",)}
    counts = {f"evaluations_{where}": 3.0 for where in ("stopped", "gap", "near")}
    clocks = {f"{clock}_{where}": seconds for clock in ("cpu", "seconds") for where in ("stopped", "gap", "near")}
    return Row(
        MAP, f"{incidence_deg}", incidence_deg, NOISES[0], 0, start, "ghosts",
        transmission_start=alone, reflection_start=alone, transmission_stopped=stopped, reflection_stopped=stopped,
        misfit_start=1, misfit_stopped=1, status="CONVERGED", gap=gap, short_db=0, cpu_scene=0.1, cpu_start=0.1,
        path=(alone, stopped), **quality, **counts, **clocks,
    )  # fmt: skip


def example(learned_stopped: float) -> DataFrame:
    rows = [
        row
        for incidence in (10, 60)
        for row in (
            made_up(CLOSED_FORM, incidence, alone=29, stopped=30, seconds=1),
            made_up(COLD, incidence, alone=10, stopped=30, seconds=2),
            made_up(LEARNED, incidence, alone=31, stopped=learned_stopped, seconds=0.5, gap=0.01),
        )
    ]
    return frame_of(Row, rows)


def test_a_start_is_compared_with_the_closed_form() -> None:
    found = compare(example(31), LEARNED)
    assert found.alone == (2, 2)
    assert found.stopped == (1, 1)
    assert found.seconds_near == 0.5
    assert (found.verdict, compare(example(29), LEARNED).verdict) == ("better", "worse")


def test_a_start_that_is_thrown_away_is_named() -> None:
    assert kept(example(30.5), LEARNED) == [(10, -0.5, -0.5), (60, -0.5, -0.5)]
    assert any("DOES NOT keep" in sentence for sentence in conclusions(example(30.5), LEARNED))
    assert any("keeps it" in sentence for sentence in conclusions(example(31), LEARNED))


def test_the_page_tells_minima_and_what_never_arrives() -> None:
    text = page(example(31), "abc")
    assert "higher than another start's on 2 of 2 scenes (closed form: 0)" in text
    late = example(31).assign(evaluations_gap=math.nan, cpu_gap=math.nan)
    assert "nan" in page(late, "abc")


def test_all_figures_are_drawn(rows: list[Row]) -> None:
    drawn = {name: make() for name, make in figures(frame_of(Row, rows)).items()}
    assert set(drawn) == {"learned_init_quality", "learned_init_work", "learned_init_paths"}
    assert all(figure.axes for figure in drawn.values())
