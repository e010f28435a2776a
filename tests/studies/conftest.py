"""Settings for the tests of studies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from polaropt import Capture, SceneParameters, Separation, separate


@pytest.fixture
def told_pane(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blind separations of studies look for one clear pane and its ghosts: how all is found is tested elsewhere."""

    def separated(
        capture: Capture, scene: SceneParameters | None = None, *settings: Any, model: str = "auto", **more: Any
    ) -> Separation:
        left_open = scene or SceneParameters(None, None, None)
        taken = "ghosts" if model == "auto" and not left_open.complete else model
        return separate(capture, left_open, *settings, model=taken, **more)

    for module in ("ways", "mosaic.layers", "benchmark.separations"):
        monkeypatch.setattr(f"studies.{module}.separate", separated)


@pytest.fixture
def png_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are written as PNG alone, in half of the time: that both are there is a test of the kit's charts."""
    figure_of = pytest.importorskip("matplotlib.figure").Figure
    save = figure_of.savefig

    def saved(figure: Any, file: Path, **how: Any) -> None:
        if file.suffix != ".svg":
            save(figure, file, **how)

    monkeypatch.setattr(figure_of, "savefig", saved)
