"""Double images of a single pane, or none, by the frame's tiles."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from polaropt import SceneParameters, estimate
from polaropt.capture import Capture, stokes_images
from polaropt.estimation import find_scene
from polaropt.estimation.flat import pane_by_tiles
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.pane_by_tiles import with_ghosts_by_tiles
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood
from polaropt.optics import SceneErrors
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of

OPEN = SceneParameters(None, None, None)
PLAIN = SceneParameters(40.0, 20.0, 4.0)
ESTIMATE = SceneEstimate(PLAIN, 9.0, SceneErrors(ghost_shift=0.1), True, 1.0, 0.0, np.inf, 0.5, *4 * [np.zeros(1)])
MIXED = SimpleNamespace(aliased=True)


def taken(scene: SceneParameters, pair: int, noise: float) -> Capture:
    photographs = pairs_of(None, 192)[pair]
    frames = (photographs.transmission, photographs.reflection)
    return photograph_pair(*frames, scene, Camera(noise=noise), margin=photographs.margin)


@pytest.mark.parametrize(("shift", "error", "kept"), [
    (0.49, None, False), (0.51, None, True), (-0.51, None, True), (1.5, 1.4, True), (1.5, 1.6, False),
    (1.9, 3.0, False), (2.1, 3.0, True), (1.5, np.inf, True),
])  # fmt: skip
def test_the_limit_of_a_ghost_shift_that_is_none(shift: float, error: float | None, kept: bool) -> None:
    near = replace(ESTIMATE, scene=PLAIN.replace(ghost_shift=shift), shift_error_of_side=error)
    found = with_ghosts_by_tiles(near, MIXED, OPEN, is_flat=True)  # type: ignore[arg-type]
    assert found.scene.ghost_shift == (shift if kept else 0.0)
    assert (found.errors.ghost_shift is not None) == kept


class Tiles:
    """So many standard errors likelier under a window with ghosts than under one in place, in 16 tiles.

    Of either side, or of that of negative shifts by `of_side` standard errors alone.
    """

    sure: float = 0.0
    of_side: float | None = None
    surer_of_side = TileLikelihood.surer_of_side

    def __init__(self, frame: object) -> None:
        pass

    def nearest(self, window: Window, refractive_index: float, free: tuple[str, ...]) -> TileFit:
        even = -self.sure / 4 if window.pane_shift else 0.0
        spread = np.sqrt(1 - self.sure**2 / 16) * np.resize([1.0, -1.0], 16) if window.pane_shift else np.zeros(16)
        if self.of_side is not None and window.pane_shift > 0:
            even += self.of_side / 4 + np.sqrt(1 - self.of_side**2 / 16) * np.repeat([1.0, -1.0], 8)
        return TileFit(window, refractive_index, even + spread)

    def luminance(self) -> Tiles:
        return self

    def fitted(self, window: Window, refractive_index: float) -> TileFit:
        return self.nearest(window, refractive_index, ())


@pytest.mark.parametrize(("shift", "sure", "kept"), [
    (1.5, 2.1, True), (1.5, 1.9, False), (-2.9, 2.1, True), (-2.9, 1.9, False),
    (3.1, 0.1, True), (3.1, -0.1, False), (-12.0, 0.1, True), (-12.0, -0.1, False),
])  # fmt: skip
def test_the_limit_of_ghosts_that_tiles_do_not_show(
    shift: float, sure: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pane_by_tiles, "tile_likelihood", type("", (Tiles,), {"sure": sure}))
    monkeypatch.setattr(pane_by_tiles, "refined_incidence", lambda frame, scene: (scene.incidence_deg, 0.2))
    stokes = stokes_images(taken(PLAIN, 0, 0.005), 0.005)
    near = replace(ESTIMATE, scene=PLAIN.replace(ghost_shift=shift))
    found = with_ghosts_by_tiles(near, stokes, OPEN, is_flat=True)
    assert found.scene.ghost_shift == (shift if kept else 0.0)
    assert (found.errors.ghost_shift is not None) == kept


@pytest.mark.parametrize(("shift", "sure", "of_side", "found"), [
    (0.0, 2.6, 2.6, -1.0), (0.0, 2.4, 3.0, 0.0), (0.0, 3.0, 2.4, 0.0), (-1.5, 1.9, 2.6, -1.5), (-1.5, 1.9, 2.4, 0.0),
])  # fmt: skip
def test_close_ghosts_that_lie_on_either_side_are_none(
    shift: float, sure: float, of_side: float, found: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where tiles alone show them, and where only mean spectra do."""
    monkeypatch.setattr(pane_by_tiles, "tile_likelihood", type("", (Tiles,), {"sure": sure, "of_side": of_side}))
    monkeypatch.setattr(pane_by_tiles, "refined_incidence", lambda frame, scene: (scene.incidence_deg, 0.2))
    stokes = stokes_images(taken(PLAIN, 0, 0.005), 0.005)
    near = replace(ESTIMATE, scene=SceneParameters(50.0, 20.0, shift))
    assert with_ghosts_by_tiles(near, stokes, OPEN, is_flat=not shift).scene.ghost_shift == found


@pytest.mark.parametrize("incidence_deg", [30.0, 36.0])
def test_a_pane_in_place_has_no_double_images_on_either_side(incidence_deg: float) -> None:
    """Mean spectra and tiles both show some 0.6 to 1.1 px apart; neither tiles nor edges tell on which side."""
    found = estimate(taken(SceneParameters(incidence_deg, 25.0, 0.0), 0, 0.004)).scene
    assert found.rung == "pixelwise"
    assert found.incidence_deg == pytest.approx(incidence_deg, abs=0.3)


@pytest.mark.parametrize("incidence_deg", [42.0, 58.0])
def test_a_picture_that_is_blurred_one_way_has_no_ghosts(incidence_deg: float) -> None:
    """Though mean spectra like images 0.8 px apart better than none."""
    found = find_scene(taken(SceneParameters(incidence_deg, 25.0, 0.0), 3, 0.001), OPEN, 0.001).scene
    assert found.rung == "pixelwise"
    assert found.incidence_deg == pytest.approx(incidence_deg, abs=0.5)


@pytest.mark.parametrize(("pair", "incidence_deg"), [(0, 70.0), (1, 64.0)])
def test_close_ghosts_of_a_steep_pane_are_found_where_mean_spectra_show_none(pair: int, incidence_deg: float) -> None:
    """Without them the incidence is 0.4 to 2 degrees too steep."""
    found = find_scene(taken(SceneParameters(incidence_deg, 25.0, -1.5), pair, 0.001), OPEN, 0.001)
    assert found.scene.ghost_shift == pytest.approx(-1.5, abs=0.25)
    assert found.scene.incidence_deg == pytest.approx(incidence_deg, abs=0.5)
    assert found.errors.ghost_shift == pytest.approx(0.15, abs=0.15)


def test_no_ghosts_are_looked_for_where_the_incidence_changes_over_the_frame() -> None:
    stokes = stokes_images(taken(SceneParameters(70.0, 25.0, -1.5), 0, 0.001), 0.001)
    place = replace(ESTIMATE, scene=SceneParameters(71.0, 25.0, 0.0))
    assert with_ghosts_by_tiles(place, stokes, OPEN, is_flat=False).scene.ghost_shift == 0
    assert with_ghosts_by_tiles(place, stokes, OPEN, is_flat=True).scene.ghost_shift != 0


@pytest.mark.parametrize("asked", [{"single_surface": True}, {"n_bounces": 0}, {"transmission_ghost_shift": 3.0}])
def test_none_are_looked_for_where_a_pane_of_two_faces_is_none(asked: dict[str, object]) -> None:
    scene = SceneParameters(70.0, 25.0, -1.5)
    stokes = stokes_images(taken(scene, 0, 0.001), 0.001)
    place = replace(ESTIMATE, scene=scene.replace(ghost_shift=0.0, **asked))
    assert with_ghosts_by_tiles(place, stokes, OPEN, is_flat=True).scene == place.scene


def test_an_incidence_that_is_told_stays() -> None:
    scene = SceneParameters(70.0, 25.0, -1.5)
    stokes = stokes_images(taken(scene, 0, 0.001), 0.001)
    place = replace(ESTIMATE, scene=scene.replace(ghost_shift=0.0))
    found = with_ghosts_by_tiles(place, stokes, OPEN.replace(incidence_deg=70.0), is_flat=True).scene
    assert found.incidence_deg == 70
    assert found.ghost_shift == pytest.approx(-1.5, abs=0.25)
