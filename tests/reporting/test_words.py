"""What is said of a capture: facts, and what a person must look at."""

from __future__ import annotations

from dataclasses import replace

import pytest

from polaropt.estimation.ladder import LadderResult, RungReport
from polaropt.judging.warnings import SeparationWarning
from polaropt.optics.scene import FIELDS, SceneErrors, SceneParameters
from polaropt.reporting.inspection import inspect_capture
from polaropt.reporting.page import parameters
from polaropt.reporting.report import json_values, scene_report
from polaropt.reporting.words import (
    attention,
    capture_findings,
    error_of,
    estimate_sentences,
    inspection_sentences,
    pane_sentence,
    report_attention,
)
from tests.captured import photographed

PLAIN = inspect_capture(photographed((64, 64), noise=0.003))


def test_a_plain_capture_asks_for_nothing() -> None:
    assert not any(finding.attention for finding in capture_findings(PLAIN))
    assert attention(PLAIN, ()) == []


def test_what_needs_attention_is_marked_behind_the_fact() -> None:
    dim = replace(PLAIN, brightest=0.05)
    (asking,) = (finding for finding in capture_findings(dim) if finding.attention)
    assert asking.subject == "values"
    assert asking.fact.startswith("Values are ")
    assert asking.attention.startswith("the brightest value is 5 % of white")
    assert f"{asking.fact} ATTENTION: {asking.attention}" in inspection_sentences(dim)
    assert attention(dim, ()) == [asking.attention]


@pytest.mark.parametrize(("error", "said"), [(0.0023, "1.002 +- 0.002"), (0.04, "1.00 +- 0.04"), (0.0, "1.00")])
def test_an_exponent_without_error_is_not_said(error: float, said: str) -> None:
    linear = replace(PLAIN, looks_encoded=False, gamma_exponent=1.0021, gamma_error=error)
    assert f"The values are linear (measured exponent {said})." in inspection_sentences(linear)


def test_no_wording_of_a_file_asks_for_attention() -> None:
    odd = replace(PLAIN, looks_encoded=None, encoding_hint="a codec called ATTENTION: JPEG")
    assert attention(odd, ()) == []


def test_what_a_warning_of_the_separation_says_is_not_said_again() -> None:
    bad = replace(PLAIN, dolp_95=0.01, looks_encoded=True, visible_shift_px=2.0, swapped_deg=((0.0, 45.0),))
    assert [finding.subject for finding in capture_findings(bad) if finding.attention] == [
        "polarization",
        "encoding",
        "order",
        "position",
    ]
    warned = (SeparationWarning.GAMMA_ENCODED, SeparationWarning.MISALIGNED)
    assert attention(bad, warned) == ["photographs look swapped: 0 and 45 degrees; check the order of the files."]
    # How weak the polarization is the separation measures against the noise.
    assert len(attention(bad, ())) == 3


OPEN = SceneParameters(None, None, None, None, n_panes=None, gap_shift=None, absorption=None)
# What a field of each kind can hold, and what is said of it.
FULL = SceneParameters(
    incidence_deg=61.2,
    azimuth_deg=25.0,
    ghost_shift=4.0,
    refractive_index=1.333,
    transmission_ghost_shift=3.0,
    focal_px=900.0,
    bend_deg_per_px=(0.02, 0.0, 0.0),
    transmission_polarization=(0.6, 140.0),
    reflection_polarization=(0.3, 60.0),
    n_panes=2,
    gap_shift=9.0,
    gap_azimuth_deg=40.0,
    absorption=0.3,
)


def test_every_quantity_of_the_scene_is_said_everywhere() -> None:
    report = {**scene_report(FULL, OPEN), "errors": json_values(SceneErrors(incidence_deg=0.4))}
    assert report["estimated"] == [field.name for field in FIELDS if field.estimable]
    sentence, lines = pane_sentence(report), estimate_sentences(LadderResult(FULL, None, ()), OPEN)
    assert len(parameters(report)) == len(FIELDS)
    for field in FIELDS:
        assert ("bent by" if field.name == "bend_deg_per_px" else field.label) in sentence
        assert any(line.startswith(field.label) for line in lines)
    assert "incidence 61.20 +- 0.40 deg (estimated)" in sentence
    assert "refractive index 1.333 (estimated, error not known)" in sentence
    assert "panes 2 (estimated)" in sentence
    # Whether an index was given, or glass has the usual one, a report does not tell.
    assert "refractive index 1.333 (given or assumed)" in pane_sentence({**report, "estimated": []})


@pytest.mark.parametrize(
    ("error", "said"),
    [(0.4, "+- 0.40 "), (12.3, "+- 12 "), (0.031, "+- 0.03 "), (0.0042, "+- 0.004 "), (0.0, ""), (None, "")],
)
def test_a_standard_error_is_never_said_to_be_none(error: float | None, said: str) -> None:
    assert error_of(error) == said


def test_a_number_has_as_many_digits_as_its_error() -> None:
    scene = SceneParameters(61.2, 25.0, 0.0)
    report = {**scene_report(scene, OPEN), "errors": json_values(SceneErrors(incidence_deg=0.4, azimuth_deg=0.0042))}
    assert "azimuth 25.000 +- 0.004 deg (estimated)" in pane_sentence(report)


def test_a_rung_that_is_looked_at_twice_is_told_once() -> None:
    left = RungReport("polarized", None, None, 0.1, False, "The photographs do not tell it.")
    taken = RungReport("ghosts", 1.0, 0.0, 0.1, True, "It leaves no polarized light beyond the noise.")
    lines = estimate_sentences(LadderResult(FULL, None, (taken, left, left)), OPEN)
    told = [line for line in lines if line.startswith("rung")]
    assert len(told) == 2
    assert all(line.endswith(".") and not line.endswith("left.") for line in told)


@pytest.mark.parametrize(
    ("scene", "absent"),
    [
        (SceneParameters(50.0, 10.0, 0.0, single_surface=True), "ghost shift"),
        (SceneParameters(50.0, 10.0, 0.0, focal_px=500.0), "ghost shift"),
        (SceneParameters(50.0, 10.0, 3.0, reflection_polarization=(0.0, 60.0)), "mirrored light"),
        (SceneParameters(50.0, 10.0, 3.0), "panes"),
        (SceneParameters(50.0, 10.0, 3.0), "absorption"),
    ],
)
def test_what_a_scene_lacks_is_said_nowhere(scene: SceneParameters, absent: str) -> None:
    report = {**scene_report(scene, OPEN), "errors": json_values(SceneErrors())}
    assert absent not in pane_sentence(report)
    assert not any(absent in row.name.lower() for row in parameters(report))
    assert not any(line.startswith(absent) for line in estimate_sentences(LadderResult(scene, None, ()), OPEN))


def test_a_warning_of_the_index_names_both() -> None:
    warning = SeparationWarning.INDEX_DOUBTFUL
    report = {
        "attention": [],
        "scene": {"refractive_index": 1.5},
        "diagnostics": {
            "warnings": [{"name": warning.name, "sentence": warning.value}],
            "likelier_index": {"index": 1.81, "error": 0.1},
        },
    }
    (said,) = report_attention(report)
    assert said.startswith("Glass of index 1.81 +- 0.10 explains the photographs better than one pane of 1.5.")
    assert said.endswith(warning.value)


def test_what_an_uncertain_number_costs_is_said() -> None:
    warning = SeparationWarning.SCENE_UNCERTAIN
    loss = {"transmission_db": 6.2, "reflection_db": 0.4, "number": "incidence_deg", "error": 0.7}
    warnings = [{"name": warning.name, "sentence": warning.value}]
    report = {"attention": [], "diagnostics": {"warnings": warnings, "loss": loss}}
    (said,) = report_attention(report)
    assert said.startswith("The incidence is known to +- 0.70 deg: against a pane that is known, its errors cost")
    assert "about 6 dB" in said
    loss["error"] = None
    assert report_attention(report)[0].startswith("The incidence is hardly known: ")
    loss.update(number="transmission_polarization", error=5.0)
    assert report_attention(report)[0].startswith("The polarization of the light from behind is not known exactly: ")
