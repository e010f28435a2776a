"""Tinted glass, as tiles of a raw mosaic tell it by ghosts that clear glass has not."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from polaropt import Capture, SceneParameters, estimate
from polaropt.estimation import LadderResult
from polaropt.estimation.flat.samples import single, tiles
from polaropt.estimation.flat.samples.tiles import PaneOfTiles, SampledTileLikelihood, tiles_of_mosaic
from polaropt.estimation.flat.samples.window import with_window_of_mosaic
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.numerics import turn_between
from polaropt.simulation import Camera, photograph_mosaic, simulated_mosaic
from studies.photographs import pairs_of

NOISE, PAIR = 0.004, 3
OPEN = SceneParameters(None, None, None, n_panes=None, gap_shift=None, absorption=None)
STEEP, DARK = SceneParameters(77.0, 25.0, 12.0, absorption=0.6), SceneParameters(74.0, 60.0, -10.0, absorption=0.5)
CLEAR, BELOW = (scene.replace(absorption=0.0) for scene in (STEEP, SceneParameters(60.0, 115.0, 7.0)))


@cache
def mosaic(scene: SceneParameters) -> Capture:
    photographs, camera = pairs_of(None, 256)[PAIR], Camera(noise=NOISE, lens_blur_px=0.5)
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, scene, camera, False)
    return simulated_mosaic(raw, False)


@cache
def found_of(scene: SceneParameters) -> LadderResult:
    return estimate(mosaic(scene), OPEN)


@cache
def likelihood_of(scene: SceneParameters) -> SampledTileLikelihood:
    seen = tiles_of_mosaic(mosaic(scene), NOISE)
    assert seen is not None
    return SampledTileLikelihood(seen, scene.values()[1])


@pytest.mark.parametrize("scene", [STEEP, DARK], ids=["steep", "dark"])
def test_ghosts_of_tinted_glass_are_found_where_those_of_clear_glass_are_not(scene: SceneParameters) -> None:
    found = found_of(scene)
    assert found.errors.absorption is not None
    assert found.scene.absorption == pytest.approx(scene.absorption, abs=2 * found.errors.absorption)
    assert found.scene.values()[2] == pytest.approx(scene.values()[2], abs=0.5)
    assert found.scene.values()[0] == pytest.approx(scene.values()[0], abs=1)


def test_clear_glass_would_have_no_ghosts_there_and_look_shallower() -> None:
    clear = estimate(mosaic(DARK), OPEN.replace(absorption=0.0)).scene
    assert clear.ghost_shift == 0
    assert clear.values()[0] < DARK.values()[0] - 1


@pytest.mark.parametrize("scene", [CLEAR, BELOW], ids=["steep", "below"])
def test_clear_glass_is_not_taken_for_tinted(scene: SceneParameters) -> None:
    found = found_of(scene).scene
    assert found.absorption == 0
    assert found.values()[2] == pytest.approx(scene.values()[2], abs=0.5)


def test_a_tinted_pane_is_found_across_the_clear_one_that_cells_tell() -> None:
    seen = tiles_of_mosaic(mosaic(STEEP), NOISE)
    estimated = found_of(STEEP).estimate
    assert seen is not None
    assert estimated is not None
    azimuth = STEEP.values()[1]
    across = replace(estimated, scene=SceneParameters(76.0, azimuth + 90, 0.0), rivals=())
    found = with_window_of_mosaic(across, seen, OPEN, lambda _: (0.0, 0.0)).scene
    assert abs(turn_between(found.values()[1], azimuth, 180.0)) < 1
    assert found.absorption == pytest.approx(STEEP.absorption, abs=0.2)
    # What is told stays as it is.
    for told in (OPEN.replace(absorption=0.0), OPEN.replace(azimuth_deg=azimuth + 90)):
        kept = with_window_of_mosaic(across, seen, told, lambda _: (0.0, 0.0)).scene
        assert abs(turn_between(kept.values()[1], azimuth + 90, 180.0)) < 1


def test_an_incidence_that_is_told_is_kept() -> None:
    place = likelihood_of(STEEP).fitted(Window(77.0, 0.0), 1.5)
    found = single.likeliest_tinted(likelihood_of(STEEP), place, incidence_open=False)
    assert found is not None
    assert found.window.incidence_deg == 77.0
    assert found.window.pane_shift == pytest.approx(12.0, abs=0.5)


@pytest.mark.parametrize(
    ("change", "possible"),
    [
        ({}, True),
        ({"pane_shift": 0.5}, False),
        ({"pane_shift": -22.0}, False),
        ({"absorption": 0.05}, False),
        ({"absorption": 1.4}, False),
        ({"incidence_deg": 86.0}, False),
    ],
)
def test_what_imitates_something_else_is_no_tinted_glass(
    change: dict[str, float], possible: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    likeliest = fit_of(Window(60.0, 8.0, absorption=0.4), 0.0)
    likeliest = replace(likeliest, window=replace(likeliest.window, **change))
    monkeypatch.setattr(SampledTileLikelihood, "nearest", lambda *_: likeliest)
    found = single.likeliest_tinted(likelihood_of(STEEP), fit_of(Window(60.0, 0.0), 0.0))
    assert (found is likeliest) is possible


def fit_of(window: Window, below: float, n_tiles: int = 100) -> TileFit:
    """A fit than which one of no misfit is likelier by so many standard errors."""
    spread = math.sqrt(n_tiles / below**2 - 1) if below else 0.0
    return TileFit(window, 1.5, (below > 0) + spread * np.resize([1.0, -1.0], n_tiles))


class _Likelihood:
    """Of a tinted pane, than which the same on the other side and the same in place are less likely by so much."""

    def __init__(self, of_side: float, of_ghosts: float) -> None:
        self.of_side, self.of_ghosts = of_side, of_ghosts

    def nearest(self, window: Window, index: float, free: tuple[str, ...]) -> TileFit:
        return fit_of(window, self.of_side if window.pane_shift else self.of_ghosts)


@pytest.mark.parametrize(
    ("sure", "of_side", "of_ghosts", "along", "across"),
    [
        (2.6, 1.9, 2.6, True, False),
        (2.4, 1.9, 2.6, False, False),
        (2.6, 1.7, 2.6, False, False),
        (2.6, 1.9, 2.4, False, False),
        (1.1, 3.1, 4.1, False, True),
        (0.9, 3.1, 4.1, False, False),
        (1.1, 2.9, 4.1, False, False),
        (1.1, 3.1, 3.9, False, False),
    ],
)
def test_tiles_must_be_sure_of_tint_and_surer_of_a_side_across(
    sure: float, of_side: float, of_ghosts: float, along: bool, across: bool
) -> None:
    """Only far ones pass for panes across, which their ghosts tell."""
    found, other = fit_of(Window(70.0, 8.0, absorption=0.4), 0.0), fit_of(Window(70.0, 0.0), sure)
    assert found.surer_than(other) == pytest.approx(sure)
    likelihood: Any = _Likelihood(of_side, of_ghosts)
    assert single.tells_tint(likelihood, found, [other], across=False) is along
    assert single.tells_tint(likelihood, found, [other], across=True) is across
    # Another that is as likely leaves it open.
    assert not single.tells_tint(likelihood, found, [other, found], across=across)


@pytest.mark.parametrize(("than_two", "than_index", "told"), [(1.1, 1.1, True), (0.9, 1.1, False), (1.1, 0.9, False)])
def test_what_is_told_is_neither_another_index_nor_two_panes(
    than_two: float, than_index: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, own = fit_of(Window(70.0, 8.0, absorption=0.4), 0.0), fit_of(Window(70.0, 0.0), 5.0)
    seen = tiles_of_mosaic(mosaic(STEEP), NOISE)
    assert seen is not None
    monkeypatch.setattr(tiles, "tells_tint", lambda *_, **__: True)
    monkeypatch.setattr(tiles, "likeliest_window", lambda *_, **__: fit_of(Window(60.0, 0.0, 8.0, 0.0, 2), than_two))
    monkeypatch.setattr(tiles, "likeliest_of_other_index", lambda *_, **__: fit_of(Window(66.0, 8.0), than_index))
    assert PaneOfTiles(seen, 25.0).tells_tint(OPEN, found, own) is told


def test_glass_of_another_index_is_looked_for_where_it_looks_alike() -> None:
    dense = CLEAR.replace(refractive_index=1.8)
    dim = replace(Window(80.0, 12.0), absorption=0.3)
    other = single.likeliest_of_other_index(likelihood_of(dense), dim, 1.5)
    assert other.refractive_index > 1.5
    assert other.window.absorption == 0
    assert other.window.pane_shift == pytest.approx(12.0, abs=0.5)
    assert other.surer_than(likelihood_of(dense).nearest(dim, 1.5, ("incidence_deg", "pane_shift", "absorption"))) > 1


@pytest.mark.parametrize("shift", [8.0, 26.0])
def test_ghosts_that_tiles_do_not_hold_whole_must_be_surely_dim(shift: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """They look dim by themselves."""
    seen = tiles_of_mosaic(mosaic(STEEP), NOISE)
    assert seen is not None
    clear, dark = fit_of(Window(70.0, shift), 2.0), fit_of(Window(70.0, shift, absorption=0.4), 0.0)
    monkeypatch.setattr(SampledTileLikelihood, "nearest", lambda self, window, *_: dark if window.absorption else clear)
    monkeypatch.setattr(PaneOfTiles, "errors", lambda *_: (0.1,))
    told = PaneOfTiles(seen, 25.0).tint(SceneParameters(70.0, 25.0, shift))
    assert told == ((0.4, 0.1) if shift < 18 else None)
