"""Several panes, as tiles of a raw mosaic tell them: how many, where their images lie, and the incidence."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from polaropt import Capture, SceneParameters, estimate
from polaropt.estimation import LadderResult
from polaropt.estimation.flat.samples import panes
from polaropt.estimation.flat.samples.edges import WindowEdges
from polaropt.estimation.flat.samples.tiles import PaneOfTiles, SampledTileLikelihood, SampledTiles, tiles_of_mosaic
from polaropt.estimation.flat.samples.window import with_window_of_mosaic
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.numerics import turn_between
from polaropt.simulation import Camera, photograph_mosaic, simulated_mosaic
from studies.photographs import pairs_of

NOISE, AZIMUTH = 0.004, 25.0
OPEN = SceneParameters(None, None, None, n_panes=None, gap_shift=None)
# Told where no pane across is the question.
ALONG = OPEN.replace(azimuth_deg=AZIMUTH)
TWO = SceneParameters(60.0, AZIMUTH, 2.0, n_panes=2, gap_shift=9.0)
TWO_BESIDE = SceneParameters(48.0, AZIMUTH, 1.0, n_panes=2, gap_shift=6.0, gap_azimuth_deg=AZIMUTH + 20)
THREE = SceneParameters(45.0, AZIMUTH, 0.0, n_panes=3, gap_shift=7.0)
TWO_PANES = Window(60.0, 2.0, 9.0, n_panes=2)
STEEP = SceneParameters(76.0, AZIMUTH, -15.0, n_panes=2, gap_shift=9.0)
ONE, FAR = SceneParameters(60.0, AZIMUTH, 6.0), SceneParameters(70.0, AZIMUTH, 12.0)
DARK, DENSE = SceneParameters(77.0, AZIMUTH, 12.0, absorption=0.6), FAR.replace(refractive_index=1.8)


@cache
def found_of(scene: SceneParameters, asked: SceneParameters, color: bool) -> LadderResult:
    return estimate(mosaic(scene, color), asked)


def mosaic(scene: SceneParameters, color: bool = False) -> Capture:
    return _mosaic(scene, color)


@cache
def _mosaic(scene: SceneParameters, color: bool) -> Capture:
    photographs = pairs_of(None, 256)[0]
    camera = Camera(noise=NOISE, lens_blur_px=0.5)
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, scene, camera, color)
    return simulated_mosaic(raw, color)


def tiles_of(scene: SceneParameters) -> SampledTiles:
    tiles = tiles_of_mosaic(mosaic(scene), NOISE)
    assert tiles is not None
    return tiles


@pytest.mark.parametrize(
    ("scene", "asked", "color"),
    [(TWO, OPEN, False), (TWO, ALONG, True), (TWO_BESIDE, ALONG, False), (THREE, OPEN, False)],
    ids=["two", "two, in color", "two, beside the azimuth", "three"],
)
def test_panes_of_a_mosaic_are_found(scene: SceneParameters, asked: SceneParameters, color: bool) -> None:
    """A single pane at 72 degrees and more explains as much of the polarized light, and half of the layers."""
    found = found_of(scene, asked, color)
    assert found.scene.n_panes == scene.n_panes
    assert found.scene.values()[0] == pytest.approx(scene.values()[0], abs=2)
    assert abs(turn_between(found.scene.values()[1], AZIMUTH, 180.0)) < 1
    assert found.errors.incidence_deg is not None
    assert found.errors.incidence_deg < 2


def test_a_single_pane_stays_one() -> None:
    assert estimate(mosaic(ONE), OPEN).scene.n_panes == 1


def test_a_ghost_that_was_missed_makes_no_second_pane() -> None:
    """The faces of a pane that lie far apart look much like two thin panes, where the single one is taken in place."""
    likelihood = SampledTileLikelihood(tiles_of(FAR), AZIMUTH)
    in_place = likelihood.nearest(Window(72.0, 0.0), 1.5)
    two = panes.likeliest_window(likelihood, in_place, 2)
    edges = edges_of(fewer=1.0, more_behind=-0.1)
    assert panes._judged(two, (in_place,), edges, across=False).is_told
    assert panes.several_panes(likelihood, in_place, edges) is None


@pytest.mark.parametrize(("scene", "starts"), [(DARK, (77.0, 82.0)), (DENSE, (70.0, 75.0))], ids=["tinted", "index"])
def test_glass_unlike_what_was_told_makes_no_second_pane(
    scene: SceneParameters, starts: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    likelihood = SampledTileLikelihood(tiles_of(scene), AZIMUTH)
    near = (likelihood.nearest(Window(angle, shift), 1.5) for angle in starts for shift in (scene.values()[2], 0.0))
    single, edges = min(near, key=lambda fit: fit.misfit), edges_of(fewer=1.0, more_behind=-0.1)
    assert panes.several_panes(likelihood, single, edges) is None
    # Clear glass of the index told would not explain as much.
    monkeypatch.setattr(panes, "_of_other_glass", lambda *_: single)
    told = panes.several_panes(likelihood, single, edges)
    assert told is not None
    assert told.is_told


@pytest.mark.parametrize("asked", [OPEN, ALONG.replace(n_panes=2)], ids=["open", "told"])
def test_the_gap_is_found_whether_the_number_is_told_or_not(asked: SceneParameters) -> None:
    found = found_of(TWO, asked, False).scene
    assert found.values()[0] == pytest.approx(60, abs=1.5)
    assert found.ghost_shift == pytest.approx(2, abs=1)
    assert found.gap_shift == pytest.approx(9, abs=1.2)
    assert found.gap_azimuth_deg == pytest.approx(AZIMUTH, abs=6)


def test_an_incidence_that_is_told_is_kept() -> None:
    found = estimate(mosaic(TWO), OPEN.replace(incidence_deg=60.0))
    assert (found.scene.n_panes, found.scene.incidence_deg) == (2, 60.0)
    assert found.errors.incidence_deg is None


def fit(n_tiles: int, sure: float = 0.0) -> TileFit:
    """Of tiles that together find a window likelier than one of no misfit, by so many standard errors."""
    spread = math.sqrt(n_tiles / sure**2 - 1) if sure else 0.0
    return TileFit(TWO_PANES, 1.5, -(sure > 0) - spread * np.resize([1.0, -1.0], n_tiles))


def edges_of(fewer: float, more_behind: float) -> WindowEdges:
    """Of layers that have so many fewer than with all images on the other side, and more behind than a single pane."""

    class Edges(WindowEdges):
        def fewer(self, window: Window) -> float:
            return fewer

        def more_behind(self, window: Window, other: Window) -> float:
            return more_behind

    return Edges(OPEN, lambda _: (0.0, 0.0), 1.0)


def told_of(found: TileFit, singles: list[TileFit], edges: WindowEdges, *, across: bool) -> bool:
    return panes._judged(found, singles, edges, across=across).is_told


@pytest.mark.parametrize(
    ("sure", "fewer", "more_behind", "n_tiles", "along", "across"),
    [
        (4.0, 0.05, 0.0, 120, True, False),
        (3.5, 0.005, 0.0, 120, False, False),
        (4.0, 0.005, -0.1, 120, True, False),
        (4.0, 0.05, 0.15, 120, False, False),
        (8.0, 0.05, 0.0, 120, True, True),
        (8.0, 0.05, 0.2, 120, True, False),
        (8.0, -0.01, 0.0, 120, True, False),
        (8.0, -0.01, 0.0, 242, False, False),
        (2.4, 0.5, -0.2, 120, False, False),
    ],
)
def test_edges_and_tiles_together_tell_several_panes(
    sure: float, fewer: float, more_behind: float, n_tiles: int, along: bool, across: bool
) -> None:
    """Many tiles must be surer, as what layers are not as they are taken to be shows in all of them alike."""
    found, single, edges = fit(n_tiles, sure), fit(n_tiles), edges_of(fewer, more_behind)
    assert found.surer_than(single) == pytest.approx(sure)
    frontal, oblique = (replace(found, window=replace(TWO_PANES, incidence_deg=angle)) for angle in (11.0, 54.0))
    for is_across, told in ((False, along), (True, across)):
        assert told_of(found, [single], edges, across=is_across) is told
        assert not told_of(found, [single, found], edges, across=is_across)
        assert not told_of(frontal, [single], edges, across=is_across)
        # Only steep ones look like another pane across with the layers exchanged.
        assert told_of(oblique, [single], edges, across=is_across) is (told and not is_across)


@pytest.mark.parametrize(("odds", "n_panes", "others"), [(0.2, 2, [1]), (1.0, 2, []), (-0.2, 1, [2]), (-1.0, 1, [])])
def test_what_is_not_taken_is_a_rival_where_it_may_be_true(
    odds: float, n_panes: int, others: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(panes, "_log_odds", lambda *_: odds)
    estimated = found_of(TWO, ALONG, False).estimate
    assert estimated is not None
    single = replace(estimated, scene=SceneParameters(72.0, AZIMUTH, 0.0), rivals=())
    found = with_window_of_mosaic(single, tiles_of(TWO), ALONG, lambda _: (0.0, 0.0))
    assert found.scene.n_panes == n_panes
    assert [rival.scene.n_panes for rival in found.rivals] == others
    assert [rival.chance for rival in found.rivals] == [pytest.approx(1 / (1 + math.exp(abs(odds)))) for _ in others]


@pytest.mark.parametrize(("pane_shift", "gap_along"), [(-17.0, 8.0), (-9.0, 11.0), (12.0, -7.0)])
def test_a_window_whose_panes_and_gaps_are_exchanged_has_images_in_the_same_places(
    pane_shift: float, gap_along: float
) -> None:
    """Two faces each: light that one, two... of the four faces mirror comes from as far off."""

    def places(window: Window) -> list[float]:
        pane, gap = window.pane_shift, window.gap_along
        return sorted([0.0, pane, pane + gap, 2 * pane + gap])

    window = Window(60.0, pane_shift, gap_along, 1.0, 2)
    other = panes._exchanged(window)
    assert places(other) == pytest.approx(places(window))
    assert other != window
    assert panes._exchanged(other) == window


def test_steep_windows_whose_images_lie_apart_are_found() -> None:
    """They look like no single pane: that of the likeliest one is no guide to them."""
    likelihood = SampledTileLikelihood(tiles_of(STEEP), AZIMUTH)
    single = likelihood.nearest(Window(75.0, 2.0), 1.5)
    found = panes.likeliest_window(likelihood, single, 2)
    true = likelihood.nearest(Window(76.0, -15.0, 9.0, n_panes=2), 1.5, panes.free_numbers())
    assert found.misfit < true.misfit + 1
    assert found.window.incidence_deg == pytest.approx(76, abs=1.5)


def test_edges_are_compared_with_those_of_all_images_on_the_other_side() -> None:
    window, seen = Window(60.0, 2.0, 3.0, 4.0, 2), []

    def edges(scene: SceneParameters) -> tuple[float, float]:
        seen.append(scene)
        return math.copysign(0.01, -scene.values()[2]), 0.2

    of_windows = WindowEdges(OPEN.replace(azimuth_deg=AZIMUTH), edges, 0.5)
    assert of_windows.fewer(window) == pytest.approx(0.02)
    across, here = seen
    assert (here.ghost_shift, here.gap_shift, here.n_panes) == (1.0, 2.5, 2)
    assert here.gap_azimuth_deg == pytest.approx((AZIMUTH - math.degrees(math.atan2(4, 3))) % 360)
    assert across == here.opposite()
    # Each is asked for once.
    assert of_windows.more_behind(window, replace(window, pane_shift=-2.0)) == pytest.approx(-0.02)
    assert len(seen) == 3


def test_without_edges_nobody_asks_for_several_panes() -> None:
    pane = PaneOfTiles(tiles_of(ONE), AZIMUTH)
    assert pane.several(OPEN, pane.single(OPEN, (60.0,))) is None
