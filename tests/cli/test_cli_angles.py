"""The angles of photographs, as the names of their files tell them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from polaropt.capture.files.write import write_tiff
from polaropt.cli.app import main
from tests.blends import blend
from tests.command_line import QUICK

EXAMPLE = blend(60, 64, color=False)
# Told: how it is found is tested elsewhere.
PANE = ["--incidence", "60", "--azimuth", "25", "--shift", "5.3", "--panes", "1"]


def written(folder: Path, names: dict[str, int]) -> list[str]:
    """Photographs under these names, each the one of an angle's number; in the order that a shell has them in."""
    for name, which in names.items():
        write_tiff(folder / name, EXAMPLE.capture.intensities[which])
    return sorted(str(folder / name) for name in names)


def taken(folder: Path, files: list[str], *more: str) -> dict[str, object]:
    assert main(["separate", *files, *PANE, *more, "--write", "layers", "-o", str(folder / "out"), *QUICK]) == 0
    report: dict[str, object] = json.loads((folder / "out" / "report.json").read_text())
    return report


@pytest.mark.parametrize("pattern", ["shot_{}.tiff", "I{}.tiff", "vase-{}deg.tiff"])
def test_names_tell_the_angles(tmp_path: Path, pattern: str, capsys: pytest.CaptureFixture[str]) -> None:
    files = written(tmp_path, {pattern.format(45 * k): k for k in range(4)})
    report = taken(tmp_path, files)
    assert report["input"]["angles_deg"] == [0, 135, 45, 90]  # type: ignore[index]
    assert "as the names tell: 0, 135, 45, 90 deg" in capsys.readouterr().out
    assert report["diagnostics"]["warnings"] == []  # type: ignore[index]


def test_three_names_are_enough(tmp_path: Path) -> None:
    report = taken(tmp_path, written(tmp_path, {f"shot_{45 * k}.tiff": k for k in (0, 1, 3)}))
    assert report["input"]["angles_deg"] == [0, 135, 45]  # type: ignore[index]


def test_numbers_that_are_no_angles_are_not_taken_for_them(tmp_path: Path) -> None:
    report = taken(tmp_path, written(tmp_path, {f"shot_{k}.tiff": k for k in range(4)}))
    assert report["input"]["angles_deg"] == [0, 45, 90, 135]  # type: ignore[index]


def test_angles_that_are_given_count(tmp_path: Path) -> None:
    files = written(tmp_path, {f"shot_{45 * k}.tiff": k for k in range(4)})
    report = taken(tmp_path, files, "--angles", "10,145,55,100")
    assert report["input"]["angles_deg"] == [10, 145, 55, 100]  # type: ignore[index]


def test_the_usual_angles_count_where_they_are_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Names may be wrong: only where nothing is given they tell."""
    files = written(tmp_path, {f"shot_{angle}.tiff": k for k, angle in enumerate((0, 90, 45, 135))})
    report = taken(tmp_path, files, "--angles", "0,45,90,135")
    assert report["input"]["angles_deg"] == [0, 45, 90, 135]  # type: ignore[index]
    assert "the names tell other angles" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("angles", "contradict"),
    [
        ("0,90,45,135", True),  # in another order than the names
        ("0,60,120,150", True),
        ("10,145,55,100", False),  # all turned by as much: a filter whose zero is known
        ("0,135,45,90", False),
    ],
)
def test_angles_that_contradict_the_names_are_said(
    tmp_path: Path, angles: str, contradict: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    files = written(tmp_path, {f"shot_{45 * k}.tiff": k for k in range(4)})
    taken(tmp_path, files, "--angles", angles)
    said = [line for line in capsys.readouterr().out.splitlines() if "the names tell other angles" in line]
    assert len(said) == contradict
    if contradict:
        assert "shot_135.tiff at " + angles.split(",")[1] in said[0]
        assert main(["estimate", *files, *PANE, "--angles", angles, "--json"]) == 0
        assert "the names tell other angles" in json.loads(capsys.readouterr().out)["attention"][0]


def test_numbers_that_count_photographs_contradict_no_angles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken(tmp_path, written(tmp_path, {f"shot_{k}.tiff": k for k in range(4)}), "--angles", "0,46,91,135")
    assert "the names tell" not in capsys.readouterr().out


def test_an_estimate_tells_what_a_separation_would_be_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = written(tmp_path, {f"shot_{name}.tiff": k for k, name in enumerate("abcd")})
    assert main(["estimate", files[0], files[2], files[1], files[3], *PANE]) == 0
    assert "ATTENTION: The photographs look as if they were given in a wrong order" in capsys.readouterr().out
