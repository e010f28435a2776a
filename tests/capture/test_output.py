"""Results appear whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace

import pytest

from polaropt.capture.files import results
from polaropt.capture.files.results import result_file, result_folder
from polaropt.errors import InputError

ROOT = Path(__file__).parents[2]


def run(target: Path, error: type[BaseException] | BaseException | None = None, **files: str) -> None:
    """Write files, and fail if told so."""
    with result_folder(target) as work:
        write(work, **files)
        if error is not None:
            raise error


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.iterdir())}


def write(folder: Path, **files: str) -> None:
    for name, text in files.items():
        (folder / name).write_text(text)


def test_a_new_folder_appears_with_everything_in_it(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b"
    with result_folder(target) as work:
        write(work, one="1", two="2")
        assert not target.parent.exists()
    assert contents(target) == {"one": "1", "two": "2"}
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_new_folder_is_as_open_as_any(tmp_path: Path) -> None:
    (tmp_path / "usual").mkdir()
    with result_folder(tmp_path / "ours") as work:
        write(work, one="1")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("usual", "ours")]
    assert modes[0] == modes[1]


def test_files_of_other_names_stay(tmp_path: Path) -> None:
    write(tmp_path, mine="old", foreign="kept")
    with result_folder(tmp_path) as work:
        write(work, mine="new", more="new")
    assert contents(tmp_path) == {"foreign": "kept", "mine": "new", "more": "new"}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_a_failing_run_leaves_the_previous_output(tmp_path: Path, error: type[BaseException]) -> None:
    write(tmp_path, mine="old")
    with pytest.raises(error):
        run(tmp_path, error, mine="half")
    assert contents(tmp_path) == {"mine": "old"}


def test_a_disk_that_is_full_is_told_with_the_name_of_the_output(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(InputError, match=r"out: cannot be written \(No space left on device\)"):
        run(tmp_path / "out", full, one="1")
    assert not list(tmp_path.iterdir())


def test_a_failing_run_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError):
        run(tmp_path / "a" / "b", RuntimeError, mine="half")
    assert list(tmp_path.iterdir()) == []


def test_an_exchange_that_fails_midway_is_undone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, a="old", b="old", c="old")
    rename, renamed = Path.rename, []

    def fails_late(self: Path, to: Path) -> Path:
        renamed.append(self)
        if len(renamed) == 4:
            raise PermissionError(13, "Permission denied")
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", fails_late)
    with pytest.raises(InputError, match="Permission denied"):
        run(tmp_path, a="new", b="new", c="new", d="new")
    assert contents(tmp_path) == {"a": "old", "b": "old", "c": "old"}


def test_an_exchange_that_fails_at_what_is_not_written_again_is_undone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, a="old", b="old", c="old", foreign="kept")
    rename = Path.rename

    def refused(self: Path, to: Path) -> Path:
        if self == tmp_path / "c":
            raise PermissionError(13, "Permission denied")
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(InputError, match="Permission denied"), result_folder(tmp_path, owned=("b", "c")) as work:
        write(work, a="new", d="new")
    assert contents(tmp_path) == {"a": "old", "b": "old", "c": "old", "foreign": "kept"}


def test_a_folder_in_the_way_of_a_file_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    write(tmp_path, also="old")
    with pytest.raises(InputError, match="is a folder where a file must go"), result_folder(tmp_path) as work:
        write(work, also="new", mine="new")
    assert (tmp_path / "mine").is_dir()
    assert (tmp_path / "also").read_text() == "old"


def test_a_folder_that_has_the_name_of_a_result_is_somebody_elses(tmp_path: Path) -> None:
    for name in ("mine", "stale"):
        (tmp_path / name).mkdir()
        write(tmp_path / name, precious="old")
    with pytest.raises(InputError, match="is a folder where"), result_folder(tmp_path, owned=("mine",)) as work:
        write(work, mine="new")
    with result_folder(tmp_path, owned=("also", "stale")) as work:
        write(work, also="new")
    assert [(tmp_path / name / "precious").read_text() for name in ("mine", "stale")] == ["old", "old"]


@pytest.mark.parametrize("inside", [(), ("deeper",)])
def test_a_file_is_no_output_folder(tmp_path: Path, inside: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("precious")
    target = tmp_path.joinpath("file", *inside)
    why = f"{target}: cannot be made, {tmp_path / 'file'} is no folder;" if inside else f"{target}: is no folder;"
    with pytest.raises(InputError, match=re.escape(why)), result_folder(target):
        pytest.fail("work was begun")
    assert contents(tmp_path) == {"file": "precious"}


def test_a_broken_link_is_no_output_folder(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="no folder"), result_folder(tmp_path / "link"):
        pytest.fail("work was begun")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_folder_is_found_before_the_work(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"), result_folder(tmp_path / "out"):
        pytest.fail("work was begun")
    tmp_path.chmod(0o700)


def test_a_place_that_refuses_folders_is_found_before_the_work() -> None:
    if not Path("/proc/self").exists():
        pytest.skip("no /proc here")
    with pytest.raises(InputError, match="cannot be written"), result_folder(Path("/proc/polaropt-out")):
        pytest.fail("work was begun")


def test_one_file(tmp_path: Path) -> None:
    write(tmp_path, other="kept")
    with result_file(tmp_path / "new" / "picture.png") as work:
        assert work.suffix == ".png"
        work.write_text("picture")
    assert contents(tmp_path / "new") == {"picture.png": "picture"}
    with pytest.raises(InputError, match="is a folder"), result_file(tmp_path / "new"):
        pytest.fail("work was begun")


def killed(target: Path, program: str) -> None:
    """Run a program that writes results and kills itself; its folder is then as old as one that counts as left."""
    text = f"""
import os, signal, json
from pathlib import Path
from polaropt.capture.files import results
def die(*_): os.kill(os.getpid(), signal.SIGKILL)
with results.result_folder(Path({str(target)!r}), ("stale", "a", "b", "c")) as work:
{textwrap.indent(textwrap.dedent(program), "    ")}
"""
    assert subprocess.run([sys.executable, "-c", text], check=False, cwd=ROOT).returncode == -signal.SIGKILL


@pytest.fixture
def settled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "_SETTLED_SECONDS", -1.0)


def test_what_a_killed_run_left_is_cleared_by_the_next(tmp_path: Path, settled: None) -> None:
    write(tmp_path, mine="old")
    killed(tmp_path, "(work / 'mine').write_text('half'); die()")
    assert len(list(tmp_path.glob(".polaropt-*"))) == 1
    run(tmp_path, other="new")
    assert contents(tmp_path) == {"mine": "old", "other": "new"}


def test_what_was_left_just_now_or_by_another_user_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / ".polaropt-left").mkdir()
    run(tmp_path, one="1")
    assert (tmp_path / ".polaropt-left").is_dir()
    monkeypatch.setattr(results, "_SETTLED_SECONDS", -1.0)
    if hasattr(os, "geteuid"):
        monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
        run(tmp_path, one="1")
        assert (tmp_path / ".polaropt-left").is_dir()
        monkeypatch.undo()
        monkeypatch.setattr(results, "_SETTLED_SECONDS", -1.0)
    run(tmp_path, one="1")
    assert contents(tmp_path) == {"one": "1"}


def test_files_of_an_earlier_run_that_are_not_written_again_go(tmp_path: Path) -> None:
    write(tmp_path, mine="old", stale="old", foreign="kept")
    with result_folder(tmp_path, ("mine", "stale", "never")) as work:
        write(work, mine="new")
    assert contents(tmp_path) == {"foreign": "kept", "mine": "new"}


def test_a_folder_above_that_appears_meanwhile_is_no_obstacle(tmp_path: Path) -> None:
    with result_folder(tmp_path / "above" / "out") as work:
        write(work, one="1")
        (tmp_path / "above").mkdir()
    assert contents(tmp_path / "above" / "out") == {"one": "1"}


def test_what_was_left_and_cannot_be_removed_is_in_nobody_s_way(
    tmp_path: Path, settled: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried, remove = [], os.unlink

    def refused(path: str, **more: int) -> None:
        if path == "stuck":
            tried.append(path)
            raise PermissionError(13, "Permission denied")
        remove(path, **more)

    for name in ("a", "b"):
        (tmp_path / f".polaropt-{name}").mkdir()
        write(tmp_path / f".polaropt-{name}", stuck="")
    monkeypatch.setattr(os, "unlink", refused)
    run(tmp_path, other="new")
    assert (tmp_path / "other").read_text() == "new"
    assert len(tried) == 2


def test_an_exchange_that_was_killed_midway_is_finished(tmp_path: Path, settled: None) -> None:
    write(tmp_path, a="old", b="old", c="old", stale="old", foreign="kept")
    killed(
        tmp_path,
        """
        for name in "abcd":
            (work / name).write_text("new")
        before = results._exchange
        results._exchange = lambda new, old, previous: die() if new.name == "c" else before(new, old, previous)
        """,
    )
    there = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert {"a", "b", "c", "foreign"} <= there
    with pytest.raises(RuntimeError):
        run(tmp_path, RuntimeError, mine="half")
    assert contents(tmp_path) == {"a": "new", "b": "new", "c": "new", "d": "new", "foreign": "kept"}


def test_a_file_is_there_while_it_is_exchanged(tmp_path: Path) -> None:
    write(tmp_path, picture="old")
    killed(
        tmp_path,
        """
        (work / "picture").write_text("new")
        Path.rename = lambda self, to: die() if self.name == "picture" else os.rename(self, to)
        """,
    )
    assert (tmp_path / "picture").read_text() == "old"


def test_folders_of_runs_that_live_or_of_others_are_left_alone(tmp_path: Path, settled: None) -> None:
    (tmp_path / ".polaropt-file").write_text("no folder")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    write(elsewhere, precious="kept")
    (tmp_path / ".polaropt-link").symlink_to(elsewhere)
    with result_folder(tmp_path) as first:
        write(first, one="1")
        run(tmp_path, two="2")
        assert contents(first) == {"one": "1"}
    assert contents(elsewhere) == {"precious": "kept"}
    assert {path.name for path in tmp_path.iterdir()} == {".polaropt-file", ".polaropt-link", "elsewhere", "one", "two"}


def test_names_of_an_exchange_stay_in_their_folder(tmp_path: Path, settled: None) -> None:
    left = tmp_path / "out" / ".polaropt-left"
    left.mkdir(parents=True)
    write(tmp_path, precious="kept")
    write(left, **{"polaropt-exchange.json": json.dumps({"names": [], "stale": ["../precious"]})})
    run(tmp_path / "out", one="1")
    assert (tmp_path / "precious").read_text() == "kept"
    assert contents(tmp_path / "out") == {"one": "1"}


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), OSError("8 requested and 3 written")])
def test_a_full_disk_is_told_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: OSError) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
    with pytest.raises(InputError, match="out: cannot be written"), result_folder(tmp_path / "out"):
        raise error
    assert not list(tmp_path.iterdir())


def test_another_failure_keeps_its_traceback(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="no disk"), result_folder(tmp_path / "out"):
        raise OSError("no disk")
