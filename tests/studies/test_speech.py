"""What studies say before they do anything: options, what is not installed, and tables."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from solvers.kernels import core_count
from studies import catalogue
from studies.__main__ import main
from studies.kit.run import study_parser, workers_of
from studies.kit.speech import say_tables

TABLE = "| noise | T |\n|---|---|\n| 0.01 | 41.2 |"


@pytest.mark.parametrize(("arguments", "code"), [(["--help"], 0), (["--quick", "-o", "out"], 2)])
def test_what_is_not_installed_is_said_before_the_first_job(monkeypatch, capsys, arguments, code):
    monkeypatch.setattr(catalogue, "find_spec", lambda name: None if name == "pandas" else find_spec(name))
    monkeypatch.setattr("studies.__main__._run", lambda *_: pytest.fail("it was started"))
    assert main(["coverage", *arguments]) == code
    said = capsys.readouterr()
    last = (said.err if code else said.out).splitlines()[-1]
    assert "pandas" in last
    assert "pip install 'polaropt[studies]'" in last


def test_studies_of_networks_name_both_extras(monkeypatch, capsys):
    monkeypatch.setattr(catalogue, "find_spec", lambda name: None)
    assert main(["learned_init", "-o", "out"]) == 2
    assert "polaropt[studies,torch]" in capsys.readouterr().err


def test_the_help_of_a_study_speaks_as_that_of_the_other_commands(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["studies/coverage.py"])
    with pytest.raises(SystemExit) as end:
        study_parser("Do the errors hold?").parse_args(["--help"])
    said = capsys.readouterr().out
    assert end.value.code == 0
    assert "Usage: polaropt study coverage [OPTIONS]" in said
    assert "─ Options ─" in said
    assert "Do the errors hold?" in said
    for option in ("--quick", "--full", "--photos", "--workers", "--out", "FOLDER"):
        assert option in said


def test_a_wrong_option_is_told_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["studies/benchmark/__main__.py"])
    with pytest.raises(SystemExit) as end:
        study_parser("A study.").parse_args(["-o", "out", "--nonsense"])
    assert end.value.code == 2
    assert capsys.readouterr().err == (
        "polaropt: unrecognized arguments: --nonsense; see polaropt study benchmark --help\n"
    )


def test_tables_are_drawn_for_people_alone(monkeypatch, capsys):
    say_tables(TABLE)
    assert capsys.readouterr().out == TABLE + "\n"
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    say_tables(TABLE)
    said = capsys.readouterr().out
    assert "41.2" in said
    assert "|" not in said


def test_cores_are_counted_where_the_system_does_not_tell_them(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert core_count() == (os.cpu_count() or 1)
    assert workers_of(argparse.Namespace(workers=0, scheduler=None)).processes == core_count()


def test_what_lies_in_the_folder_does_not_get_in_the_way(tmp_path):
    tmp_path.joinpath("solvers.py").write_text("raise RuntimeError('not the solvers')")
    tmp_path.joinpath("studies").mkdir()
    tmp_path.joinpath("studies", "__init__.py").write_text("raise RuntimeError('not the studies')")
    code = "from polaropt.cli.app import main; raise SystemExit(main(['study']))"
    house = str(Path(catalogue.__file__).parent.parent)
    run = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": house},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "coverage" in run.stdout


@pytest.mark.parametrize(("name", "near"), [("ablations", "did you mean ablation or ablation_losses?"), ("nois", "")])
def test_a_study_that_does_not_exist_is_told_in_one_line_with_those_that_may_be_meant(capsys, name, near):
    assert main([name, "-o", "out"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"polaropt: there is no study '{name}'; {near}")
    assert said.count("\n") == 1


@pytest.mark.parametrize("output", [[], ["-o", ""]])
def test_the_folder_of_a_study_is_asked_for_in_one_line(capsys, output):
    assert main(["coverage", *output]) == 2
    assert capsys.readouterr().err == "polaropt: the study's results need a folder; give its name: -o OUT\n"


def test_a_list_of_studies_may_be_cut_short():
    command = [sys.executable, "-m", "studies"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as listing:
        listing.stdout.close()  # as `| head -1` may be done before the first line
        assert listing.stderr.read() == ""
    assert listing.returncode == 1
