"""Many captures: each as alone, what failed is named, what is done is not done again."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from polaropt.batch import cluster, sheet
from polaropt.batch.cluster import Place
from polaropt.batch.job import Job, Options, Row, needed_memory, separate_files
from polaropt.batch.journal import Journal
from polaropt.batch.run import run_batch
from polaropt.batch.sheet import write_sheet
from polaropt.batch.summary import write_summary
from polaropt.capture.files.write import write_capture
from polaropt.cli.app import main
from polaropt.errors import InputError
from polaropt.judging import SeparationWarning
from polaropt.reporting import LAYERS
from tests.browser import dom_of
from tests.captured import photographed
from tests.command_line import QUICK, RESULTS

PLAIN = ["--model", "pixelwise", "--panes", "1", *QUICK]
LAYERS_ONLY = {*(f"{name}.{kind}" for name in LAYERS for kind in ("tiff", "png")), "report.json", "thumbnail.jpg"}


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two captures of four photographs, one without its last, and one that cannot be read."""
    folder = tmp_path_factory.mktemp("shots")
    for number in range(2):
        write_capture(photographed((48, 48), bits=12, seed=number), folder / f"{number}.png")
    write_capture(photographed((48, 48)), folder / "three.png")
    (folder / "three_135.png").unlink()
    (folder / "broken.png").write_text("no image")
    return folder


KNOWN = json.dumps(
    {
        "input": {"width": 96, "height": 96},
        "scene": {"incidence_deg": 60.0, "azimuth_deg": 20.0, "ghost_shift": 3.0, "gap_shift": 0.0, "absorption": 0.0},
    }
)


def rows_of(out: Path) -> dict[str, dict[str, str]]:
    with (out / "summary.csv").open(encoding="utf-8", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def batch(*arguments: str | Path) -> int:
    return main(["batch", *map(str, arguments), "--workers", "1", *PLAIN])


def test_a_batch_separates_names_failures_and_goes_on(
    shots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert batch(shots, "-o", out) == 3
    said = capsys.readouterr()
    assert "2 of 4 captures are separated." in said.out
    assert "three: " in said.out
    assert "135 missing" in said.out
    assert "broken.png: not a" in said.out
    assert said.err == ""
    assert {path.name for path in (out / "0").iterdir()} == {*RESULTS, "thumbnail.jpg"}
    rows = rows_of(out)
    assert [rows[name]["status"] for name in ("0", "1", "three", "broken")] == ["done", "done", "failed", "failed"]
    assert float(rows["0"]["incidence_deg"]) > 0
    assert float(rows["0"]["misfit"]) > 0
    assert rows["broken"]["message"].count("\n") == 0

    written = (out / "0" / "report.json").stat().st_mtime_ns
    shutil.copy(shots / "0_135.png", tmp_path / "kept.png")
    shutil.copy(shots / "0_135.png", shots / "three_135.png")
    try:
        assert batch(shots, "-o", out, "--json") == 3
    finally:
        (shots / "three_135.png").unlink()
    told = json.loads(capsys.readouterr().out)
    assert (told["captures"], told["separated"], told["reused"]) == (4, 3, 2)
    assert (out / "0" / "report.json").stat().st_mtime_ns == written


def test_a_capture_of_a_batch_is_as_alone(shots: Path, tmp_path: Path) -> None:
    four = [str(shots / f"0_{angle}.png") for angle in ("000", "045", "090", "135")]
    assert main(["separate", *four, "-o", str(tmp_path / "alone"), "-q", *PLAIN]) == 0
    assert batch(shots / "0_*.png", "-o", tmp_path / "many", "-q", "--layers-only") == 0
    assert {path.name for path in (tmp_path / "many" / "0").iterdir()} == LAYERS_ONLY
    for layer in ("transmission", "reflection"):
        alone, among = (tifffile.imread(tmp_path / place / f"{layer}.tiff") for place in ("alone", "many/0"))
        np.testing.assert_array_equal(alone, among)


def test_a_table_gives_captures_options_of_their_own(shots: Path, tmp_path: Path) -> None:
    files = ";".join(f"{shots}/0_{angle}.png" for angle in ("000", "045", "090", "135"))
    (tmp_path / "table.csv").write_text(f"name,files,incidence\nfree,{files},\ntold,{files},61\n")
    assert batch(tmp_path / "table.csv", "-o", tmp_path / "out", "-q", "--layers-only") == 0
    report = json.loads((tmp_path / "out" / "told" / "report.json").read_text())
    assert report["scene"]["incidence_deg"] == 61
    assert "incidence_deg" not in report["estimated"]


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [("incidence", "steep", "line 2: incidence is 'steep'"), ("solver", "magic", "line 2: --solver 'magic'")],
)
def test_a_wrong_option_in_a_table_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], column: str, value: str, words: str
) -> None:
    (tmp_path / "table.csv").write_text(f"files,{column}\na.png,{value}\n")
    assert batch(tmp_path / "table.csv", "-o", tmp_path / "out") == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_that_options_of_a_table_name_lie_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "table.csv").write_text("files,scene\na.png,known.json\n")
    (tmp_path / "tables" / "known.json").write_text(KNOWN)
    monkeypatch.chdir(tmp_path)
    # The scene is read, and the photograph is missing.
    assert main(["batch", "tables/table.csv", "-o", "out", "-q", "--workers", "1"]) == 3
    assert "a.png: no such file" in (tmp_path / "out" / "summary.csv").read_text()


def test_a_name_that_no_file_system_takes_fails_alone(shots: Path, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(f"name,files\n{'n' * 300},{shots}/0_000.png\nb,nothing.png\n")
    assert batch(tmp_path / "table.csv", "-o", tmp_path / "out", "-q", "--workers", "1") == 3
    assert len(rows_of(tmp_path / "out")) == 2


def job_for(shots: Path, out: Path, name: str = "0") -> Job:
    files = tuple(str(shots / f"{name}_{angle}.png") for angle in ("000", "045", "090", "135"))
    return Job(name, files, str(out / name), Options(separating={"model": "none"}, layers_only=True))


def test_changed_files_options_and_lost_results_count_as_left(shots: Path, tmp_path: Path) -> None:
    job = job_for(shots, tmp_path)
    outcomes = [run_batch([job], tmp_path, Place()) for _ in range(2)]
    assert [outcome.reused for outcome in outcomes] == [0, 1]
    other = replace(job, options=replace(job.options, separating={"model": "none", "refractive_index": 1.4}))
    assert run_batch([other], tmp_path, Place()).reused == 0
    (tmp_path / "0" / "report.json").unlink()
    assert run_batch([other], tmp_path, Place()).reused == 0
    Path(job.files[0]).touch()
    assert run_batch([other], tmp_path, Place()).reused == 0


def test_an_interruption_leaves_a_state_to_go_on_from(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(job: Job, memory: int | None = None) -> Row:
        if job.name == "1":
            raise KeyboardInterrupt
        return separate_files(job, memory)

    with monkeypatch.context() as patched:
        patched.setattr("polaropt.batch.run.separate_files", interrupted)
        assert batch(shots / "[01]_*.png", "-o", tmp_path, "--layers-only") == 130
    assert "1 of 2 captures are left, the same command goes on" in capsys.readouterr().err
    assert list(rows_of(tmp_path)) == ["0"]
    assert batch(shots / "[01]_*.png", "-o", tmp_path, "--layers-only", "--json") == 0
    assert json.loads(capsys.readouterr().out)["reused"] == 1


def test_a_failure_beside_results_of_an_earlier_run_is_told_as_such(shots: Path, tmp_path: Path) -> None:
    job = job_for(shots, tmp_path)
    run_batch([job], tmp_path, Place())
    of_cells = replace(job, options=replace(job.options, reading={"resolution": "cell"}))
    (row,) = run_batch([of_cells], tmp_path, Place()).rows
    assert row.status == "failed"
    assert row.message.endswith("; its folder holds results of an earlier run")


def test_a_half_written_line_of_the_journal_does_no_harm(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.add(Row("a", ("a.png",), "done"))
    with (tmp_path / "batch.jsonl").open("a") as file:
        file.write('{"name": "b", "fi')
    with Journal(tmp_path) as journal:
        journal.add(Row("c", ("c.png",), "done"))
    with Journal(tmp_path) as journal:
        assert sorted(journal.names()) == ["a", "c"]


def test_bytes_of_no_text_in_the_journal_do_no_harm(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.add(Row("a", ("a.png",), "done"))
    with (tmp_path / "batch.jsonl").open("ab") as file:
        file.write(b'{"name": "\xff\x80", "files"\n')
    with Journal(tmp_path) as journal:
        assert list(journal.names()) == ["a"]


def test_a_warning_that_nobody_knows_is_shown_by_its_name() -> None:
    assert sheet._sentence("OF_ANOTHER_VERSION") == "OF_ANOTHER_VERSION"
    assert sheet._sentence("SOLVER_FAILED") == SeparationWarning.SOLVER_FAILED.value


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    with Journal(tmp_path), pytest.raises(InputError, match="another run"):
        Journal(tmp_path)


def test_a_bug_keeps_its_trace_and_the_others_go_on(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object, **options: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr("polaropt.separation.separate", broken)
    row = separate_files(job_for(shots, tmp_path))
    assert (row.status, row.message) == ("failed", "unexpected RuntimeError: a bug")
    assert "Traceback" in row.trace


def test_a_capture_that_does_not_fit_into_memory_is_not_begun(shots: Path, tmp_path: Path) -> None:
    job = job_for(shots, tmp_path)
    needed = needed_memory(job.options.read(job.files))
    assert separate_files(job, needed - 1).status == "too large"
    assert separate_files(job, needed).status == "done"


def test_without_the_extra_one_process_works_and_others_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    assert cluster.place_for(None, None, None, False).workers == 1
    for asked in ((None, "tcp://here:1", None), (2, None, None)):
        with pytest.raises(InputError, match=r"pip install 'polaropt\[batch\]'"):
            cluster.place_for(*asked, False)


ROWS = (
    Row("plain", ("p.png",), "done", folder="plain", scene={"rung": "ghosts", "incidence_deg": 60.0}, misfit=1.0),
    Row(
        "noisy", ("n.png",), "done", folder="noisy", scene={"rung": "ghosts"}, warnings=("NOISE_TOO_HIGH",), misfit=2.0
    ),
    Row("</script>", ("s.png",), "failed", "s.png: the file is empty; copy it again"),
)


def test_the_contact_sheet_shows_all_captures(tmp_path: Path) -> None:
    write_sheet(tmp_path, ROWS)
    page = dom_of(tmp_path / "index.html", tmp_path)
    cards = page.split('<ul id="cards">')[1].split("</ul>")[0]
    assert cards.count("<li") == 3
    assert cards.count("<img") == 2
    assert "the file is empty" in cards
    assert "3 of 3" in page


def test_the_summary_holds_a_row_for_each_capture(tmp_path: Path) -> None:
    write_summary(tmp_path, ROWS)
    rows = rows_of(tmp_path)
    assert rows["plain"]["incidence_deg"] == "60.0"
    assert rows["noisy"]["warnings"] == "NOISE_TOO_HIGH"
    assert rows["</script>"]["message"].startswith("s.png")
    pyarrow = pytest.importorskip("pyarrow.parquet")
    write_summary(tmp_path, ROWS, parquet=True)
    assert pyarrow.read_table(tmp_path / "summary.parquet").to_pylist()[0]["incidence_deg"] == 60


def test_warnings_are_counted_on_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seen = photographed((48, 48))
    alike = np.stack([seen.intensities.mean(axis=0)] * 4)
    noisy = alike + 0.005 * np.random.default_rng(0).standard_normal(alike.shape)
    write_capture(seen.replace(intensities=noisy.astype(np.float32)), tmp_path / "alike.png")
    assert batch(tmp_path / "alike_*.png", "-o", tmp_path / "out", "--write", "layers") == 0
    told = "NO_POLARIZATION in 1, REFLECTION_NOT_IDENTIFIABLE in 1 of 1 captures"
    assert f"ATTENTION: {told}; summary.csv tells which." in capsys.readouterr().out
    assert batch(tmp_path / "alike_*.png", "-o", tmp_path / "out", "--write", "layers", "--json") == 0
    assert json.loads(capsys.readouterr().out)["warnings"]["NO_POLARIZATION"] == 1
