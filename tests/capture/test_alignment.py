"""Photographs shifted against each other are found out and moved back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from polaropt import Capture, InputError, align, separate
from polaropt.capture.registration import measure_shifts
from polaropt.cli.app import main
from polaropt.reporting.words import alignment_sentence
from polaropt.simulation.metrics import psnr_db
from tests.blends import blend
from tests.command_line import QUICK
from tests.shifted import shifted_blend

PANE = ["--incidence", "60", "--azimuth", "25", "--shift", "5.3"]
NOWHERE = np.zeros((4, 2))
HAND = np.array([[0, 0], [3.4, -7.2], [-12.6, 5.5], [8.3, 9.7]])


def random_shifts(count, farthest, seed):
    shifts = np.random.default_rng(seed).uniform(-farthest / 2, farthest / 2, (count, 2))
    return shifts - shifts[0]


# What colours add to the light of all of them is noise of its own: grey at every incidence, colour at the ends.
@pytest.mark.parametrize(
    ("incidence", "color"), [(20, False), (40, False), (60, False), (80, False), (20, True), (80, True)]
)
def test_known_shifts_come_back(incidence, color):
    shifts = random_shifts(4, 20, incidence)
    found = measure_shifts(shifted_blend(incidence, 208, shifts, color=color).capture)
    assert np.abs(found.pixels - shifts).max() < 0.05
    assert np.abs(found.pixels - shifts).max() < 5 * found.error + 0.005
    assert found.certain


@pytest.mark.parametrize("angles", [(0, 60, 120), (5, 40, 77, 110, 150)])
def test_any_angles(angles):
    shifts = random_shifts(len(angles), 8, 0)
    found = measure_shifts(shifted_blend(60, 160, shifts, angles_deg=angles).capture)
    assert np.abs(found.pixels - shifts).max() < 0.05


@pytest.mark.parametrize(("incidence", "noise"), [(20, 0.01), (50, 0.002), (80, 0.01)])
def test_photographs_that_lie_on_each_other_are_left_alone(incidence, noise):
    capture = blend(incidence, 128, noise=noise).capture
    assert align(capture) is capture
    assert "nothing was moved" in alignment_sentence(capture)


def test_photographs_of_nothing_but_noise_are_left_alone():
    capture = Capture(0.5 + 0.01 * np.random.default_rng(0).standard_normal((4, 64, 64)))
    assert align(capture) is capture


def test_clipped_pixels_do_not_matter():
    shifts = HAND / 3
    clean = shifted_blend(60, 160, shifts).capture
    clipped = shifted_blend(60, 160, shifts, exposure=2.4).capture
    assert 0.01 < 1 - clipped.valid.mean() < 0.5
    found, expected = measure_shifts(clipped), measure_shifts(clean)
    assert np.abs(found.pixels - shifts).max() < 0.05
    assert np.abs(found.pixels - expected.pixels).max() < 0.05
    aligned = align(clipped)
    assert 0.5 < aligned.valid.mean() / clipped.valid.mean() < 1.1


def test_gains_and_exposures_do_not_matter():
    shifts = HAND / 3
    capture = shifted_blend(60, 128, shifts).capture
    uneven = Capture.of_planes(capture.intensities * np.array([1, 0.9, 1.05, 0.8]).reshape(4, 1, 1, 1))
    assert np.abs(measure_shifts(uneven).pixels - shifts).max() < 0.05


def test_only_what_all_photographs_show_is_kept_and_told():
    example = shifted_blend(60, 128, HAND)
    aligned = align(example.capture.with_origin(files=("a.png",), layout="stack", white_level=4095))
    # The first photograph stays; the others lie 12.6 px up to 8.3 px down, 7.2 px left to 9.7 px right of it.
    assert aligned.shape == (3, 128 - 13 - 9, 128 - 8 - 10)
    np.testing.assert_array_equal(aligned.intensities[0], example.capture.intensities[0, :, 13:-9, 8:-10])
    assert (aligned.origin.files, aligned.origin.white_level) == (("a.png",), 4095)
    np.testing.assert_allclose(aligned.origin.shifts_px, HAND, atol=0.05)
    assert "(+3.4" in alignment_sentence(aligned)


def test_aligned_photographs_need_no_further_alignment():
    aligned = align(shifted_blend(60, 128, HAND / 3).capture)
    assert measure_shifts(aligned).largest < 0.05
    assert align(aligned) is aligned


@pytest.mark.parametrize("incidence", [20, 80])
def test_a_separation_loses_little_by_having_been_aligned(incidence):
    shifted = shifted_blend(incidence, 160, HAND, color=False)
    still = shifted_blend(incidence, 160, NOWHERE, color=False)
    frame = (slice(13, -9), slice(8, -10))
    truth = still.layers[..., frame[0], frame[1]]
    reached = []
    for capture in (still.capture.part(*frame), align(shifted.capture)):
        layers = separate(capture, still.scene).layers
        reached.append([psnr_db(layers[k], truth[k], 8) for k in (0, 1)])
    assert np.all(np.array(reached[1]) > np.array(reached[0]) - 0.7)


def test_photographs_too_far_apart_are_refused(monkeypatch):
    capture = blend(60, 32).capture
    far = np.array([[0, 0], [20.0, 0], [0, 0], [0, 0]])
    from polaropt.capture.registration import Shifts

    monkeypatch.setattr("polaropt.capture.alignment.measure_shifts", lambda _: Shifts(far, 0.1, True))
    with pytest.raises(InputError, match="too little of them overlaps"):
        align(capture)


@pytest.fixture(scope="module")
def moved_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("moved") / "moved.npz"
    np.savez(path, intensities=np.moveaxis(shifted_blend(60, 96, HAND / 3).capture.intensities, 1, -1))
    return str(path)


def test_the_command_line_aligns_and_tells(moved_file, tmp_path, capsys):
    assert main(["separate", moved_file, "--align", *PANE, "-o", str(tmp_path), *QUICK]) == 0
    assert "moved back" in capsys.readouterr().out
    report = json.loads((tmp_path / "report.json").read_text())
    np.testing.assert_allclose(report["input"]["shifts_px"], HAND / 3, atol=0.1)
    assert 0 < report["input"]["shift_error_px"] < 0.1
    assert "MISALIGNED" not in [warning["name"] for warning in report["diagnostics"]["warnings"]]


def test_inspect_tells_before_and_after(moved_file, capsys):
    assert main(["inspect", moved_file]) == 0
    assert "ATTENTION: photographs look shifted" in capsys.readouterr().out
    assert main(["inspect", moved_file, "--align"]) == 0
    said = capsys.readouterr().out
    assert "moved back" in said
    assert "look shifted" not in said


def test_estimate_aligns_too(moved_file, capsys):
    assert main(["estimate", moved_file, "--align", *PANE]) == 0
    assert "moved back" in capsys.readouterr().out
