"""What a mosaic's samples tell of ghosts (distance, side, or that there are none) and of the incidence."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polaropt import SceneParameters
from polaropt.capture import Capture, RawSamples
from polaropt.capture.mosaic import sampling_of
from polaropt.estimation.flat.samples.ghosts import (
    SampledLikelihood,
    SampledPane,
    pane_of_samples,
    sampled_pane,
)
from polaropt.simulation import Camera, cut, photograph_mosaic, shipped_photograph

MONO, ANGLES = sampling_of(False)
COLOR, _ = sampling_of(True)
NOISE = 0.005


def samples_of(scene: SceneParameters, *, color: bool = False, side: int = 256) -> RawSamples:
    first, second = (
        cut(shipped_photograph(name), (side, side), place)
        for name, place in (("coffee", (0.5, 0.5)), ("astronaut", (0.1, 0.4)))
    )
    return mosaic_of(first, second, scene, color=color)


def mosaic_of(
    first: NDArray[np.float32], second: NDArray[np.float32], scene: SceneParameters, *, color: bool = False
) -> RawSamples:
    camera = Camera(noise=NOISE, bits=12, seed=1, lens_blur_px=0.7)
    raw = photograph_mosaic(first, second, scene, camera, color).astype(np.float32)
    return RawSamples(raw, np.ones(raw.shape, dtype=bool), COLOR if color else MONO)


def patchwork(seed: int, side: int = 256) -> NDArray[np.float32]:
    """Patches of 16 px, each with a brightness of its own."""
    patches = np.random.default_rng(seed).uniform(0.1, 0.9, (side // 16, side // 16, 1))
    return np.repeat(np.repeat(patches, 16, axis=0), 16, axis=1).repeat(3, axis=2).astype(np.float32)


def told(scene: SceneParameters, about_px: float, *, color: bool = False) -> SampledPane:
    found = sampled_pane(
        samples_of(scene, color=color), ANGLES, scene.replace(ghost_shift=about_px), NOISE, open_incidence=False
    )
    assert found is not None
    assert found.incidence_deg == scene.incidence_deg
    assert found.incidence_error_deg is None
    return found


@pytest.mark.parametrize(("shift", "about", "color"), [(4.0, -3.0, False), (-4.0, 5.5, True)], ids=["mono", "color"])
def test_ghosts_lie_where_they_are_to_the_side_where_they_are(shift: float, about: float, *, color: bool) -> None:
    found = told(SceneParameters(75.0, 30.0, shift), about, color=color)
    assert found.shift_px == pytest.approx(shift, abs=0.8)
    assert found.shift_error_px is not None
    assert 0 < found.shift_error_px < 1


def test_there_are_none_where_the_cells_low_pass_was_taken_for_some() -> None:
    assert told(SceneParameters(60.0, 75.0, 0.0), 3.0).shift_px == 0


def test_where_the_cells_show_none_the_samples_are_asked() -> None:
    assert told(SceneParameters(75.0, 30.0, 4.0), 0.0).shift_px == pytest.approx(4, abs=0.8)


def test_where_the_distance_is_known_only_the_side_is_told() -> None:
    scene = SceneParameters(65.0, 30.0, -4.0)
    found = sampled_pane(samples_of(scene), ANGLES, scene.replace(ghost_shift=4.0), NOISE, sense_only=True)
    assert found == SampledPane(-4.0, None, 65.0, None)


def test_far_ghosts_are_left_to_the_cells() -> None:
    scene = SceneParameters(65.0, 30.0, 40.0)
    assert sampled_pane(samples_of(scene.replace(ghost_shift=4.0)), ANGLES, scene, NOISE) is None


def test_samples_without_light_or_detail_do_no_harm() -> None:
    scene = SceneParameters(60.0, 30.0, 3.0)
    random = np.random.default_rng(0)
    for level in (0.0, 0.4):
        values = (level + NOISE * random.standard_normal((96, 130))).astype(np.float32)
        samples = RawSamples(values, np.ones(values.shape, dtype=bool), MONO)
        found = sampled_pane(samples, ANGLES, scene, NOISE)
        assert found is not None
        assert np.isfinite([found.shift_px, found.incidence_deg]).all()


def test_what_is_not_valid_does_not_count() -> None:
    scene = SceneParameters(75.0, 30.0, 4.0)
    whole = samples_of(scene)
    spoiled = whole.values.copy()
    valid = np.random.default_rng(0).random(spoiled.shape) > 0.01
    spoiled[~valid] = 50
    open_scene = scene.replace(ghost_shift=3.0)
    found = sampled_pane(RawSamples(spoiled, valid, MONO), ANGLES, open_scene, NOISE, open_incidence=False)
    assert found is not None
    assert found.shift_px == pytest.approx(4, abs=0.8)


def test_bands_of_tiles_left_out_are_near_the_whole() -> None:
    scene = SceneParameters(65.0, 30.0, 4.0)
    likelihood = SampledLikelihood(samples_of(scene), ANGLES, scene, NOISE, 64)
    whole = likelihood.misfit(4.0)
    assert likelihood.left_out(4.0) == pytest.approx(np.full(6, whole), abs=0.5)
    assert whole < likelihood.misfit(-4.0)


def both_told(samples: RawSamples, about: SceneParameters, error_deg: float) -> SampledPane:
    found = sampled_pane(samples, ANGLES, about, NOISE, incidence_error_deg=error_deg)
    assert found is not None
    assert found.incidence_error_deg is not None
    return found


@pytest.mark.parametrize(
    ("incidence", "about", "color"), [(40.0, 43.0, False), (60.0, 58.0, True), (75.0, 77.0, False)]
)
def test_incidence_and_ghosts_are_told_together(incidence: float, about: float, *, color: bool) -> None:
    scene = SceneParameters(incidence, 30.0, 4.0)
    found = both_told(samples_of(scene, color=color), scene.replace(incidence_deg=about, ghost_shift=3.0), 2.0)
    assert found.incidence_deg == pytest.approx(incidence, abs=1.5)
    # Where ghosts are faint closer ones explain much the same.
    assert found.shift_px == pytest.approx(4, abs=1) or incidence < 70
    assert 0.5 < found.incidence_error_deg < 2


def test_the_incidence_is_told_where_both_layers_have_their_edges_in_the_same_places() -> None:
    scene = SceneParameters(55.0, 30.0, 4.0)
    samples = mosaic_of(patchwork(0), patchwork(1), scene)
    found = sampled_pane(samples, ANGLES, scene.replace(incidence_deg=48.0), NOISE, open_shift=False)
    assert found is not None
    assert found.incidence_deg == pytest.approx(55, abs=2)


def test_ghosts_that_are_given_stay_where_they_are() -> None:
    scene = SceneParameters(60.0, 30.0, 3.5)
    found = sampled_pane(samples_of(scene), ANGLES, scene.replace(incidence_deg=56.0), NOISE, open_shift=False)
    assert found is not None
    assert (found.shift_px, found.shift_error_px) == (3.5, None)
    assert found.incidence_deg == pytest.approx(60, abs=1.5)


def test_photographs_without_a_mosaic_have_no_samples_to_ask() -> None:
    photographs = Capture.of_planes(np.random.default_rng(0).random((4, 32, 32)).astype(np.float32), ANGLES)
    assert pane_of_samples(photographs, SceneParameters(60.0, 30.0, 4.0), NOISE) is None
