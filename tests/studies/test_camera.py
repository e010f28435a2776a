"""Photographs are what the scene's light, camera and photographer make of the engine's light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polaropt.simulation.simulator import exact_photographs, simulate
from studies.camera import SceneJob, bent_photographs, take
from studies.photographs import pairs_of, shipped_pairs
from studies.scenes import BLIND, SCENES, STABILITY, Pane, Scene, Taking, protocol
from studies.scores import psnr
from studies.ways import COMPONENTS, METHODS, PLAIN

PAIR = shipped_pairs(size=48, margin=48)[0]
EASY = Scene("easy", draw="stability")


def test_captures_are_the_same_each_time():
    pair = shipped_pairs(size=32, margin=32)[0]
    first, second = (take(protocol(60), pair) for _ in range(2))
    np.testing.assert_array_equal(first.capture.intensities, second.capture.intensities)
    assert first.scene.ghost_shift == pytest.approx(8.165, abs=0.01)


def test_the_protocol_is_what_polaropt_simulates():
    sample = take(protocol(60), PAIR)
    larger = simulate(PAIR.transmission, PAIR.reflection, sample.scene, noise=0.005, bits=12, seed=PAIR.number)
    np.testing.assert_array_equal(sample.capture.intensities, PAIR.cropped(larger.intensities))
    np.testing.assert_array_equal(sample.capture.valid, PAIR.cropped(larger.valid))
    np.testing.assert_array_equal(sample.layers, PAIR.layers)


def test_a_job_takes_its_pair():
    job = SceneJob(SCENES["60 deg"], 1, size=32)
    assert job.photographs is pairs_of(None, 32, 16)[1]
    assert job.sample().layers.shape == (2, 3, 32, 32)


def test_the_easy_ends_of_the_camera_are_the_engine_and_noise():
    sample = take(replace(EASY, taking=Taking(noise=0.001, bits=16)), PAIR)
    layers = np.moveaxis(np.stack([PAIR.transmission, PAIR.reflection]), -1, 1)
    expected = exact_photographs(layers, sample.scene, sample.capture.angles_deg)
    residual = sample.capture.intensities - PAIR.cropped(expected)
    assert float(residual.std()) == pytest.approx(0.001, rel=0.1)
    assert sample.hint == BLIND


def test_what_is_given_wrongly_is_off_by_what_the_scene_says():
    for scene in STABILITY:
        if "told wrongly" in scene.family:
            sample = take(scene, PAIR)
            name = {"i": "incidence_deg", "a": "azimuth_deg", "g": "ghost_shift"}[scene.family[0]]
            assert getattr(sample.hint, name) - getattr(sample.scene, name) == pytest.approx(scene.value)


def test_a_pane_that_is_not_bent_is_flat():
    scene = take(replace(EASY, pane=Pane(ghosts="in place")), PAIR).scene
    layers = np.random.default_rng(0).random((2, 3, 20, 30)).astype(np.float32)
    flat = exact_photographs(layers, scene, (0.0, 45.0, 90.0, 135.0))
    np.testing.assert_allclose(bent_photographs(layers, scene, 0.0, (0.0, 45.0, 90.0, 135.0)), flat, atol=1e-6)


def test_an_encoded_capture_is_the_linear_one_encoded():
    taking = Taking(bits=16, below_white=True)
    linear, encoded = (take(replace(EASY, taking=replace(taking, gamma=gamma)), PAIR) for gamma in (1.0, 2.0))
    dark = linear.capture.intensities < 0
    difference = encoded.capture.intensities**2 * np.where(dark, -1, 1) - linear.capture.intensities
    assert np.abs(difference[~dark]).max() < 1e-3
    # Without glass a photograph is half the layer.
    np.testing.assert_allclose((encoded.layers / 2) ** 2, linear.layers / 2, atol=1e-6)


def test_clipped_pixels_are_as_many_as_asked_for():
    sample = take(replace(EASY, taking=Taking(clipped_transmission=0.2)), PAIR)
    beyond = (sample.layers[0] > 1.9).any(axis=0).mean()
    assert beyond == pytest.approx(0.2, abs=0.02)
    clipped = take(replace(EASY, taking=Taking(clipped=0.1)), PAIR)
    assert clipped.unclipped.mean() == pytest.approx(0.9, abs=0.03)
    assert take(replace(EASY, taking=Taking(clipped=0.1, headroom=True)), PAIR).capture.valid.all()


def test_photographs_lie_apart_as_far_as_asked_for():
    takings = (Taking(below_white=True, shift_px=shift) for shift in (0.0, 5.0))
    still, moved = (take(replace(EASY, taking=taking), PAIR).capture for taking in takings)
    np.testing.assert_array_equal(still.intensities[[0, 2]], moved.intensities[[0, 2]])
    # 3 px down and 4 to the right.
    assert np.abs(moved.intensities[1, :, 3:, 4:] - still.intensities[1, :, :-3, :-4]).mean() < 0.03


def test_components_that_are_given_their_scale_beat_doing_nothing_where_bounces_are_in_place():
    sample = take(Scene("f", Pane(70.0, ghosts="in place"), Taking(below_white=True), draw="stability"), PAIR)
    errors = {name: np.square(METHODS[name].run(sample)[0] - sample.layers[0]).mean() for name in (COMPONENTS, PLAIN)}
    assert errors[COMPONENTS] < 0.5 * errors[PLAIN]
    assert psnr(METHODS[PLAIN].run(sample)[0], sample.layers[0], sample.unclipped) > 10
