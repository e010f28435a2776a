"""Gains of a polarization camera's analyzers: found as its photographs do not add up, divided out, and told."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from polaropt import Capture, SceneParameters, Separation, SeparationWarning, separate, separate_sequence
from polaropt.capture import SONY_CELL, mosaic_capture, registered_noise, sampling_of
from polaropt.estimation import uneven_exposures
from polaropt.numerics import turn_between
from polaropt.reporting import matching_report, matching_sentences
from polaropt.simulation import Camera, photograph_mosaic, simulated_mosaic
from polaropt.simulation.metrics import psnr_db
from studies.photographs import pairs_of

SIDE, NOISE = 160, 0.004
PANE = SceneParameters(55.0, 25.0, 5.0)
BLIND = SceneParameters(None, None, None)
GAINS, ALIKE = (1.02, 1.0, 0.985, 0.99), (1.0,) * 4
SENSORS = ("mono", "color")


@cache
def raw_of(sensor: str, scene: SceneParameters, gains: tuple[float, ...]) -> np.ndarray:
    """Samples whose analyzers at 0, 45, 90 and 135 degrees have gains."""
    photographs = pairs_of(None, SIDE)[0]
    camera = Camera(noise=NOISE, lens_blur_px=0.7)
    raw = 0.9 * photograph_mosaic(photographs.transmission, photographs.reflection, scene, camera, sensor == "color")
    sampling, _ = sampling_of(sensor == "color")
    period = sampling.period
    for photograph, _, row, column in sampling.places:
        raw[row::period, column::period] *= np.float32(gains[photograph])
    return raw


@cache
def taken(
    sensor: str = "mono", gains: tuple[float, ...] = GAINS, scene: SceneParameters = PANE, resolution: str = "sensor"
) -> Capture:
    return simulated_mosaic(raw_of(sensor, scene, gains), sensor == "color", resolution)


@cache
def separated(sensor: str, gains: tuple[float, ...] = GAINS, match: bool = True) -> Separation:
    return separate(taken(sensor, gains), match_photographs=match)


def relative(gains: tuple[float, ...]) -> np.ndarray:
    return np.exp(np.log(gains) - np.log(gains).mean())


def left_of(found: np.ndarray, scene: SceneParameters = PANE, gains: tuple[float, ...] = GAINS) -> np.ndarray:
    """Logarithms of gains that were not found, but for the ratio that no pixel tells: along the azimuth to across."""
    along = np.cos(2 * np.radians(np.array([0.0, 45.0, 90.0, 135.0]) - scene.values()[1]))
    left = np.log(found) - np.log(relative(gains))
    return np.asarray(left - left @ along / (along @ along) * along)


@pytest.mark.parametrize("sensor", SENSORS)
def test_they_are_found_divided_out_and_told(sensor: str) -> None:
    result = separated(sensor)
    assert result.matching is not None
    found = np.array(result.matching.exposures)
    np.testing.assert_allclose(left_of(found), 0, atol=1e-3)
    told = matching_report(result.matching)
    assert told["exposures"] is None
    np.testing.assert_allclose(told["gains"], found / found[0], atol=1e-4)
    (sentence,) = matching_sentences(told)
    assert sentence.startswith("The photographs were brought to one gain, of which their analyzers had 1, 0.9")
    assert abs(turn_between(result.scene.azimuth_deg, PANE.values()[1])) < 0.5
    assert abs(result.scene.incidence_deg - PANE.values()[0]) < 2 * result.errors.incidence_deg
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN not in result.diagnostics.warnings


def test_they_are_left_where_that_is_asked_for_and_turn_the_pane() -> None:
    left = separated("mono", match=False)
    assert left.matching is None
    assert abs(turn_between(left.scene.azimuth_deg, PANE.values()[1])) > 1
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN in left.diagnostics.warnings


def test_of_equal_ones_nothing_is_told_and_the_incidence_is_surer() -> None:
    alike = separated("mono", ALIKE)
    assert alike.matching is None
    assert alike.errors.incidence_deg < separated("mono").errors.incidence_deg


@pytest.mark.parametrize(
    "scene",
    [
        PANE,
        PANE.replace(transmission_polarization=(0.4, 70.0)),
        PANE.replace(reflection_polarization=(0.6, 10.0)),
        PANE.replace(focal_px=300.0),
        PANE.replace(incidence_deg=80.0),
        PANE.replace(n_panes=2, gap_shift=7.0),
    ],
    ids=["none", "screen", "sky", "wide lens", "steep", "two panes"],
)
@pytest.mark.parametrize("sensor", SENSORS)
def test_other_light_across_is_none_of_theirs(sensor: str, scene: SceneParameters) -> None:
    capture = taken(sensor, ALIKE, scene)
    assert uneven_exposures(capture.registered, BLIND, registered_noise(capture)) is None


def test_those_of_a_calibrated_camera_are_known() -> None:
    capture = taken().with_origin(calibrated=True)
    assert uneven_exposures(capture.registered, BLIND, registered_noise(capture)) is None


@pytest.mark.parametrize("gains", [GAINS, (1.0, 1.0225, 1.01, 1.015), (1.02, 1.03, 0.98, 1.03)])
def test_those_of_pairs_that_were_brought_to_one_gain_are_found_all_the_same(gains: tuple[float, ...]) -> None:
    raw = raw_of("mono", PANE, gains)
    capture = mosaic_capture(raw, sensor="mono", cell_order=SONY_CELL, white_level=1.0, gamma=1.0)
    assert capture.origin is not None
    pair = np.array([1.0, capture.origin.pair_gain, 1.0, capture.origin.pair_gain])
    assert abs(pair[1] - 1) > 2e-3
    found = uneven_exposures(capture.registered, BLIND, registered_noise(capture))
    assert found is not None
    np.testing.assert_allclose(left_of(found.relative[:, 0] * relative(tuple(pair)), gains=gains), 0, atol=1e-3)


def test_the_usual_gain_of_a_sensors_pair_is_no_reason_to_look_for_others() -> None:
    raw = raw_of("mono", PANE.replace(transmission_polarization=(0.02, 70.0)), (1.0, 1.0225, 1.0, 1.0225))
    capture = mosaic_capture(raw, sensor="mono", cell_order=SONY_CELL, white_level=1.0, gamma=1.0)
    assert capture.origin is not None
    assert capture.origin.pair_gain == pytest.approx(1.0225, abs=5e-4)
    assert uneven_exposures(capture.registered, BLIND, registered_noise(capture)) is None


@pytest.mark.parametrize("resolution", ["sensor", "cell"])
@pytest.mark.parametrize("sensor", SENSORS)
def test_without_them_a_mosaic_is_as_if_there_were_none(sensor: str, resolution: str) -> None:
    """What is interpolated between samples of several analyzers has the gains of all of them in it."""
    divided, alike = (
        taken(sensor, resolution=resolution).without_gains(GAINS),
        taken(sensor, ALIKE, resolution=resolution),
    )
    np.testing.assert_allclose(divided.registered.intensities, alike.registered.intensities, atol=1e-6)
    assert divided.cells is not None
    assert alike.cells is not None
    np.testing.assert_allclose(divided.cells.samples.values, alike.cells.samples.values, atol=1e-6)
    # How they are interpolated depends on the noise, which gains change a little.
    assert psnr_db(divided.intensities, alike.intensities) > 55
    assert (divided.samples is None) == (resolution == "cell")


def test_photographs_without_gains_are_divided_by_them() -> None:
    photographs = taken().registered
    divided = photographs.without_gains(GAINS)
    np.testing.assert_allclose(divided.intensities * np.array(GAINS)[:, None, None], photographs.intensities, rtol=1e-6)


@pytest.mark.parametrize("resolution", ["sensor", "cell"])
def test_frames_of_a_film_have_those_of_the_first(resolution: str) -> None:
    capture = taken(resolution=resolution)
    first, second = separate_sequence([capture, capture], PANE)
    for frame in (first, second):
        assert frame.matching is not None
        np.testing.assert_allclose(left_of(np.array(frame.matching.exposures)), 0, atol=1e-3)
        np.testing.assert_array_equal(frame.matching.capture.intensities, first.matching.capture.intensities)
    assert psnr_db(first.transmission, second.transmission) > 50
