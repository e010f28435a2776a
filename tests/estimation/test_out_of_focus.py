"""Panes before pictures out of focus: their spectra fall faster than natural ones, and show no double images."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from polaropt import SceneParameters
from polaropt.capture import Capture, noise_level, plate_frame, stokes_images
from polaropt.estimation import estimate_scene, find_scene
from polaropt.estimation.flat import pane_by_tiles, window
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.ghosts import cross_spectra, spectral_shapes
from polaropt.estimation.flat.pane_by_tiles import _SURE_OF_NONE, with_ghosts_by_tiles
from polaropt.estimation.flat.window import with_window
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.numerics import frequencies, hann_spectra, sharpened, squared_blur
from polaropt.optics import SceneErrors
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of

NOISE = 0.004
OPEN = SceneParameters(None, None, None, n_panes=None, gap_shift=None, absorption=None)


def taken(scene: SceneParameters, pair: int, *, lens_px: float = 0.0, mirrored_px: float = 0.0) -> Capture:
    """Photographs behind a pane, all of it or what is mirrored out of focus by so many pixels."""
    photographs = pairs_of(None, 192)[pair]
    mirrored = gaussian_filter(photographs.reflection, mirrored_px, axes=(0, 1))
    camera = Camera(noise=NOISE, lens_blur_px=lens_px)
    return photograph_pair(photographs.transmission, mirrored, scene, camera, margin=photographs.margin)


def found_in(capture: Capture) -> SceneParameters:
    return find_scene(capture, OPEN, noise_level(capture)).scene


@pytest.mark.parametrize(("pair", "incidence_deg"), [(0, 46.0), (1, 57.0)])
def test_what_is_out_of_focus_is_no_double_image_and_no_further_pane(pair: int, incidence_deg: float) -> None:
    found = found_in(taken(SceneParameters(incidence_deg, 25.0, 0.0), pair, lens_px=2.5))
    assert (found.n_panes, found.ghost_shift) == (1, 0.0)
    assert found.values()[0] == pytest.approx(incidence_deg, abs=1.0)


def test_double_images_out_of_focus_are_found_where_they_are() -> None:
    found = found_in(taken(SceneParameters(57.7, 25.0, 6.8), 0, lens_px=2.5))
    assert found.n_panes == 1
    assert found.values() == pytest.approx((57.7, 25.0, 6.8), abs=0.5)


@pytest.mark.parametrize(("pair", "incidence_deg"), [(0, 60.5), (2, 74.0)])
def test_a_reflection_out_of_focus_has_no_double_image_of_its_own(pair: int, incidence_deg: float) -> None:
    found = found_in(taken(SceneParameters(incidence_deg, 25.0, 0.0), pair, mirrored_px=4.0))
    assert (found.ghost_shift, found.transmission_ghost_shift) == (0.0, None)
    assert found.values()[:2] == pytest.approx((incidence_deg, 25.0), abs=1.0)


@pytest.mark.parametrize(("sure", "kept"), [(_SURE_OF_NONE - 0.1, True), (_SURE_OF_NONE + 0.1, False)])
def test_double_images_of_one_layer_are_dropped_where_tiles_surely_find_none(
    sure: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Tiles:
        def __init__(self, frame: object) -> None:
            pass

        def nearest(self, window: Window, refractive_index: float, free: tuple[str, ...]) -> TileFit:
            spread = np.sqrt(1 - sure**2 / 16) * np.resize([1.0, -1.0], 16)
            return TileFit(window, refractive_index, sure / 4 + spread if window.pane_shift else np.zeros(16))

    monkeypatch.setattr(pane_by_tiles, "tile_likelihood", Tiles)
    monkeypatch.setattr(pane_by_tiles, "plate_frame", lambda stokes, azimuth_deg: None)
    own = SceneParameters(40.0, 20.0, 5.5, transmission_ghost_shift=0.1)
    errors = SceneErrors(ghost_shift=0.1, transmission_ghost_shift=0.1)
    estimate = SceneEstimate(own, 9.0, errors, True, 1.0, 0.0, np.inf, 0.5, *4 * [np.zeros(1)])
    asked = SceneParameters(40.0, 20.0, None)
    stokes = SimpleNamespace(aliased=False)
    found = with_ghosts_by_tiles(estimate, stokes, asked, is_flat=False)  # type: ignore[arg-type]
    assert (found.scene.transmission_ghost_shift is not None) == kept
    assert (found.errors.transmission_ghost_shift is not None) == kept
    assert found.scene.ghost_shift == (5.5 if kept else 0.0)
    # What is told is believed.
    told = asked.replace(ghost_shift=5.5, transmission_ghost_shift=0.1)
    assert with_ghosts_by_tiles(estimate, stokes, told, is_flat=False) is estimate  # type: ignore[arg-type]


@given(blur_px=st.floats(0.8, 4.0), noise=st.sampled_from([0.0, 1e-8, 1e-5]))
def test_a_gaussian_blur_of_natural_spectra_is_told(blur_px: float, noise: float) -> None:
    rows, columns = (part.ravel() for part in np.broadcast_arrays(*frequencies(64, 64)))
    radius = np.hypot(rows, columns)
    use = (radius > 0.2) & (radius < 2.8)
    radius, ones = radius[use], np.ones(np.count_nonzero(use))
    power = 3e-3 * np.exp(-((blur_px * radius) ** 2)) / radius**2 + noise
    assert squared_blur(power, noise, radius, ones) == pytest.approx(blur_px**2, rel=0.25)


def test_sharp_pictures_are_told_as_such_and_shapes_are_natural() -> None:
    for pair in range(3):
        capture = taken(SceneParameters(60.0, 25.0, 4.0), pair)
        sharp = cross_spectra(plate_frame(stokes_images(capture, NOISE), 25.0))
        assert sharp.blur_px2 == 0.0
        blurred = taken(SceneParameters(60.0, 25.0, 4.0), pair, lens_px=2.0)
        assert cross_spectra(plate_frame(stokes_images(blurred, NOISE), 25.0)).blur_px2 == pytest.approx(4.0, rel=0.25)
    np.testing.assert_array_equal(
        spectral_shapes(sharp.along, sharp.across_azimuth, 3, 2, 0.0),
        spectral_shapes(sharp.along, sharp.across_azimuth, 3, 2),
    )


def test_little_above_the_noise_tells_no_blur() -> None:
    radius = np.linspace(0.3, 2.8, 200)
    assert squared_blur(np.full(200, 1.5), 1.0, radius, np.ones(200)) == 0.0


def test_sharpened_pictures_keep_their_noise_and_their_spectra() -> None:
    random = np.random.default_rng(0)
    noise = random.standard_normal((150, 64, 64)).astype(np.float32)
    images, transfer = sharpened(noise, 2.0)
    power = (np.abs(hann_spectra(images) / transfer) ** 2).mean(axis=0)
    rows, columns = frequencies(64, 64)
    inside = (np.hypot(rows, columns) > 0.25) & (np.hypot(rows, columns) < 2.8)
    assert float(power[inside].mean()) == pytest.approx(1.0, abs=0.05)
    # A wave is amplified as is told of it.
    wave = np.cos(2 * np.pi * 4 / 32 * np.arange(32)) * np.ones((32, 1))
    made, transfer = sharpened(wave, 3.0)
    np.testing.assert_allclose(made[:, 2:-2], transfer[0, 4] * wave[:, 2:-2], atol=1e-6)


def test_several_panes_that_edges_contradict_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    capture = taken(SceneParameters(40.0, 25.0, 2.0, n_panes=2, gap_shift=9.0), 0)
    stokes, single = stokes_images(capture, NOISE), estimate_scene(capture, noise=NOISE)
    assert with_window(single, stokes, OPEN).scene.n_panes == 2
    monkeypatch.setattr(window, "_is_contradicted", lambda found, single: True)
    kept = with_window(single, stokes, OPEN)
    assert kept.scene == single.scene
    assert [rival.scene.n_panes for rival in kept.rivals] == [2]
