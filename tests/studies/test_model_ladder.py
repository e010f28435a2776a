"""The ladder's families: what is taken, and what the choice costs."""

from __future__ import annotations

from studies import model_ladder
from studies.kit.frames import frame_of
from studies.model_ladder import Row, cost_of_choice
from tests.documents import document_of


def row(model: str, transmission: float, adequate: bool = True, pair: int = 0) -> Row:
    return Row("ghosts", pair, model, 20.0, transmission, 30.0, "ghosts", adequate, 1.0, ())


def test_the_choice_is_measured_against_the_best_fixed_rung():
    rows = [row("auto", 40.0), row("auto", 41.0, adequate=False, pair=1), row("pixelwise", 30.0), row("ghosts", 41.0)]
    rows.append(row("known", 50.0))
    said = cost_of_choice(frame_of(Row, rows))
    assert "Lowest adequate rung taken: 1 of 2 scenes." in said
    assert "ghosts: auto -0.50 dB (T) against the best fixed rung, ghosts." in said


def test_without_fixed_rungs_nothing_is_compared():
    assert "against" not in cost_of_choice(frame_of(Row, [row("auto", 40.0)]))


def test_the_study_is_one_command(tmp_path, capsys, monkeypatch, png_alone):
    (scene,) = (scene for scene in model_ladder.LADDER if scene.family == "ghosts, 60 deg")
    monkeypatch.setattr(model_ladder, "LADDER", [scene])
    model_ladder.main(["--quick", "--family", "ghosts", "--models", "auto,known", "-o", str(tmp_path)])
    out = capsys.readouterr().out
    assert "| ghosts, 60 deg | auto |" in out
    assert "Lowest adequate rung taken: 1 of 1 scenes." in out
    assert len(document_of(tmp_path / "model_ladder.json")["results"]) == 2
    assert (tmp_path / "model_ladder.png").stat().st_size > 10_000
