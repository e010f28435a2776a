"""The stability study's scenes are what their names say, and its scores count what they claim."""

from __future__ import annotations

from dataclasses import replace

from studies import stability
from studies.scenes import Scene, Taking
from studies.stability_rows import MINIMUM, NOTHING, Row, methods
from studies.stability_scores import AUTO, judge, score
from tests.documents import document_of

EASY = Scene("family: 0", family="family", easy=True)


def row(case, method, transmission, detail=0.9, warnings=()):
    return Row(case.family, case.name, case.value, 0, 0, method, transmission, 20, detail, "", None, None, 0, warnings)


def judged(auto, nothing=25.0, minimum=25.0, *, facts=Taking(), **of_row):  # noqa: B008 (frozen)
    """One scene beside an easy end of 45 dB."""
    case = replace(EASY, name="family: 1", value=1, taking=facts, easy=False)
    rows = [row(EASY, AUTO, 45), row(EASY, NOTHING, 25), row(EASY, MINIMUM, 25)]
    rows += [row(case, AUTO, auto, **of_row), row(case, NOTHING, nothing), row(case, MINIMUM, minimum)]
    (part,) = (part for part in judge(rows, [EASY, case]) if part.row.method == AUTO and part.row.value == 1)
    return part


def test_a_transmission_fails_against_doing_nothing_and_against_the_easy_end():
    assert not judged(24.95).worse
    assert judged(24.8).worse
    assert judged(30.0).far
    assert not judged(32.0).far
    assert not judged(30.0, nothing=20.0, minimum=20.0).far
    assert judged(40.0, detail=0.2).reflection_lost
    assert not judged(40.0).failed


def test_only_what_speaks_of_the_failure_announces_it():
    assert judged(20.0, warnings=("MODEL_DOES_NOT_EXPLAIN",)).announced
    assert not judged(20.0, warnings=("REFLECTION_NOT_IDENTIFIABLE", "SATURATED")).announced
    assert judged(40.0, detail=0.1, warnings=("REFLECTION_NOT_IDENTIFIABLE",)).announced
    assert not judged(40.0, detail=0.1, warnings=("SATURATED",)).announced


def test_a_warning_without_failure_is_false_unless_it_is_true_of_the_scene():
    assert judged(40.0, warnings=("GAMMA_ENCODED",)).false_alarm
    encoded = judged(40.0, warnings=("GAMMA_ENCODED",), facts=Taking(gamma=1.5))
    assert not encoded.false_alarm
    assert encoded.strictly_false
    assert not judged(40.0, warnings=("SATURATED",)).strictly_false


def test_scores_are_shares():
    parts = [judged(20.0), judged(20.0, warnings=("GRAZING",)), judged(40.0), judged(40.0, warnings=("GRAZING",))]
    found = score(parts)
    assert (found.recall, found.false_share, found.worse, found.least_gain) == (0.5, 0.5, 2, -5.0)


def test_the_study_is_one_command_and_draws_what_it_has(tmp_path, capsys):
    stability.main(["--families", "bits", "--quick", "--methods", AUTO, "-o", str(tmp_path)])
    told = capsys.readouterr().out
    assert "separations by `auto`" in told
    assert (tmp_path / "stability.md").read_text().strip() == told.strip()
    assert (tmp_path / "stability.csv").exists()
    for name in ("transmission", "reflection", "warnings"):
        assert (tmp_path / f"stability_{name}.png").stat().st_size > 5000
    document = document_of(tmp_path / "stability.json")
    assert {row["method"] for row in document["results"]} == {AUTO, NOTHING, MINIMUM}
    assert AUTO in methods()
