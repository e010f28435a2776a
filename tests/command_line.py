"""How tests of the command line run it, and what it writes."""

from __future__ import annotations

import pytest

from polaropt.cli.app import main

UNCERTAINTY = {"transmission_error.tiff", "reflection_error.tiff", "reflection_known.tiff", "uncertainty.png"}
RESULTS = {
    "transmission.tiff",
    "reflection.tiff",
    "transmission.png",
    "reflection.png",
    "report.json",
    "report.html",
    *UNCERTAINTY,
}
QUICK = ["--max-evaluations", "3"]


def spoken(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a successful command says on standard output; nothing on standard error."""
    capsys.readouterr()
    assert main(list(arguments)) == 0
    said = capsys.readouterr()
    assert said.err == ""
    return said.out
