"""How likely single tiles of a capture are under windows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from polaropt import Capture, SceneParameters
from polaropt.capture import PlateFrame, noise_level, plate_frame, stokes_images
from polaropt.estimation import find_scene, likelier_index
from polaropt.estimation.flat.windows.axis import window_of as window_of_scene
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileLikelihood
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of
from studies.random_windows.windows import window_of

NOISE = 0.005
TWO = SceneParameters(60.0, 25.0, 2.0, n_panes=2, gap_shift=9.0)
TRUE = Window(60.0, 2.0, 9.0, n_panes=2)


@cache
def frame() -> PlateFrame:
    photographs = pairs_of(None, 192)[0]
    layers = photographs.transmission, photographs.reflection
    capture = photograph_pair(*layers, TWO, Camera(noise=NOISE), margin=photographs.margin)
    return plate_frame(stokes_images(capture, NOISE), 25.0)


@cache
def tiles() -> TileLikelihood:
    return TileLikelihood(frame())


@pytest.mark.parametrize(
    "changes",
    [
        {"n_panes": 1, "gap_along": 0.0, "incidence_deg": 72.0},
        {"n_panes": 3, "incidence_deg": 51.0},
        {"gap_along": -9.0},
        {"gap_across": 4.0},
        {"pane_shift": 6.0},
    ],
)
def test_the_true_window_is_surely_likelier_than_others_at_their_likeliest_incidence(changes: dict[str, float]) -> None:
    true, other = (tiles().nearest(window, 1.5) for window in (TRUE, replace(TRUE, **changes)))
    assert true.surer_than(other) > 3.5
    assert other.surer_than(true) == -true.surer_than(other)


def test_the_likeliest_incidence_is_the_true_one() -> None:
    nearest = tiles().nearest(replace(TRUE, incidence_deg=58.5), 1.5)
    assert abs(nearest.window.incidence_deg - 60) < 0.5
    # What is not to be found stays as it is.
    assert replace(nearest.window, incidence_deg=60.0) == TRUE


def test_a_window_that_is_told_is_only_fitted() -> None:
    assert tiles().nearest(TRUE, 1.5, ()).misfits == pytest.approx(tiles().fitted(TRUE, 1.5).misfits)


def test_luminance_says_the_same_with_a_third_of_the_numbers() -> None:
    luminance = tiles().luminance()
    true, single = luminance.nearest(TRUE, 1.5), luminance.nearest(Window(72.0, 2.0), 1.5)
    assert 3 * true.misfits.size == tiles().fitted(TRUE, 1.5).misfits.size
    assert true.surer_than(single) > 3.5


def test_ghosts_along_another_direction_are_those_of_a_turned_gap() -> None:
    # Without a shift of the pane the images of a gap at 90 degrees lie as those along an azimuth that far turned.
    turned = TileLikelihood(frame()).with_ghosts_along(frame().azimuth_deg - 90.0)
    aside, along = Window(60.0, 0.0, 0.0, 9.0, n_panes=2), Window(60.0, 0.0, 9.0, n_panes=2)
    assert turned.fitted(along, 1.5).misfit == pytest.approx(tiles().fitted(aside, 1.5).misfit, rel=1e-4)


def test_noise_alone_prefers_no_window() -> None:
    noise = np.random.default_rng(0).normal(0.5, NOISE, (4, 3, 128, 128)).astype(np.float32)
    dark = plate_frame(stokes_images(Capture.of_planes(noise, (0.0, 45.0, 90.0, 135.0)), NOISE), 0.0)
    two, one = (TileLikelihood(dark).fitted(window, 1.5) for window in (TRUE, Window(72.0, 2.0)))
    assert abs(two.surer_than(one)) < 3.5


def test_three_panes_at_a_steep_view_are_no_polarized_light() -> None:
    # 248: three panes 18 px apart passed for polarized light behind one, 25 dB below the known scene.
    sample = window_of(248, 192).sample(None, 192)
    found = find_scene(sample.capture, sample.hint, noise_level(sample.capture)).scene
    assert (found.n_panes, found.rung) == (3, "ghosts")
    assert abs(found.values()[0] - sample.scene.values()[0]) < 0.5


def test_double_images_tell_an_index_where_edges_do_not() -> None:
    # 276: 1.787 told as 1.5, 11 dB below the known scene, with no warning.
    sample = window_of(276, 192).sample(None, 192)
    noise = noise_level(sample.capture)
    told = likelier_index(sample.capture, find_scene(sample.capture, sample.hint, noise).scene, noise)
    assert told is not None
    assert told.sure
    assert abs(told.index - sample.scene.index) < 2 * told.error < 0.25
    right = sample.scene.replace(azimuth_deg=sample.scene.values()[1] % 180)
    assert likelier_index(sample.capture, right, noise) is None


def test_a_scene_is_its_window() -> None:
    assert window_of_scene(TWO, 25.0) == TRUE
