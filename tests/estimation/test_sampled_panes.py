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
from polaropt.estimation.flat.samples.tiles import PaneOfTiles, SampledTileLikelihood, tiles_of_mosaic
from polaropt.estimation.flat.samples.window import fewer_edges
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
ONE, FAR = SceneParameters(60.0, AZIMUTH, 6.0), SceneParameters(70.0, AZIMUTH, 12.0)


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
    tiles = tiles_of_mosaic(mosaic(FAR), NOISE)
    assert tiles is not None
    likelihood = SampledTileLikelihood(tiles, AZIMUTH)
    in_place = likelihood.nearest(Window(72.0, 0.0), 1.5)
    two = panes.likeliest_window(likelihood, in_place, 2)
    assert two.surer_than(in_place) > max(panes._SURE)
    assert panes.several_panes(likelihood, in_place, lambda _: 1.0) is None


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


@pytest.mark.parametrize(
    ("sure", "fewer", "n_tiles", "across", "told"),
    [
        (3.6, 0.013, 48, False, True),
        (3.6, 0.011, 48, False, False),
        (3.4, 0.013, 48, False, False),
        (2.9, 0.11, 48, False, True),
        (2.7, 0.2, 48, False, False),
        (3.6, 0.013, 48, True, False),
        (3.8, 0.013, 48, True, True),
        (5.0, 0.05, 120, False, False),
        (5.0, 0.07, 120, False, True),
        (5.7, 0.05, 120, False, True),
        (5.7, 0.2, 120, True, True),
        (5.7, 0.05, 120, True, False),
        (3.8, 0.2, 120, True, False),
        (6.0, 0.05, 120, True, True),
    ],
)
def test_edges_and_tiles_together_tell_several_panes(
    sure: float, fewer: float, n_tiles: int, across: bool, told: bool
) -> None:
    """Many tiles must be surer, as what layers are not as they are taken to be shows in all of them alike."""
    found, single = fit(n_tiles, sure), fit(n_tiles)
    assert found.surer_than(single) == pytest.approx(sure)
    assert panes._is_told(found, [single], lambda _: fewer, across=across) is told
    assert not panes._is_told(found, [single, found], lambda _: fewer, across=across)
    frontal = replace(found, window=replace(TWO_PANES, incidence_deg=11.0))
    assert not panes._is_told(frontal, [single], lambda _: fewer, across=across)
    # Only steep ones look like another pane across with the layers exchanged.
    oblique = replace(found, window=replace(TWO_PANES, incidence_deg=54.0))
    assert panes._is_told(oblique, [single], lambda _: fewer, across=across) is (told and not across)


@pytest.mark.parametrize(
    ("pane_shift", "gap_across", "sure", "told"),
    [
        (-3.0, 0.0, 4.4, False),
        (-3.0, 0.0, 4.6, True),
        (-1.0, 0.0, 4.4, True),
        (2.0, 9.5, 4.4, False),
        (2.0, -9.5, 4.6, True),
        (2.0, 8.5, 4.4, True),
    ],
)
def test_panes_far_from_parallel_must_be_surer(pane_shift: float, gap_across: float, sure: float, told: bool) -> None:
    found = replace(fit(48, sure), window=replace(TWO_PANES, pane_shift=pane_shift, gap_across=gap_across))
    assert panes._is_told(found, [fit(48)], lambda _: 0.05, across=False) is told


def test_edges_are_compared_with_those_of_all_images_on_the_other_side() -> None:
    window, seen = Window(60.0, 2.0, 3.0, 4.0, 2), []

    def edges(scene: SceneParameters) -> float:
        seen.append(scene)
        return math.copysign(0.01, -scene.values()[2])

    assert fewer_edges(OPEN.replace(azimuth_deg=AZIMUTH), edges, 0.5, window) == pytest.approx(0.02)
    across, here = seen
    assert (here.ghost_shift, here.gap_shift, here.n_panes) == (1.0, 2.5, 2)
    assert here.gap_azimuth_deg == pytest.approx((AZIMUTH - math.degrees(math.atan2(4, 3))) % 360)
    assert across == here.opposite()


def test_without_edges_nobody_asks_for_several_panes() -> None:
    tiles = tiles_of_mosaic(mosaic(ONE), NOISE)
    assert tiles is not None
    pane = PaneOfTiles(tiles, AZIMUTH)
    assert pane.several(OPEN, pane.single(OPEN, (60.0,))) is None
