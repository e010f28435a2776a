"""Damaged files and random command lines on fixed seeds: a result or one line, in time, and nothing half-written.

`make fuzz MINUTES=N` goes on with seeds that nobody has seen.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt import InputError
from polaropt.capture.files.decode import read_file
from tests.fuzz import worker
from tests.fuzz.attack import attack
from tests.fuzz.seeds import seeds

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="limits and times are those of Linux")
# Without one that is a film of hundreds of frames, all of which are separated.
FILES, LINES = [seed for seed in range(60) if seed != 38], range(5)
PICTURES = {name: data for name, data in seeds().items() if name.endswith((".png", ".jpg", ".tiff", ".npz", ".npy"))}
# Command lines that once ended otherwise, on files of `tests.fuzz.seeds`.
PAST = (
    ["estimate", "glass.tiff", "--focal-px=1e9"],
    ["sequence", "misnamed.npy", "-o", "out"],
    ["separate", "glass.tiff", "--angles=1,2,4,8", "--max-evaluations=2", "-o", "out"],
    ["sequence", "lzw.tiff", "-o", "out", "--max-pixels=100"],
    ["estimate", "glass.tiff", "--scene=deep.json"],
    ["estimate", "glass.tiff", "--scene=infinite.json"],
    ["estimate", "mosaic.png", "--analyzer=deep.json"],
    ["inspect", "black.tiff", "--align"],
    ["inspect", "levels.tiff", "--exposures=1e300,1,1,1"],
    ["calibrate", "mosaic.png", "--shape=inf,inf", "-o", "out.json"],
    ["simulate", "--pairs=99999999999999999999", "-o", "out"],
    ["simulate", "color_000.png", "color_090.png", "--angles=inf,inf", "-o", "out"],
    ["inspect", "black.tiff", "--white-level=1e-320"],
    ["estimate", "black.tiff", "--exposures=10,55,100,145"],
    ["estimate", "glass.npz", "--white-level=1e20", "--incidence=7"],
    ["estimate", "levels.tiff", "--scene=" + "x" * 3000],
)
# In a process of their own these are read at a second each.
QUICK = sorted(set(PICTURES) - {"jpeg.tiff"})


def test_nothing_breaks_it() -> None:
    cases = [{"line": line} for line in PAST]
    cases += [{"kind": "file", "seed": seed} for seed in FILES] + [{"kind": "options", "seed": seed} for seed in LINES]
    assert [failure for failure in attack(cases) if failure is not None] == []


def ends(code: int, out: str = "", err: str = "", left: str = "") -> Callable[[list[str]], int]:
    def main(line: list[str]) -> int:
        os.write(1, out.encode())
        os.write(2, err.encode())
        if left:
            Path(left).mkdir()
        return code

    return main


ENDS = {
    "a result": (ends(0, "sentences"), ""),
    "refused": (ends(2, "", "polaropt: no such file\n"), ""),
    "a traceback": (lambda line: {}[line[0]], "KeyError"),
    "two lines": (ends(2, "", "polaropt: no\nsuch file\n"), "refused with"),
    "a line of somebody else": (ends(0, "", "RuntimeWarning: divide\n"), "said"),
    "a folder": (ends(0, left=".polaropt-1"), "left"),
    "half of a result": (ends(2, "", "polaropt: no\n", "out"), "wrote"),
    "another code": (ends(7), "ended with 7"),
}


@pytest.mark.parametrize("name", ENDS)
def test_what_breaks_it_is_seen(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    main, expected = ENDS[name]
    folder, listening = tmp_path / "case", tmp_path / "heard"
    folder.mkdir()
    listening.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(worker, "main", main)
    wrong = worker.judged(["separate"], folder, listening)
    assert expected in wrong
    assert bool(wrong) == bool(expected)


@given(st.sampled_from(QUICK), st.data())
@settings(max_examples=150)
def test_damaged_bytes_are_a_picture_or_one_line(tmp_path_factory, name: str, data: st.DataObject) -> None:
    whole = bytearray(PICTURES[name])
    for at, value in data.draw(st.lists(st.tuples(st.integers(0, len(whole) - 1), st.integers(0, 255)), max_size=8)):
        whole[at] = value
    end = data.draw(st.integers(1, len(whole)) | st.just(len(whole)))
    file = tmp_path_factory.getbasetemp() / f"damaged{Path(name).suffix}"
    file.write_bytes(bytes(whole[:end]))
    try:
        content = read_file(file)
    except InputError as error:
        line = str(error)
    else:
        line = f"{content.pixels.ndim - content.stack} axes"
        assert content.pixels.ndim in (2, 3, 4)
    assert line.isprintable()
