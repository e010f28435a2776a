"""The stability study's scores count what they claim, and it is one command."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from studies import stability
from studies.kit.frames import frame_of
from studies.scenes import Scene, Taking
from studies.stability import AUTO, MINIMUM, NOTHING, WAYS, Row, judge, score
from tests.documents import document_of

EASY = Scene("family: 0", family="family", easy=True)


def row(case, method, transmission, detail=0.9, warnings=()):
    return Row(case.family, case.name, case.value, 0, 0, method, transmission, 20, detail, "", None, None, 0, warnings)


def judged(auto, nothing=25.0, minimum=25.0, *, facts=Taking(), **of_row):  # noqa: B008 (frozen)
    """One scene beside an easy end of 45 dB: a frame of one row."""
    case = replace(EASY, name="family: 1", value=1, taking=facts, easy=False)
    rows = [row(EASY, AUTO, 45), row(EASY, NOTHING, 25), row(EASY, MINIMUM, 25)]
    rows += [row(case, AUTO, auto, **of_row), row(case, NOTHING, nothing), row(case, MINIMUM, minimum)]
    frame = judge(frame_of(Row, rows), [EASY, case])
    return frame[(frame.method == AUTO) & (frame.value == 1)]


def only(auto, *arguments, **more):
    (part,) = judged(auto, *arguments, **more).itertuples()
    return part


def test_a_transmission_fails_against_doing_nothing_and_against_the_easy_end():
    assert not only(24.95).worse
    assert only(24.8).worse
    assert only(30.0).far
    assert not only(32.0).far
    assert not only(30.0, nothing=20.0, minimum=20.0).far
    assert only(40.0, detail=0.2).lost
    assert not only(40.0).failed


def test_only_what_speaks_of_the_failure_announces_it():
    assert only(20.0, warnings=("MODEL_DOES_NOT_EXPLAIN",)).announced
    assert not only(20.0, warnings=("REFLECTION_NOT_IDENTIFIABLE", "SATURATED")).announced
    assert only(40.0, detail=0.1, warnings=("REFLECTION_NOT_IDENTIFIABLE",)).announced
    assert not only(40.0, detail=0.1, warnings=("SATURATED",)).announced


def test_a_warning_without_failure_is_false_unless_it_is_true_of_the_scene():
    assert only(40.0, warnings=("GAMMA_ENCODED",)).false_alarm
    encoded = only(40.0, warnings=("GAMMA_ENCODED",), facts=Taking(gamma=1.5))
    assert not encoded.false_alarm
    assert encoded.strictly_false
    assert not only(40.0, warnings=("SATURATED",)).strictly_false


def test_scores_are_shares():
    parts = [judged(20.0), judged(20.0, warnings=("GRAZING",)), judged(40.0), judged(40.0, warnings=("GRAZING",))]
    found = score(pd.concat(parts))
    assert (found.recall, found.share(found.false_alarms), found.worse, found.least_gain) == (0.5, 0.5, 2, -5.0)


def test_a_family_without_its_easy_end_is_not_judged():
    case = replace(EASY, name="family: 1", value=1, easy=False)
    rows = [row(case, AUTO, 40), row(case, NOTHING, 25), row(case, MINIMUM, 25)]
    assert judge(frame_of(Row, rows), [EASY, case]).empty


def test_the_study_is_one_command_and_draws_what_it_has(tmp_path, capsys, told_pane, png_alone):
    stability.main(["--families", "bits", "--quick", "--methods", AUTO, "-o", str(tmp_path)])
    told = capsys.readouterr().out
    assert "separations by `auto`" in told
    assert (tmp_path / "stability.md").read_text().strip() == told.strip()
    assert (tmp_path / "stability.csv").exists()
    for name in ("transmission", "reflection", "warnings"):
        assert (tmp_path / f"stability_{name}.png").stat().st_size > 5000
    document = document_of(tmp_path / "stability.json")
    assert {row["method"] for row in document["results"]} == {AUTO, NOTHING, MINIMUM}
    assert AUTO in WAYS
