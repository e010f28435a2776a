"""Analyzers that are not ideal come back from evenly lit fields, up to what those can tell."""

import numpy as np
import pytest

from polaropt import InputError
from polaropt.optics import Analyzer, analyzer_matrix, calibrate

ANGLES = (0.0, 45.0, 90.0, 135.0)
GAINS = (1.01, 0.97, 1.03, 0.99)
TRUE = Analyzer(ANGLES, GAINS, (0.98, 0.96, 0.97, 0.985), (0.4, 44.7, 90.3, 134.6))


def behind(turns_deg, level=0.4, analyzer=TRUE):
    """Means of the corners behind an ideal polarizer."""
    double = 2 * np.radians(np.atleast_1d(turns_deg))
    stokes = level * np.stack([np.ones_like(double), np.cos(double), np.sin(double)], axis=1)
    return np.array(analyzer.gains) * (stokes @ analyzer.matrix.T)


def unpolarized(level):
    return level * np.array(GAINS)[None] / 2


def test_unpolarized_fields_tell_the_gains_alone():
    found = calibrate(np.concatenate([unpolarized(0.3), unpolarized(0.8)]), ANGLES)
    np.testing.assert_allclose(found.analyzer.gains, GAINS, rtol=1e-12)
    assert (found.n_unpolarized, found.n_turns, found.complete) == (2, 0, False)
    assert found.analyzer.contrasts == (1, 1, 1, 1)
    assert found.analyzer.true_angles_deg == ANGLES


@pytest.mark.parametrize(
    ("turns", "with_flat"), [((0, 30, 75, 140), True), ((10, 33, 61, 99, 120), False), ((10, 33, 61, 99, 120), True)]
)
def test_turns_of_a_polarizer_tell_contrast_and_angle_up_to_a_rotation(turns, with_flat):
    fields = np.concatenate([behind(turns), *([unpolarized(0.5)] if with_flat else [])])
    found = calibrate(fields, ANGLES)
    assert found.complete
    assert not found.ambiguous
    np.testing.assert_allclose(found.analyzer.gains, GAINS, atol=1e-4)
    np.testing.assert_allclose(found.analyzer.contrasts, TRUE.contrasts, atol=1e-4)
    rotation = np.subtract(found.analyzer.true_angles_deg, TRUE.true_angles_deg)
    np.testing.assert_allclose(rotation, rotation[0], atol=5e-3)
    assert np.mean(np.subtract(found.analyzer.true_angles_deg, ANGLES)) == pytest.approx(0, abs=1e-4)


def test_the_ideal_analyzer_is_the_usual_matrix():
    ideal = Analyzer(ANGLES, (1,) * 4, (1,) * 4, ANGLES)
    np.testing.assert_allclose(ideal.matrix, analyzer_matrix(ANGLES))
    np.testing.assert_allclose(ideal.missing, 0)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (behind((0, 40, 85)), "3 turns of a polarizer and none is unpolarized"),
        (behind((0, 40, 85, 86, 87)), "3 turns"),
        (0 * behind((0, 40)), "dark"),
        (np.ones((2, 3)), "a mean for each corner"),
        (np.full((1, 4), np.nan), "dark"),
    ],
)
def test_fields_that_tell_nothing_are_one_line(fields, words):
    with pytest.raises(InputError, match=words):
        calibrate(fields, ANGLES)


def test_numbers_that_no_sensor_has_are_refused():
    with pytest.raises(InputError, match="gain is"):
        Analyzer(ANGLES, (3, 1, 1, 1), (1,) * 4, ANGLES)
    with pytest.raises(InputError, match="deviation in degrees"):
        Analyzer(ANGLES, (1,) * 4, (1,) * 4, (90, 45, 0, 135))


@pytest.mark.parametrize(("turns", "left_open"), [((0, 45, 90, 135), True), ((0, 45, 90, 135, 20), False)])
def test_turns_45_degrees_apart_leave_open_how_the_pairs_lie_and_make_up_nothing(turns, left_open):
    noise = 1 + 1e-4 * np.random.default_rng(1).standard_normal((len(turns) + 1, 4))
    found = calibrate(noise * np.concatenate([behind(turns), unpolarized(0.5)]), ANGLES)
    assert found.angles_open is left_open
    rotation = np.subtract(found.analyzer.true_angles_deg, TRUE.true_angles_deg)
    assert np.ptp(rotation) < (1.0 if left_open else 0.05)
    np.testing.assert_allclose(found.analyzer.contrasts, TRUE.contrasts, atol=2e-3)


def test_four_turns_alone_leave_something_open():
    found = calibrate(behind((0, 25, 60, 115)), ANGLES)
    assert found.complete
    assert found.ambiguous
    assert found.residual < 1e-6
    np.testing.assert_allclose(found.analyzer.gains, GAINS, atol=0.02)


def test_fields_that_contradict_each_other_leave_their_difference():
    other = np.array((1.03, 0.99, 1.01, 0.97))
    found = calibrate(np.concatenate([unpolarized(0.3), 0.2 * other[None]]), ANGLES)
    np.testing.assert_allclose(found.analyzer.gains, (np.array(GAINS) + other) / 2, rtol=1e-12)
    assert found.residual == pytest.approx(np.sqrt(np.mean(np.square(np.array(GAINS) - other))) / 2)
    assert calibrate(unpolarized(0.3), ANGLES).residual < 1e-12


def test_what_turns_leave_is_a_share_of_the_light():
    fields = np.concatenate([behind((10, 33, 61, 99, 120)), unpolarized(0.5)])
    assert calibrate(fields, ANGLES).residual < 1e-6
    shaken = fields * (1 + 0.01 * np.random.default_rng(0).choice([-1, 1], fields.shape))
    of_dim = calibrate(1e-3 * shaken, ANGLES)
    assert 0.002 < of_dim.residual < 0.01
    assert of_dim.residual == pytest.approx(calibrate(shaken, ANGLES).residual, rel=1e-3)
    np.testing.assert_allclose(of_dim.analyzer.gains, GAINS, atol=0.01)


def test_an_analyzer_has_as_many_numbers_of_each_kind():
    for lists in (((0.0, 90.0), (1.0, 1.0), (1.0, 1.0), (0.0, 90.0)), (ANGLES, (1.0,) * 3, (1.0,) * 4, ANGLES)):
        with pytest.raises(InputError, match="for each corner"):
            Analyzer(*lists)
    Analyzer((0.0, 60.0, 120.0), (1.0,) * 3, (1.0,) * 3, (0.0, 60.0, 120.0))


def test_dim_fields_are_seen_to_be_polarized_or_not():
    fields = 1e-3 * np.concatenate([behind((10, 33, 61, 99, 120)), unpolarized(0.5)])
    found = calibrate(fields, ANGLES)
    assert (found.n_turns, found.n_unpolarized) == (5, 1)
    np.testing.assert_allclose(found.analyzer.contrasts, TRUE.contrasts, atol=1e-4)
