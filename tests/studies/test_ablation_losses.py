"""The ablation of the losses: records tell variants apart, and the page says what may be compared."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from polaropt.errors import InputError
from priors.networks.checkpoint import save_network
from studies.ablation_losses import (
    ALL,
    PIXELS,
    PLAIN,
    Job,
    Row,
    Training,
    commands,
    main,
    run,
    tables,
    trainings_in,
    variant_of,
)
from studies.kit.frames import frame_of
from studies.scenes import protocol
from tests.observations import small_network

PUBLISHED = {"pixelwise": 1.0, "perceptual": 0.1, "pse": 2.0, "edge_independence": 0.1, "adversarial": 0.1}


def record(polarnet: str = "compact", features: str | None = "encoder", **weights: float) -> dict[str, object]:
    return {
        "architecture": {"form": "paper", "polarnet": polarnet},
        "options": {"weights": {**PUBLISHED, "decibel": 0.0, **weights}, "batch_size": 4},
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
    monkeypatch.setattr("studies.ablation_losses.shipped_trainings", list)
    with pytest.raises(SystemExit):
        main(["--records", str(tmp_path), "-o", str(tmp_path / "out")])
    assert "trained on astronaut; name others with --photos" in capsys.readouterr().err


ONE = Training("one", Path("w"), "", "paper", ALL, "100 steps", "encoder", 60.0)


def text_of(*trainings: Training) -> str:
    rows = [Row(t.name, t.variant, 0, 60.0, 20.0 - i, 15.0, 0.8, 0.5, 0.1) for i, t in enumerate(trainings)]
    return tables(frame_of(Row, rows), trainings)


def test_differences_are_to_the_training_with_all_terms() -> None:
    other = replace(ONE, name="two", variant="without pse")
    text = text_of(ONE, other)
    assert "The same budget for all: 100 steps" in text
    assert "| two | paper | without pse | 19.00 | 0.800 | 15.00 | 0.500 | -1.00 | 26.4 / 0.842 | -1.9 |" in text


def test_different_budgets_are_named() -> None:
    other = replace(ONE, name="two", variant="without pse", budget="50 steps")
    assert "THE BUDGETS DIFFER: 100 steps; 50 steps" in text_of(ONE, other)


def test_without_records_it_says_how_to_make_them() -> None:
    shipped = replace(ONE, name="shipped, paper")
    text = text_of(shipped)
    assert all(command in text for command in commands())
    assert "| without pse | 26.4 / 0.842 |" in text
