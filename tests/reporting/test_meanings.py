"""What warnings mean, as a report shows it."""

from __future__ import annotations

import re

import pytest

from polaropt.judging.warnings import SeparationWarning
from polaropt.reporting.meanings import meaning_of


@pytest.mark.parametrize("name", SeparationWarning.__members__)
def test_every_warning_is_explained_in_plain_html(name: str) -> None:
    meaning = meaning_of(name)
    assert "<em>Do:</em>" in meaning
    # Neither marks of the documentation's language nor what it puts in.
    assert not re.search(r"[`{}]|\*|<(?!/?(?:p|em|code)>)", meaning)


def test_links_are_named() -> None:
    assert "<code>polaropt.align</code>" in meaning_of("MISALIGNED")
    assert "the gallery shows it" in meaning_of("MISALIGNED")


def test_another_name_has_no_meaning() -> None:
    assert meaning_of("NO_SUCH_WARNING") == ""
