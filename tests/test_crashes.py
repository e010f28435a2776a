"""A run that is killed loses nothing, and places that cannot be written are told; `make crash` kills more often."""

from __future__ import annotations

import contextlib
import io
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from polaropt.cli.app import main
from tests.crash import crash, in_process
from tests.fuzz.commands import FOUR, QUICK
from tests.fuzz.seeds import write_seeds

PANE = ["--incidence", "60", "--azimuth", "25", "--shift", "0", "--panes", "1"]
ROOT = Path(__file__).parent.parent
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that are copies")


# A batch, a study and a training take longer, and are killed by `make crash` alone.
@pytest.mark.parametrize("name", ["separate", "simulate"])
def test_a_killed_run_loses_nothing(name: str) -> None:
    assert crash(name, 2, seed=3)["killed"] == 2


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shelf")
    write_seeds(folder)
    return folder


def test_a_full_disk_is_one_line_and_nothing_is_left(
    shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(shelf)
    line = ["separate", *FOUR, *PANE, *QUICK, "-o"]
    assert main([*line, str(tmp_path / "whole")]) == 0

    def in_little_room() -> int:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        with contextlib.redirect_stderr(io.StringIO()) as said:
            code = main([*line, str(tmp_path / "full")])
        one = said.getvalue().startswith("polaropt: ") and said.getvalue().count("\n") == 1
        return code if one and "cannot be written" in said.getvalue() else 1

    assert in_process(in_little_room) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["whole"]


@pytest.mark.parametrize(
    "environment",
    [
        {"LANG": "C", "LC_ALL": "C", "PYTHONIOENCODING": "ascii"},
        {"HOME": "/nowhere", "XDG_CACHE_HOME": "/proc/nowhere", "PYTHONDONTWRITEBYTECODE": "1"},
    ],
    ids=["ASCII alone", "no home"],
)
def test_poor_surroundings(shelf: Path, tmp_path: Path, environment: dict[str, str]) -> None:
    kept = {name: os.environ[name] for name in ("PATH", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS") if name in os.environ}
    ran = subprocess.run(
        [sys.executable, "-m", "polaropt", "inspect", *FOUR, "-o", str(tmp_path / "look.png")],
        cwd=shelf,
        env={**kept, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    assert (tmp_path / "look.png").is_file()
