"""How the command line speaks, to whom, and what it leaves behind when it is interrupted."""

from __future__ import annotations

import io
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest
import rich.progress
import typer

import polaropt.cli
from polaropt.__main__ import main as begin
from polaropt.cli.app import app, main
from polaropt.cli.command import count_bar
from polaropt.interruption import terminations, waited_for
from tests.command_line import QUICK, spoken

ROOT = Path(__file__).parents[2]
COMMANDS = ("demo", "simulate", "inspect", "estimate", "separate")
PANE = ["--incidence", "65", "--azimuth", "30", "--shift", "4", "--panes", "1"]
HEAVY = ("scipy", "skimage", "torch", "nlopt", "matplotlib")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_explains_with_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = spoken(capsys, command, "--help")
    assert f"Example: polaropt {command}" in said
    assert "Usage" in said


@pytest.mark.parametrize("command", ["", *COMMANDS, "train", "batch", "sequence", "app", "calibrate"])
def test_help_names_no_types_of_python(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = spoken(capsys, *filter(None, [command]), "--help")
    assert not re.search(r"<\w+(\[\w+\])?>|Path|9223372036854775807", said)


def test_a_command_that_is_meant_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["separat"]) == 2
    assert capsys.readouterr().err.endswith("Did you mean 'separate'? See polaropt --help\n")


def test_options_of_an_example_exist() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    shown = 0
    for name, command in commands.items():
        _, _, example = (command.epilog or "").partition("Example: polaropt ")
        known = {text for parameter in command.params for text in (*parameter.opts, *parameter.secondary_opts)}
        # `study` hands all of them on.
        assert not known or {word for word in example.split() if word.startswith("-")} <= known, name
        shown += bool(example)
    assert shown >= len(COMMANDS)


def test_extras_are_named_in_full(capsys: pytest.CaptureFixture[str]) -> None:
    assert "polaropt[app]" in spoken(capsys, "app", "--help")


def test_help_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    said = spoken(capsys, "--help")
    assert all(command in said for command in COMMANDS)
    assert spoken(capsys, "--version").startswith("polaropt 0.")


def test_help_is_cheap() -> None:
    code = (
        f"import sys; from polaropt.cli.app import main; main(['--help']); "
        f"print(*(name for name in {HEAVY!r} if name in sys.modules), file=sys.stderr)"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stderr.split() == []


def test_a_pipe_sees_no_progress_bar(
    small_photographs: list[str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["separate", *small_photographs, "-o", str(tmp_path), *PANE, *QUICK]) == 0
    said = capfd.readouterr()
    assert said.err == ""
    assert said.out.startswith("Pane: ")
    assert not set("\x1b\r━") & set(said.out)


def test_each_stage_of_many_captures_has_a_time_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    bars: list[rich.progress.Progress] = []

    class Kept(rich.progress.Progress):
        def __init__(self, *columns: Any, **options: Any) -> None:
            super().__init__(*columns, **options, get_time=lambda: now[0])
            bars.append(self)

    monkeypatch.setattr(rich.progress, "Progress", Kept)
    monkeypatch.setattr("polaropt.cli.command._on_a_terminal", lambda: True)
    with count_bar(10, "Separating") as told:
        assert told is not None
        for number in range(11):
            told(number, 0, "Finding the scene")
            now[0] += 60.0
        (task,) = bars[0].tasks
        assert task.finished
        for number in range(4):
            told(number, 0)
            now[0] += 100.0
        # Seconds of all that are left, though each takes longer than such bars look back.
        assert (task.description, task.finished, task.time_remaining) == ("Separating", False, 700)


def test_a_terminal_sees_a_progress_bar(
    small_photographs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = [*PANE, "--write", "layers", *QUICK]
    ours, theirs = pty.openpty()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with ThreadPoolExecutor(1) as reader, os.fdopen(theirs, "w") as terminal, monkeypatch.context() as patched:
        seen = reader.submit(_read_all, ours)
        patched.setattr(sys, "stdout", terminal)
        patched.setattr(sys, "stderr", terminal)
        assert main(["separate", *small_photographs, "-o", str(tmp_path), *given]) == 0
    assert "━".encode() in seen.result()
    assert b"Pane: " in seen.result()


def _read_all(terminal: int) -> bytes:
    """All that comes through a terminal until its other end is closed."""
    seen = b""
    with os.fdopen(terminal, "rb", buffering=0) as opened, suppress(OSError):
        while chunk := opened.read(4096):
            seen += chunk
    return seen


def test_a_failing_run_leaves_the_previous_output(
    small_photographs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "transmission.png").write_text("previous")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("polaropt.separation.separate", interrupted)
    assert main(["separate", *small_photographs, "-o", str(out)]) == 130
    assert capsys.readouterr().err == "polaropt: interrupted; nothing was written\n"
    assert [path.name for path in out.iterdir()] == ["transmission.png"]
    assert (out / "transmission.png").read_text() == "previous"
    assert main(["separate", *small_photographs, "-o", str(tmp_path / "new")]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.usefixtures("heard_keys")
@pytest.mark.parametrize("moment", ["Estimating the scene", "Closed form", "Solving"])
def test_ctrl_c_leaves_the_previous_output(
    moment: str,
    small_photographs: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "report.json").write_text("previous")
    told: list[str] = []

    def press(stage: str, fraction: float) -> None:
        told.append(stage)
        # Not when the solve begins: when the solver calls back.
        if stage == moment and (moment != "Solving" or told.count(stage) == 3):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("polaropt.cli.command.progress_bar", lambda wanted: nullcontext(press))
    pane = ["--panes", "1"] if moment == "Estimating the scene" else PANE
    assert main(["separate", *small_photographs, *pane, "-o", str(tmp_path)]) == 130
    assert told[-1] == moment
    assert capsys.readouterr().err == "polaropt: interrupted; nothing was written\n"
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]
    assert (tmp_path / "report.json").read_text() == "previous"


@pytest.mark.parametrize("heard", [True, False])
def test_an_interrupted_study_is_waited_for_and_not_said_to_have_written_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], heard: bool
) -> None:
    waits: list[int] = []

    class Study:
        def __init__(self, command: list[str], env: dict[str, str]) -> None:
            assert command[1:3] == ["-m", "studies"]
            assert env["PYTHONSAFEPATH"]

        def wait(self) -> int:
            waits.append(1)
            if heard and len(waits) == 1:
                raise KeyboardInterrupt
            return 130

    monkeypatch.setattr("polaropt.cli.study.subprocess.Popen", Study)
    assert main(["study", "coverage", "-o", "out"]) == 130
    assert capsys.readouterr().err == "polaropt: interrupted; what the study has written stays\n"
    assert len(waits) == (2 if heard else 1)


def test_a_run_that_is_asked_to_end_leaves_nothing(small_photographs: list[str], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "polaropt", "separate", *small_photographs, "-o", str(tmp_path / "out")]
    # What started the tests may ignore a closed terminal, and what it starts does so, too.
    heard = partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heard
    ) as process:
        while process.poll() is None and not list(tmp_path.iterdir()):
            time.sleep(0.01)
        assert list(tmp_path.glob(".polaropt-*"))
        process.send_signal(signal.SIGHUP)
        out, err = process.communicate()
    assert process.returncode == 128 + signal.SIGHUP
    assert (out, err) == ("", "polaropt: interrupted; nothing was written\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_request_to_end_interrupts(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(KeyboardInterrupt), terminations() as received:
            signal.raise_signal(number)
        assert received == [number]
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)


def test_who_is_asked_to_end_twice_is_interrupted_once() -> None:
    written: list[bool] = []

    def writes_what_it_has() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGTERM)
            written.append(True)

    with pytest.raises(KeyboardInterrupt), terminations() as received:
        writes_what_it_has()
    assert written
    assert received == [signal.SIGTERM] * 2


@pytest.mark.parametrize(
    ("request_to_end", "asked"), [((signal.SIGTERM,), True), ((signal.SIGHUP,), False), ((), False)]
)
def test_who_asks_a_program_to_end_asks_those_that_it_has_started(request_to_end: tuple[int, ...], asked: bool) -> None:
    """Ctrl-C and a terminal that closes reach them by themselves."""
    told: list[str] = []

    class Started:
        def wait(self) -> int:
            told.append("wait")
            if told.count("wait") == 1:
                raise KeyboardInterrupt(*request_to_end)
            return 130

        def terminate(self) -> None:
            told.append("terminate")

    with pytest.raises(KeyboardInterrupt):
        waited_for(Started())  # type: ignore[arg-type]
    assert told == (["wait", "terminate", "wait"] if asked else ["wait", "wait"])


def test_a_study_that_is_asked_to_end_ends_with_all_that_it_has_started(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "polaropt", "study", "coverage", "--full", "-o", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "coverage" in process.stdout.readline()
        started = psutil.Process(process.pid).children(recursive=True)
        assert started
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 128 + signal.SIGTERM
        assert process.stderr is not None
        assert "polaropt: interrupted; what the study has written stays" in process.stderr.read()
    assert not psutil.wait_procs(started, 10)[1]


def test_a_program_that_minds_its_signals_keeps_them(tmp_path: Path) -> None:
    minded = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with terminations():
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, minded)
    with terminations():
        assert signal.getsignal(signal.SIGTERM) not in (signal.SIG_DFL, signal.SIG_IGN)
    assert signal.getsignal(signal.SIGTERM) is minded


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
@pytest.mark.parametrize("command", [(), ("separate",), ("sequence",)])
def test_help_is_read_in_any_encoding(encoding: str, command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    # As of PYTHONIOENCODING=ascii, or a pipe in the C locale.
    with io.TextIOWrapper(io.BytesIO(), encoding=encoding) as pipe:
        monkeypatch.setattr(sys, "stdout", pipe)
        assert main([*command, "--help"]) == 0
        assert pipe.errors == "strict"
        pipe.flush()
        said = pipe.buffer.getvalue().decode(encoding)  # type: ignore[attr-defined]
    assert "Usage: polaropt" in said
    assert "\\u2026" not in said


@pytest.mark.parametrize("lacking", ["stdout", "stderr"])
def test_a_command_runs_without_a_terminal_or_pipe(
    lacking: str, small_photographs: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, lacking, None)  # as `>&-` has it
    assert main(["inspect", *small_photographs]) == 0
    assert main(["inspect", "nofile.png"]) == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("form", ["--json", "--no-match", "--help"])
def test_a_full_disk_behind_the_pipe_is_told_in_a_line(
    form: str, small_photographs: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["estimate", *small_photographs, *PANE, form]
    with open(os.open("/dev/full", os.O_WRONLY), "wb", buffering=0) as full:
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(full, write_through=True))
        assert main(command) == 2
        sys.stdout.detach()  # type: ignore[attr-defined]
    assert "standard output cannot be written (No space left on device)" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "darwin", reason="its names of files are UTF-8")
def test_names_in_no_encoding_are_told(
    small_photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shots = tmp_path / os.fsdecode(b"caf\xe9")
    shots.mkdir()
    for name in small_photographs:
        shutil.copy(name, shots)
    files = sorted(map(str, shots.iterdir()))
    assert "caf\\udce9" in spoken(capsys, "separate", *files, *PANE, *QUICK, "-o", str(shots / "out"))
    assert (shots / "out" / "report.html").is_file()
    told = ["--write", "layers", "--workers", "1", "-o", str(shots / "many")]
    assert "1 of 1 captures" in spoken(capsys, "batch", *files, *PANE, *QUICK, *told)
    assert "caf\\udce9" in (shots / "many" / "summary.csv").read_text()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["separate", "a.png", "-o", ""], "-o is empty"),
        (["study", "coverage", "--out="], "--out is empty"),
        (["batch", ""], "a name is empty"),
    ],
)
def test_what_is_empty_is_not_taken_for_this_folder(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith(f"polaropt: {named}; ")


def test_ctrl_c_while_the_command_line_is_loaded_is_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupting:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "polaropt.cli.app":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "polaropt.cli.app")
    monkeypatch.delattr(polaropt.cli, "app")
    monkeypatch.delitem(vars(polaropt.cli), "main", raising=False)  # kept from the first look
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    assert begin(["--version"]) == 130
    assert capsys.readouterr().err == "polaropt: interrupted; nothing was written\n"
