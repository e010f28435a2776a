"""Where a mosaic's samples have the ghosts: at the right distance, to the right side, and none where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import SceneParameters
from polaropt.capture import RawSamples
from polaropt.capture.mosaic import sampling_of
from polaropt.estimation.flat.sampled_ghosts import SampledShift, SampledShiftLikelihood, sampled_shift
from polaropt.simulation import Camera, cut, photograph_mosaic, shipped_photograph

MONO, ANGLES = sampling_of(False)
COLOR, _ = sampling_of(True)
NOISE = 0.005


def samples_of(scene: SceneParameters, *, color: bool = False, side: int = 256) -> RawSamples:
    first, second = (
        cut(shipped_photograph(name), (side, side), place)
        for name, place in (("coffee", (0.5, 0.5)), ("astronaut", (0.1, 0.4)))
    )
    camera = Camera(noise=NOISE, bits=12, seed=1, lens_blur_px=0.7)
    raw = photograph_mosaic(first, second, scene, camera, color).astype(np.float32)
    return RawSamples(raw, np.ones(raw.shape, dtype=bool), COLOR if color else MONO)


def told(scene: SceneParameters, about_px: float, *, color: bool = False) -> SampledShift:
    found = sampled_shift(samples_of(scene, color=color), ANGLES, scene.replace(ghost_shift=about_px), NOISE)
    assert found is not None
    return found


@pytest.mark.parametrize("color", [False, True], ids=["mono", "color"])
@pytest.mark.parametrize(("shift", "about"), [(4.0, -3.0), (-4.0, 5.5)])
def test_ghosts_lie_where_they_are_to_the_side_where_they_are(shift: float, about: float, *, color: bool) -> None:
    found = told(SceneParameters(75.0, 30.0, shift), about, color=color)
    assert found.shift_px == pytest.approx(shift, abs=0.8)
    assert 0 < found.error_px < 1


def test_there_are_none_where_the_cells_low_pass_was_taken_for_some() -> None:
    assert told(SceneParameters(60.0, 75.0, 0.0), 3.0).shift_px == 0


def test_where_the_cells_show_none_the_samples_are_asked() -> None:
    assert told(SceneParameters(75.0, 30.0, 4.0), 0.0).shift_px == pytest.approx(4, abs=0.8)


def test_where_the_distance_is_known_only_the_side_is_told() -> None:
    scene = SceneParameters(65.0, 30.0, -4.0)
    found = sampled_shift(samples_of(scene), ANGLES, scene.replace(ghost_shift=4.0), NOISE, sense_only=True)
    assert found == SampledShift(-4.0, 0.0)


def test_far_ghosts_are_left_to_the_cells() -> None:
    scene = SceneParameters(65.0, 30.0, 40.0)
    assert sampled_shift(samples_of(scene.replace(ghost_shift=4.0)), ANGLES, scene, NOISE) is None


def test_samples_without_light_or_detail_do_no_harm() -> None:
    scene = SceneParameters(60.0, 30.0, 3.0)
    random = np.random.default_rng(0)
    for level in (0.0, 0.4):
        values = (level + NOISE * random.standard_normal((96, 130))).astype(np.float32)
        samples = RawSamples(values, np.ones(values.shape, dtype=bool), MONO)
        found = sampled_shift(samples, ANGLES, scene, NOISE)
        assert found is not None
        assert np.isfinite(found.shift_px)


def test_what_is_not_valid_does_not_count() -> None:
    scene = SceneParameters(75.0, 30.0, 4.0)
    whole = samples_of(scene)
    spoiled = whole.values.copy()
    valid = np.random.default_rng(0).random(spoiled.shape) > 0.01
    spoiled[~valid] = 50
    open_scene = scene.replace(ghost_shift=3.0)
    found = sampled_shift(RawSamples(spoiled, valid, MONO), ANGLES, open_scene, NOISE)
    assert found is not None
    assert found.shift_px == pytest.approx(4, abs=0.8)


def test_bands_of_tiles_left_out_are_near_the_whole() -> None:
    scene = SceneParameters(65.0, 30.0, 4.0)
    likelihood = SampledShiftLikelihood(samples_of(scene), ANGLES, scene, NOISE, 64)
    whole = likelihood.misfit(4.0)
    assert likelihood.left_out(4.0) == pytest.approx(np.full(6, whole), abs=0.5)
    assert whole < likelihood.misfit(-4.0)
