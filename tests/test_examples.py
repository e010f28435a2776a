"""Every public name shows an example, and the examples do what they say."""

from __future__ import annotations

import doctest
from pathlib import Path

import pytest

import polaropt


@pytest.mark.parametrize("name", polaropt.__all__)
def test_a_public_name_has_an_example_that_holds(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    examples = doctest.DocTestFinder(recurse=False).find(getattr(polaropt, name), name, module=False, globs={})
    assert [example for found in examples for example in found.examples], "the docstring has no Examples"
    runner = doctest.DocTestRunner()
    for found in examples:
        runner.run(found)
    assert runner.summarize(verbose=False).failed == 0, capsys.readouterr().out
