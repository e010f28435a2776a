"""The ablation of the losses: records tell variants apart, and the page says what may be compared."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pandas import DataFrame

from polaropt.errors import InputError
from priors.networks.checkpoint import save_network
from studies.ablation_losses.figures import levels
from studies.ablation_losses.records import (
    ALL,
    NO_HEAD,
    PIXELS,
    PLAIN,
    Training,
    groups_of,
    trainings_in,
    variant_of,
)
from studies.ablation_losses.study import Job, Row, main, run
from studies.ablation_losses.tables import tables
from studies.ablation_losses.trainings import COMMAND, LONG_VARIANTS, VARIANTS, Budget, Plan, train_all
from studies.ablation_losses.trainings import main as make
from studies.kit.frames import frame_of
from studies.scenes import protocol
from tests.observations import small_network

PUBLISHED = {"pixelwise": 1.0, "perceptual": 0.1, "pse": 2.0, "edge_independence": 0.1, "adversarial": 0.1}


def record(
    polarnet: str = "compact",
    features: str | None = "encoder",
    seed: int = 0,
    head: str | None = None,
    **weights: float,
) -> dict[str, object]:
    return {
        "architecture": {"form": "paper", "polarnet": polarnet} | ({} if head is None else {"head": head}),
        "options": {"weights": {**PUBLISHED, "decibel": 0.0, **weights}, "batch_size": 4, "seed": seed},
        "perceptual_features": features,
        "steps": 100,
        "size_px": 64,
        "seconds": 60.0,
        "data": "gravel",
        "sha256": "",
    }


@pytest.mark.parametrize(
    ("made", "variant"),
    [
        (record(), ALL),
        (record(pse=0), "without pse"),
        (record(perceptual=0, features=None), "without perceptual"),
        (record(perceptual=0, pse=0, features=None), "without perceptual, without pse"),
        (record(features="pixels"), PIXELS),
        (record(polarnet="plain"), PLAIN),
        (record(head="panes"), ALL),
        (record(head="none"), NO_HEAD),
        (record(perceptual=0, pse=0, edge_independence=0, adversarial=0, decibel=0.2), "decibels and pixelwise"),
    ],
)
def test_a_record_tells_what_was_left_out(made: dict[str, object], variant: str) -> None:
    assert variant_of(made) == variant


def write(folder: Path, made: dict[str, object], seed: int = 0) -> None:
    folder.mkdir(parents=True)
    digest = save_network(folder / "weights.safetensors", small_network("paper", seed))
    (folder / "record.json").write_text(json.dumps({**made, "sha256": digest}))


def test_trainings_are_found_in_the_papers_order_and_shown_the_same_scene(tmp_path: Path) -> None:
    for name, made in (("a", record(polarnet="plain")), ("b", record(pse=0)), ("c", record())):
        write(tmp_path / name, made)
    trainings = trainings_in(tmp_path)
    assert [training.variant for training in trainings] == [ALL, "without pse", PLAIN]
    rows = run(Job(protocol(60.0), 0, None, 64, tuple(trainings)))
    # Untrained, all are the mean of the photographs.
    assert len(rows) == 3
    assert len({(row.transmission, row.reflection_ssim) for row in rows}) == 1


def test_what_is_no_record_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="no folder with"):
        trainings_in(tmp_path)
    write(tmp_path / "a", {"steps": 3})
    with pytest.raises(InputError, match="is no record of a training"):
        trainings_in(tmp_path)
    with pytest.raises(SystemExit):
        main(["--records", str(tmp_path), "-o", str(tmp_path / "out")])
    assert "is no record of a training" in capsys.readouterr().err


def test_networks_are_left_out_on_photographs_that_they_were_trained_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "a", {**record(), "data": "astronaut, gravel"})
    monkeypatch.setattr("studies.ablation_losses.study.shipped_trainings", list)
    with pytest.raises(SystemExit):
        main(["--records", str(tmp_path), "-o", str(tmp_path / "out")])
    assert "trained on astronaut; name others with --photos" in capsys.readouterr().err


ONE = Training("one", Path("w"), "", "paper", ALL, "100 steps", "encoder", 60.0)


def of_seeds(first: Training, *seeds: int) -> list[Training]:
    return [replace(first, name=f"{first.name}/seed-{seed}", seed=seed) for seed in seeds]


def frame_with(levels: dict[Training, float]) -> DataFrame:
    """Two scenes, 1 dB on both sides of each level."""
    rows = [
        Row(each.name, each.variant, pair, 60.0, level + 2 * pair - 1, 15.0, 0.8, 0.5, 0.1)
        for each, level in levels.items()
        for pair in (0, 1)
    ]
    return frame_of(Row, rows)


def text_of(levels: dict[Training, float]) -> str:
    return tables(frame_with(levels), list(levels))


def line_of(text: str, name: str) -> list[str]:
    line = next(line for line in text.splitlines() if line.startswith(f"| {name} |"))
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_seeds_of_a_variant_are_one_line_and_the_budget_of_most_comes_first() -> None:
    other = replace(ONE, name="two", variant="without pse")
    long = replace(ONE, name="long/with-head", budget="9 steps")
    shipped = replace(ONE, name="shipped, paper", budget="7 steps")
    groups = groups_of([shipped, long, *of_seeds(other, 1, 0), *of_seeds(ONE, 0, 1)])
    assert [group.name for group in groups] == ["one", "two", "long/with-head", "shipped, paper"]
    assert [each.seed for each in groups[1].trainings] == [0, 1]


def test_intervals_are_students_over_the_seeds_and_differences_are_paired_by_seed() -> None:
    first, second, third = of_seeds(ONE, 0, 1, 2)
    others = of_seeds(replace(ONE, name="two", variant="without pse"), 0, 1, 2)
    text = text_of({first: 20.0, second: 22.0, third: 24.0} | dict(zip(others, (19.1, 21.0, 22.9), strict=True)))
    # The standard deviation is 2, of the differences 0.1; t of 2 degrees of freedom is 4.303.
    assert line_of(text, "one")[2:4] == ["3", "22.00 ± 4.97"]
    cells = line_of(text, "two")
    assert cells[7] == "-1.00 ± 0.25"
    assert cells[8] == "+0.000 ± 0.000"
    assert cells[10:12] == ["26.4 / 0.842", "-1.9"]
    assert "The same budget for all: 100 steps" in text
    assert "Where an interval of a difference holds 0, no difference was seen" in text


def test_one_seed_has_no_interval() -> None:
    other = replace(ONE, name="two", variant="without pse")
    cells = line_of(text_of({ONE: 20.0, other: 19.0}), "two")
    assert (cells[3], cells[7]) == ("19.00", "-1.00")


def test_lines_of_another_budget_are_compared_with_their_own() -> None:
    long = [replace(ONE, name=f"long/{name}", variant=variant, budget="900 steps") for name, variant in
            (("with-head", ALL), ("no-head", NO_HEAD))]  # fmt: skip
    text = text_of({ONE: 20.0, long[0]: 30.0, long[1]: 26.0})
    assert "THE BUDGETS DIFFER: 100 steps; 900 steps" in text
    assert line_of(text, "long/with-head")[7] == ""
    assert line_of(text, "long/no-head")[7] == "-4.00"


def test_the_chart_has_bars_for_intervals() -> None:
    trainings = [*of_seeds(ONE, 0, 1), *of_seeds(replace(ONE, name="two", variant=NO_HEAD), 0, 1)]
    frame = frame_with(dict(zip(trainings, (20.0, 21.0, 18.0, 18.5), strict=True)))
    (bars,) = (each for each in levels(frame, trainings).axes[0].containers if getattr(each, "errorbar", None))
    first, _ = (segment[:, 0].tolist() for segment in bars.errorbar.lines[2][0].get_segments())
    # Student's t of one degree of freedom is 12.706, the mean's standard error 0.5.
    assert first == pytest.approx([20.5 - 6.353, 20.5 + 6.353], abs=1e-3)


def test_without_records_it_says_how_to_make_them() -> None:
    text = text_of({replace(ONE, name="shipped, paper"): 20.0})
    assert COMMAND in text
    assert "| without pse | 26.4 / 0.842 |" in text


def plan(folder: Path) -> Plan:
    return Plan(
        folder,
        folder / "samples",
        Budget(2, 2, 3),
        Budget(3, 1, 4),
        seeds=(0, 1),
        variants=("all", "no-head"),
        size_px=32,
        leaves=1,
    )


def test_all_variants_seeds_and_budgets_are_planned_with_the_longest_first(tmp_path: Path) -> None:
    jobs = replace(plan(tmp_path), variants=tuple(VARIANTS), seeds=(0, 1, 2)).all()
    names = [job.folder.relative_to(tmp_path).as_posix() for job in jobs]
    assert names[: len(LONG_VARIANTS)] == ["long/with-head", "long/no-head"]
    assert len(set(names)) == len(jobs) == 2 + 3 * 9
    assert {job.options.steps for job in jobs[2:]} == {2}
    assert {job.store.folder.name for job in jobs if job.options.seed == 2 and job.store} == {"seed-2"}


class Here(Executor):
    """Does at once, in this process, what it is sent as to another one, which takes seconds to load its libraries."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        done: Future[Any] = Future()
        function, arguments, named = pickle.loads(pickle.dumps((function, arguments, named)))
        try:
            done.set_result(function(*arguments, **named))
        except Exception as error:
            done.set_exception(error)
        return done


def test_trainings_are_made_once_and_read_by_the_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "no-head").mkdir()
    (tmp_path / "no-head" / "seed-1").write_text("in the way")
    said: list[str] = []
    monkeypatch.setattr("studies.ablation_losses.trainings.ProcessPoolExecutor", Here)
    assert train_all(plan(tmp_path), said.append) == ["no-head/seed-1"]
    assert any("no-head/seed-1: FAILED" in line and "cannot be written" in line for line in said)
    trainings = trainings_in(tmp_path)
    assert [(group.name, group.variant, len(group.trainings)) for group in groups_of(trainings)] == [
        ("all", ALL, 2),
        ("no-head", NO_HEAD, 1),
        ("long/with-head", ALL, 1),
        ("long/no-head", NO_HEAD, 1),
    ]
    before = {each.name: each.digest for each in trainings}
    (tmp_path / "no-head" / "seed-1").unlink()
    assert train_all(plan(tmp_path), said.append) == []
    after = {each.name: each.digest for each in trainings_in(tmp_path)}
    assert set(after) - set(before) == {"no-head/seed-1"}
    assert {name: after[name] for name in before} == before
    assert not list(tmp_path.rglob("state.pt"))
    with pytest.raises(SystemExit):
        make(["-o", str(tmp_path), "--steps", "5"])
    assert "was trained for 2 steps of 2 samples of 32 px, not 5 steps" in capsys.readouterr().err
