"""What is said of a capture: facts, and what a person must look at."""

from __future__ import annotations

from dataclasses import replace

from polaropt.judging.warnings import SeparationWarning
from polaropt.reporting.inspection import inspect_capture
from polaropt.reporting.words import attention, capture_findings, inspection_sentences
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
