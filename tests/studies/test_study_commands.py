"""All studies by one command: who works on what, and what is told of those that fail."""

from __future__ import annotations

from importlib.util import find_spec
from types import SimpleNamespace

import pytest

from studies.__main__ import main
from studies.catalogue import STUDIES
from studies.kit.run import study_parser


@pytest.fixture
def started(monkeypatch):
    """Commands that were started, by the study's name; none runs, those named in `codes` fail."""
    commands, codes = {}, {}

    def run(name, rest, out):
        commands[name] = list(rest)
        (out / name).mkdir()
        return codes.get(name, 0)

    monkeypatch.setattr("studies.__main__._run", run)
    return SimpleNamespace(commands=commands, codes=codes)


@pytest.mark.parametrize("arguments", [[], ["--help"]])
def test_without_a_name_the_studies_are_listed_with_their_questions(arguments, capsys):
    assert main(arguments) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert [tuple(line) for line in lines[:-1]] == [(study.name, study.question) for study in STUDIES]


def test_every_study_is_a_program():
    for study in STUDIES:
        found = find_spec(f"studies.{study.name}")
        assert found is not None
        assert not found.submodule_search_locations or find_spec(f"studies.{study.name}.__main__") is not None


def test_all_share_the_cores_but_those_about_seconds(started, tmp_path):
    assert main(["all", "--full", "-o", str(tmp_path)]) == 0
    assert list(started.commands) == [study.name for study in STUDIES]
    alone = {study.name for study in STUDIES if study.timed}
    assert alone == {"benchmark", "many_captures", "sequences", "speed_accuracy"}
    assert {name for name, command in started.commands.items() if "--workers" not in command} == alone
    assert "--full" in started.commands["benchmark"]


def test_a_number_of_processes_holds_for_all_but_them(started, tmp_path):
    main(["all", "--workers", "3", "-o", str(tmp_path)])
    assert started.commands["stability"] == ["--workers", "3"]
    assert "--workers" not in started.commands["benchmark"]


def test_a_look_needs_no_processes_of_its_own(started, tmp_path):
    main(["all", "--quick", "-o", str(tmp_path)])
    assert not any("--workers" in command for command in started.commands.values())


def test_one_study_has_the_processes_that_are_asked_for(started, tmp_path):
    main(["benchmark", "--workers", "2", "-o", str(tmp_path)])
    assert started.commands == {"benchmark": ["--workers", "2"]}


def test_what_fails_does_not_end_the_others_and_is_told(started, tmp_path, capsys):
    started.codes.update(stability=-9)
    assert main(["all", "-o", str(tmp_path)]) == 9
    assert len(started.commands) == len(STUDIES)
    assert "failed: stability" in capsys.readouterr().out
    assert (tmp_path / "index.html").is_file()


def test_among_all_only_those_that_know_an_input_are_given_it(started, tmp_path):
    assert main(["all", "--records", "trained", "-o", str(tmp_path)]) == 0
    assert [name for name, given in started.commands.items() if "--records" in given] == ["ablation_losses"]


def test_a_study_alone_is_given_all_there_is(started, tmp_path):
    assert main(["coverage", "--records", "trained", "-o", str(tmp_path)]) == 0
    assert started.commands["coverage"][:2] == ["--records", "trained"]


def test_a_file_is_no_folder_of_results(started, tmp_path, capsys):
    (tmp_path / "file").write_text("precious")
    assert main(["coverage", "-o", str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err == f"polaropt: --out is {str(tmp_path / 'file')!r}, which is a file; give a folder\n"
    assert not started.commands


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--pairs", "-1", "give a whole number from 1 on"),
        ("--pairs", "some", "give a whole number from 1 on"),
        ("--workers", "-3", "give a whole number from 0 on"),
        ("--photos", "nowhere", "is no folder"),
    ],
)
def test_numbers_and_folders_that_cannot_be_are_refused_in_a_line(option, value, said, capsys):
    with pytest.raises(SystemExit) as ended:
        study_parser("Anything.").parse_args(["-o", "out", option, value])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
