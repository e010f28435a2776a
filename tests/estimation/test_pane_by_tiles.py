"""Incidence and double images of a window where tiles and what told them before find them together."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pytest

from polaropt import Capture, SceneParameters, read_capture
from polaropt.capture import PlateFrame, plate_frame, stokes_images, write_png
from polaropt.estimation import find_scene, likelier_index
from polaropt.estimation.flat import pane_by_tiles
from polaropt.estimation.flat.pane_by_tiles import CellTiles, contradicts, tiles_of_cells, with_tiles
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.optics import SceneErrors
from polaropt.simulation import Camera, photograph_mosaic, photograph_pair
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
    monkeypatch.setattr(pane_by_tiles, "TileLikelihood", Unasked)
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
    monkeypatch.setattr(pane_by_tiles, "TileLikelihood", type("", (Tiles,), {"told": told}))
    scene, errors = with_tiles(FRAME, FOUND, before, OPEN)  # type: ignore[arg-type]
    assert (scene.incidence_deg, errors.incidence_deg) == pytest.approx(incidence)
    assert (scene.ghost_shift, errors.ghost_shift) == pytest.approx(shift)


def test_few_tiles_tell_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pane_by_tiles, "TileLikelihood", type("", (Tiles,), {"n_tiles": 8}))
    assert with_tiles(FRAME, FOUND, ERRORS, OPEN) == (FOUND, ERRORS)  # type: ignore[arg-type]


@cache
def mosaic(sensor: str) -> Capture:
    photographs = pairs_of(None, 384)[0]
    camera = Camera(noise=NOISE, lens_blur_px=0.5)
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, FAR, camera, sensor == "color")
    with TemporaryDirectory() as folder:
        write_png(Path(folder, "raw.png"), np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
        return read_capture(Path(folder, "raw.png"), sensor=sensor)


@cache
def mono_tiles() -> CellTiles:
    tiles = tiles_of_cells(mosaic("mono"), FAR, NOISE)
    assert tiles is not None
    return tiles


@pytest.mark.parametrize("about", [0.0, -4.0, 12.0])
def test_ghosts_of_a_mosaic_are_found_where_its_cells_hardly_show_them(about: float) -> None:
    start = FAR.replace(ghost_shift=about, incidence_deg=67.0)
    assert mono_tiles().ghost_shift(start) == pytest.approx(13.0, abs=1.0)


def test_ghosts_of_color_mosaics_and_photographs_stay_where_they_were_found() -> None:
    found = FAR.replace(ghost_shift=4.0)
    assert tiles_of_cells(mosaic("color"), found, NOISE) is None
    assert tiles_of_cells(mosaic("mono").registered, found, NOISE) is None
    for changes in ({"n_panes": 2, "gap_shift": 9.0}, {"single_surface": True}, {"focal_px": 400.0}):
        assert tiles_of_cells(mosaic("mono"), found.replace(**changes), NOISE) is None


def test_cells_of_a_mono_mosaic_tell_the_incidence_within_its_error() -> None:
    told = mono_tiles().incidence(FAR.replace(incidence_deg=66.0))
    assert told is not None
    assert abs(told[0] - 65.0) < 2 * told[1] < 1.6
    assert mono_tiles().incidence(FAR.replace(ghost_shift=0.0)) is None


@pytest.mark.parametrize(("told", "others", "expected"), [
    ((60.0, 0.3), (61.0, 0.25), True), ((60.0, 0.3), (60.9, 0.25), False),
    ((60.0, 2.0), (67.2, 2.0), True), ((60.0, 2.0), (66.9, 2.0), False),
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
