"""A pane that is told now and then: still, moving on, or mistaken for another by one frame."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.batch import Estimate
from polaropt.optics import SceneErrors, SceneParameters
from polaropt.sequence.follow import Track, changes

ERRORS = SceneErrors(incidence_deg=0.2, azimuth_deg=0.05, ghost_shift=0.05)


def told(incidence_deg: float = 60.0, azimuth_deg: float = 20.0, ghost_shift: float = 4.0) -> Estimate:
    return Estimate(SceneParameters(incidence_deg, azimuth_deg, ghost_shift), ERRORS)


def followed(azimuths_deg: list[float], every: int = 1) -> tuple[Track, list[float]]:
    """A track through frames of such azimuths, and how far it was off at each in standard errors that it states."""
    random, track, off = np.random.default_rng(3), Track(told(azimuth_deg=azimuths_deg[0]), every), []
    for azimuth in azimuths_deg[1:]:
        track.age += 1
        if track.age >= track.patience:
            track.see(told(azimuth_deg=azimuth + 0.05 * random.standard_normal()))
        stated = track.stated
        off.append(abs(stated.scene.azimuth_deg - azimuth) / stated.errors.azimuth_deg)
    return track, off


@pytest.mark.parametrize("step_deg", [0.1, 0.2, 2.0])
@pytest.mark.parametrize("every", [1, 3, 10])
def test_a_pane_that_moves_on_is_followed(step_deg: float, every: int) -> None:
    # Until frames have told how fast it moves nobody can know.
    track, off = followed([20 + step_deg * frame for frame in range(60)], every)
    assert max(off[2 * every + 2 :]) < 4
    assert track.stated.errors.azimuth_deg < 0.1 + 2 * step_deg


def test_a_pane_that_stands_still_is_asked_for_no_more_often_than_it_should_and_known_ever_better() -> None:
    random, track, asked = np.random.default_rng(3), Track(told(), every=10), []
    for frame in range(200):
        track.age += 1
        if track.age >= track.patience:
            asked.append(frame)
            track.see(told(60 + 0.2 * random.standard_normal(), 20 + 0.05 * random.standard_normal()))
    assert len(asked) < 30
    assert track.known.errors.incidence_deg < ERRORS.incidence_deg


def test_one_frame_that_errs_changes_nothing_but_the_errors() -> None:
    track = Track(told(), every=1, age=1)
    track.see(told(azimuth_deg=25.0))
    assert track.known.scene.azimuth_deg == 20
    assert track.stated.errors.azimuth_deg == pytest.approx(5, rel=0.01)
    track.age += 1
    track.see(told())
    assert track.known.scene.azimuth_deg == pytest.approx(20, abs=0.01)
    assert track.stated.errors.azimuth_deg < 0.06


def test_two_frames_that_say_the_same_of_another_pane_are_believed() -> None:
    track = Track(told(), age=10)
    track.see(told(azimuth_deg=25.0))
    track.age += 1
    track.see(told(azimuth_deg=25.02))
    assert track.known.scene.azimuth_deg == pytest.approx(25, abs=0.1)


def test_the_other_way_round_it_is_the_same_pane() -> None:
    track = Track(told(azimuth_deg=0.01), age=10)
    track.see(told(azimuth_deg=179.99, ghost_shift=-4.0))
    assert track.odd is None
    assert not any(track.speed.values())
    assert changes(track.known, told(azimuth_deg=0.0))["ghost_shift"] == pytest.approx(0)


def test_a_pane_that_stands_still_is_not_asked_for_after_a_knock_either() -> None:
    for every, asked in ((10.0, 1), (float("inf"), float("inf"))):
        track = Track(told(), every=every)
        track.doubt()
        assert track.patience == asked
