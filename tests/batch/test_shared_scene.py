"""Captures behind one pane tell its scene together, more exactly than each alone, and which of them disagrees."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from polaropt import SceneParameters, simulate
from polaropt.batch import run
from polaropt.batch.cluster import Place
from polaropt.batch.job import Job, Options, Row
from polaropt.batch.shared_scene import Estimate, combine_scenes
from polaropt.capture.files.write import write_capture
from polaropt.cli.app import main
from polaropt.errors import InputError
from polaropt.optics import SceneErrors
from polaropt.reporting import json_values, scene_of_report

TRUE = SceneParameters(60.0, 20.0, 4.0)


def estimates(n: int, seed: int = 0, error: float = 0.5) -> list[Estimate | None]:
    random = np.random.default_rng(seed)
    found: list[Estimate | None] = []
    for _ in range(n):
        incidence, azimuth, shift = np.array(TRUE.values()) + random.standard_normal(3) * (error, 0.2, 0.1)
        scene = TRUE.replace(incidence_deg=float(incidence), azimuth_deg=float(azimuth), ghost_shift=float(shift))
        found.append(Estimate(scene, SceneErrors(incidence_deg=error, azimuth_deg=0.2, ghost_shift=0.1)))
    return found


def test_errors_fall_with_the_root_of_the_number() -> None:
    for n in (1, 4, 16):
        shared = combine_scenes(estimates(n))
        assert shared.errors.incidence_deg is not None
        assert shared.errors.incidence_deg == pytest.approx(0.5 / n**0.5, rel=0.5)
        assert shared.n_captures == n


def test_stated_errors_hold() -> None:
    off = []
    for seed in range(200):
        shared = combine_scenes(estimates(8, seed))
        assert shared.scene.incidence_deg is not None
        assert shared.errors.incidence_deg is not None
        off.append((shared.scene.incidence_deg - 60) / shared.errors.incidence_deg)
    assert 0.8 < np.std(off) < 1.1
    # Hardly one of 1600 captures disagrees by chance, and none pulls the mean.
    assert sum(len(combine_scenes(estimates(8, seed)).disagreements) for seed in range(200)) <= 4


def test_a_capture_that_disagrees_is_named_and_left_out() -> None:
    told = estimates(6)
    told[3] = Estimate(TRUE.replace(incidence_deg=66.0), SceneErrors(0.5, 0.2, 0.1))
    shared = combine_scenes(told)
    assert [(one.capture, one.field) for one in shared.disagreements] == [(3, "incidence_deg")]
    assert shared.scene.incidence_deg == pytest.approx(60, abs=0.7)
    told[3] = Estimate(TRUE.replace(focal_px=500.0), SceneErrors(0.5, 0.2, 0.1, focal_px=20.0))
    assert [(one.capture, one.field) for one in combine_scenes(told).disagreements] == [(3, "rung")]


def test_errors_without_bound_say_nothing() -> None:
    told = estimates(3)
    told[0] = Estimate(TRUE.replace(ghost_shift=-9.0), SceneErrors(0.5, 0.2, float("inf")))
    shared = combine_scenes(told)
    assert shared.scene.ghost_shift == pytest.approx(4, abs=0.4)
    assert not shared.disagreements


def test_the_same_pane_the_other_way_round_is_the_same() -> None:
    errors = SceneErrors(0.5, 0.2, 0.1)
    told = [Estimate(TRUE.replace(azimuth_deg=89.9), errors)]
    told.append(Estimate(TRUE.replace(azimuth_deg=-89.9, ghost_shift=-4.0), errors))
    shared = combine_scenes(told)
    assert shared.scene.azimuth_deg == pytest.approx(90)
    assert shared.scene.ghost_shift == pytest.approx(4)
    assert not shared.disagreements


def test_captures_that_tell_nothing_are_left_out() -> None:
    told = estimates(2)
    without = [None, Estimate(TRUE.replace(signal=False), SceneErrors())]
    assert combine_scenes([*told, *without]).n_captures == 2
    with pytest.raises(InputError, match="no capture shows polarization"):
        combine_scenes(without)


def test_a_batch_shares_a_scene(tmp_path: Path) -> None:
    from skimage.data import astronaut, coffee

    for number, (row, incidence) in enumerate(((150, 62), (180, 62), (210, 62), (170, 40))):
        behind, before = coffee()[row : row + 96, 200:296], astronaut()[row - 120 : row - 24, 160:256]
        scene = SceneParameters(float(incidence), 25.0, 4.0)
        write_capture(simulate(behind, before, scene, noise=0.003, seed=number), tmp_path / f"{number}.npz")
    out = tmp_path / "out"
    arguments = ["batch", str(tmp_path / "*.npz"), "-o", str(out), "-q", "--workers", "1", "--layers-only"]
    arguments += ["--azimuth", "25", "--shift", "4", "--panes", "1"]
    for _ in range(2):
        assert main([*arguments, "--shared-scene", "--model", "ghosts", "--max-evaluations", "2"]) == 0
        told = json.loads((out / "scene.json").read_text())
        assert told["captures"] == 4
        assert {one["capture"] for one in told["disagreements"]} == {"3"}
        assert told["scene"]["incidence_deg"] == pytest.approx(62, abs=4 * told["errors"]["incidence_deg"])
        reports = [json.loads((out / str(number) / "report.json").read_text()) for number in range(4)]
        assert {report["scene"]["incidence_deg"] for report in reports} == {told["scene"]["incidence_deg"]}
        assert reports[0]["errors"]["incidence_deg"] == pytest.approx(told["errors"]["incidence_deg"])
    assert "SCENE_DISAGREES" in (out / "summary.csv").read_text()
    assert scene_of_report(out / "scene.json", (96, 96)).incidence_deg == told["scene"]["incidence_deg"]
    assert scene_of_report(out / "scene.json", (192, 192)).ghost_shift == 8


def test_captures_of_other_sizes_share_a_scene_in_pixels_of_their_own() -> None:
    shapes = ((96, 128), (48, 64), (96, 128), (96, 96))
    told = [Estimate(one.scene, one.errors, shape) for one, shape in zip(estimates(4), shapes, strict=True) if one]
    told[1] = Estimate(told[1].scene.scaled(0.5), told[1].errors.scaled(0.5), (48, 64))
    shared = combine_scenes(told)
    assert (shared.n_captures, shared.shape, shared.disagreements) == (3, (96, 128), ())
    assert shared.scene.ghost_shift == pytest.approx(4, abs=0.2)
    small = shared.seen_by((48, 64))
    assert small.scene.ghost_shift == pytest.approx(shared.scene.ghost_shift / 2)
    assert small.errors.ghost_shift == pytest.approx(shared.errors.ghost_shift / 2)
    with pytest.raises(InputError, match="has 96x96 px, and most that share a scene 128x96"):
        shared.seen_by((96, 96))


def test_a_capture_that_cannot_share_the_scene_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def estimated(job: Job, memory: int | None = None) -> Row:
        if job.name == "unread":
            return Row(job.name, job.files, "failed", "a.png: cannot be read")
        scene, errors = json_values(TRUE), json_values(SceneErrors(incidence_deg=0.5))
        return Row(job.name, job.files, "estimated", scene=scene, errors=errors, shape=shapes[job.name])

    def separated(job: Job, memory: int | None = None) -> Row:
        if job.problem or job.name == "unread":
            return Row(job.name, job.files, "failed", job.problem)
        scene = job.options.separating["scene"]
        return Row(job.name, job.files, "done", scene={"rung": "ghosts", "ghost_shift": scene.ghost_shift})

    monkeypatch.setattr(run, "estimate_files", estimated)
    monkeypatch.setattr(run, "separate_files", separated)
    shapes = {"a": (96, 96), "b": (96, 96), "half": (48, 48), "wide": (48, 96)}

    def outcome(*names: str) -> run.Outcome:
        jobs = [Job(name, (f"{name}.png",), str(tmp_path / name), Options()) for name in names]
        return run.run_batch(jobs, tmp_path, Place(), shared_scene=True)

    rows = {row.name: row for row in outcome("a", "b", "half", "wide", "unread").rows}
    assert {name: row.scene.get("ghost_shift") for name, row in rows.items() if row.status == "done"} == {
        "a": 4,
        "b": 4,
        "half": 2,
    }
    assert "has 96x48 px" in rows["wide"].message
    # Where none can be read each is named.
    assert [row.name for row in outcome("unread").failed] == ["unread"]


def test_an_interruption_while_the_scene_is_looked_for_leaves_the_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(job: Job, memory: int | None = None) -> Row:
        raise KeyboardInterrupt

    (tmp_path / "summary.csv").write_text("of before")
    monkeypatch.setattr(run, "estimate_files", interrupted)
    job = Job("a", ("a.png",), str(tmp_path / "a"), Options())
    assert run.run_batch([job], tmp_path, Place(), shared_scene=True).interrupted
    assert (tmp_path / "summary.csv").read_text() == "of before"
    (tmp_path / "a.png").write_bytes(b"")
    assert main(["batch", str(tmp_path / "a.png"), "-o", str(tmp_path), "--shared-scene", "--workers", "1"]) == 130
    said = capsys.readouterr()
    assert (said.out, "1 of 1 captures are left" in said.err) == ("0 of 1 captures are separated.\n", True)
