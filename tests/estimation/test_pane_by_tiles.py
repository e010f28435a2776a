"""Incidence and double images of a window where tiles and what told them before find them together."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from polaropt import SceneParameters
from polaropt.capture import PlateFrame, plate_frame, stokes_images
from polaropt.estimation import find_scene, likelier_index
from polaropt.estimation.flat import pane_by_tiles
from polaropt.estimation.flat.pane_by_tiles import contradicts, with_tiles
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.optics import SceneErrors
from polaropt.simulation import Camera, photograph_pair
from studies.camera import take
from studies.photographs import pairs_of
from studies.scenes import protocol

FRAME = SimpleNamespace(azimuth_deg=20.0)
FAR = SceneParameters(65.0, 30.0, 13.0)
FOUND = SceneParameters(60.0, 20.0, 4.8)
OPEN = SceneParameters(None, None, None, n_panes=None, gap_shift=None, absorption=None)
NOISE = 0.005
ONE = SceneParameters(70.0, 20.0, 7.0)
TWO = SceneParameters(60.0, 25.0, 2.0, n_panes=2, gap_shift=9.0, gap_azimuth_deg=30.0)
TINTED = SceneParameters(55.0, 110.0, -6.0, absorption=0.4)
# What a scene's numbers are off by before tiles are asked, and their standard errors.
OFF = {"incidence_deg": 0.5, "ghost_shift": 0.2}
ERRORS = SceneErrors(incidence_deg=0.4, ghost_shift=0.2, gap_shift=0.15, absorption=0.05)


def frame(scene: SceneParameters, pair: int = 0) -> PlateFrame:
    photographs = pairs_of(None, 192)[pair]
    layers = photographs.transmission, photographs.reflection
    capture = photograph_pair(*layers, scene, Camera(noise=NOISE), margin=photographs.margin)
    assert scene.azimuth_deg is not None
    return plate_frame(stokes_images(capture, NOISE), scene.azimuth_deg)


@pytest.mark.parametrize(("scene", "names"), [
    (ONE, ("incidence_deg", "ghost_shift")), (TWO, ("incidence_deg",)), (TINTED, ("incidence_deg",)),
])  # fmt: skip
def test_numbers_that_are_off_come_closer_to_the_truth_and_are_told_more_exactly(
    scene: SceneParameters, names: tuple[str, ...]
) -> None:
    off = scene.replace(**{name: getattr(scene, name) + OFF[name] for name in names})
    found, errors = with_tiles(frame(scene), off, ERRORS, OPEN)
    for name in names:
        error = abs(getattr(found, name) - getattr(scene, name))
        assert error < 0.6 * abs(OFF[name])
        assert error < 2 * getattr(errors, name) < 2 * 0.75 * getattr(ERRORS, name)
    # Gaps, shifts beside them and tint stay as mean spectra tell them.
    kept = {name: getattr(scene, name) for name in names}
    assert found.replace(**kept) == scene
    assert replace(errors, **{name: getattr(ERRORS, name) for name in names}) == ERRORS


def test_what_was_given_stays() -> None:
    off = ONE.replace(incidence_deg=70.5)
    found, errors = with_tiles(frame(ONE), off, SceneErrors(incidence_deg=0.4), OPEN.replace(ghost_shift=7.0))
    assert found == off.replace(incidence_deg=found.incidence_deg)
    assert abs(found.values()[0] - 70) < 0.3
    assert errors == SceneErrors(incidence_deg=errors.incidence_deg)


@pytest.mark.parametrize(("changes", "asked"), [
    ({"ghost_shift": 0.0, "incidence_deg": 24.9}, False), ({"ghost_shift": 0.0, "incidence_deg": 25.1}, True),
    ({"incidence_deg": 15.0}, True), ({"incidence_deg": 89.0}, False), ({"transmission_ghost_shift": 3.0}, False),
    ({"ghost_shift": 0.0, "single_surface": True}, False),
])  # fmt: skip
def test_tiles_are_asked_of_two_faces_that_mirror_enough(
    changes: dict[str, float | bool], asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = FOUND.replace(**changes)
    monkeypatch.setattr(pane_by_tiles, "tile_likelihood", Unasked)
    if asked:
        with pytest.raises(LookupError):
            with_tiles(FRAME, scene, ERRORS, OPEN)  # type: ignore[arg-type]
    else:
        assert with_tiles(FRAME, scene, ERRORS, OPEN) == (scene, ERRORS)  # type: ignore[arg-type]


class Unasked:
    """Tiles that must not be looked at."""

    def __init__(self, frame: object) -> None:
        raise LookupError


class Tiles:
    """A pane at 61 degrees whose images lie 5 px apart, told with standard errors."""

    told, n_tiles = (0.1, 0.02), 9

    def __init__(self, frame: object) -> None:
        pass

    def nearest(self, window: Window, refractive_index: float, free: tuple[str, ...]) -> TileFit:
        assert free == ("incidence_deg", "pane_shift")
        return TileFit(Window(61.0, 5.0), refractive_index, np.zeros(self.n_tiles))

    def errors(self, fit: TileFit, free: tuple[str, ...]) -> np.ndarray:
        return np.array(self.told)


@pytest.mark.parametrize(("told", "before", "incidence", "shift"), [
    # Widened they are 0.35 degrees and 0.09 px.
    ((0.1, 0.02), SceneErrors(0.35, None, 0.09), (60.5, 0.5), (4.9, 0.1)),
    # What had no error before is what tiles tell.
    ((0.1, 0.02), SceneErrors(0.35, None, None), (60.5, 0.5), (5.0, 0.09)),
    # What tiles do not tell stays, and what contradicts it: 2.5 standard errors are 0.97 degrees.
    ((0.1, 0.02), SceneErrors(0.14, None, 0.09), (60.0, 0.14), (4.8, 0.09)),
    ((math.inf, math.inf), SceneErrors(0.35, None, 0.09), (60.0, 0.35), (4.8, 0.09)),
])  # fmt: skip
def test_means_are_weighted_by_the_standard_errors(
    told: tuple[float, float],
    before: SceneErrors,
    incidence: tuple[float, float],
    shift: tuple[float, float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pane_by_tiles, "tile_likelihood", type("", (Tiles,), {"told": told}))
    scene, errors = with_tiles(FRAME, FOUND, before, OPEN)  # type: ignore[arg-type]
    assert (scene.incidence_deg, errors.incidence_deg) == pytest.approx(incidence)
    assert (scene.ghost_shift, errors.ghost_shift) == pytest.approx(shift)


def test_few_tiles_tell_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pane_by_tiles, "tile_likelihood", type("", (Tiles,), {"n_tiles": 8}))
    assert with_tiles(FRAME, FOUND, ERRORS, OPEN) == (FOUND, ERRORS)  # type: ignore[arg-type]


@pytest.mark.parametrize(("told", "others", "expected"), [
    ((60.0, 0.3), (61.0, 0.25), True), ((60.0, 0.3), (60.9, 0.25), False),
    ((60.0, 2.0), (65.8, 2.0), True), ((60.0, 2.0), (65.5, 2.0), False),
])  # fmt: skip
def test_tiles_contradict_others_beyond_both_errors(
    told: tuple[float, float], others: tuple[float, float], expected: bool
) -> None:
    assert contradicts(told, others) == expected


def test_ghosts_of_a_pane_that_is_told_to_be_single_are_not_found_at_half_their_distance() -> None:
    """Found at -4.9 px, they told an index of 1.76 for 1.5: 12 dB of the transmission in silence."""
    sample = take(protocol(70.0), pairs_of(None, 256)[1])
    found = find_scene(sample.capture, SceneParameters(None, None, None), NOISE).scene
    assert found.values()[2] == pytest.approx(sample.scene.values()[2], abs=0.3)
    assert likelier_index(sample.capture, found, NOISE) is None
