"""Photographs that a hand has turned, scaled or moved far are put back without being asked to."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from polaropt import Separation, SeparationWarning, separate
from polaropt.capture import far_motions, shifts_in_the_middle
from polaropt.capture.capture import Capture
from polaropt.capture.registration import Motions, corners
from polaropt.cli.app import main
from polaropt.estimation.motion import agreeing_photographs, still_photographs
from polaropt.simulation import psnr_db
from tests.blends import blend
from tests.captured import written_photographs
from tests.command_line import QUICK
from tests.turned import Turned, similarities, turned_blend

SIDE = 160
STILL = similarities(np.zeros(4), np.ones(4), np.zeros((4, 2)))
HAND = similarities(
    np.array([0, 0.5, -0.8, 0.3]),
    np.array([1, 1.004, 0.997, 1.002]),
    np.array([[0, 0], [1.4, -2.2], [-1.6, 2.5], [2.3, 0.7]]),
)
FAR = similarities(np.zeros(4), np.ones(4), np.array([[0, 0], [26.4, -3.2], [4.6, 5.5], [-2.3, 8.7]]))
PANE = ["--incidence", "60", "--azimuth", "25", "--shift", "5.3"]


@cache
def taken(which: str) -> Turned:
    """A capture of 160x160 pixels whose photographs were moved."""
    return turned_blend(60, SIDE, {"still": STILL, "hand": HAND, "far": FAR}[which], rim=40)


@cache
def separated(which: str) -> Separation:
    """What is separated of it with the scene known."""
    return separate(taken(which).capture, taken(which).scene)


def motions_of(capture: Capture) -> Motions | None:
    return far_motions(capture, shifts_in_the_middle(capture))


@pytest.mark.parametrize("which", ["hand", "far"])
def test_far_motions_are_found_to_a_tenth_of_a_pixel_at_the_corners(which: str) -> None:
    example = taken(which)
    found = motions_of(example.capture)
    assert found is not None
    at = corners(example.capture.shape)
    np.testing.assert_allclose(found.displacements(at), example.motions.displacements(at), atol=0.1)


@pytest.mark.parametrize(
    ("n", "scene"),
    [(3, {"angles_deg": (0.0, 60.0, 120.0)}), (4, {"focal_px": 250.0})],
    ids=["three photographs", "a wide lens"],
)
def test_they_are_put_back_at_other_angles_and_before_a_wide_lens(n: int, scene: dict[str, object]) -> None:
    hand = Motions(HAND.matrices[:n], HAND.offsets[:n])
    capture = turned_blend(50, SIDE, hand, rim=40, **scene).capture
    _, still, matching = agreeing_photographs(capture, still_photographs(capture))
    assert matching is not None
    assert matching.motions is not None
    at = corners(capture.shape)
    np.testing.assert_allclose(matching.motions.displacements(at), hand.displacements(at), atol=0.15)
    assert not still.mistakes.moved


def test_photographs_that_lie_in_place_or_a_little_beside_each_other_are_not_turned() -> None:
    assert motions_of(taken("still").capture) is None
    assert motions_of(blend(40, 128, noise=0.02).capture) is None
    near = similarities(np.zeros(4), np.ones(4), 0.3 * FAR.offsets)
    assert motions_of(turned_blend(60, SIDE, near, rim=40).capture) is None


@pytest.mark.parametrize("angle", [12.0, 20.0])
def test_what_lies_farther_apart_than_a_quarter_of_the_frame_is_not_turned_back(angle: float) -> None:
    turned = similarities(np.array([0, angle, -angle, 0]), np.ones(4), np.zeros((4, 2)))
    capture = turned_blend(60, SIDE, turned, rim=40).capture
    _, _, matching = agreeing_photographs(capture, still_photographs(capture))
    assert matching is None or matching.motions is None


@pytest.mark.parametrize(("which", "behind_by"), [("hand", 1.0), ("far", 2.0)])
def test_layers_are_nearly_those_of_photographs_that_lay_still(which: str, behind_by: float) -> None:
    result = separated(which)
    assert result.layers.shape == taken(which).layers.shape
    assert result.diagnostics.warnings == ()
    # What the others do not show at the edges is not counted.
    inner = (slice(None), slice(32, -32), slice(32, -32))
    for layer in (0, 1):
        truth = taken(which).layers[layer][inner]
        here, still = (psnr_db(separated(name).layers[layer][inner], truth, 0) for name in (which, "still"))
        assert here > still - behind_by


def test_pixels_that_a_photograph_does_not_show_are_neither_valid_nor_clipped() -> None:
    result = separated("far")
    assert result.matching is not None
    valid = result.matching.capture.valid
    assert valid[0].all()
    # The second one holds 26 pixels farther down what the first one shows.
    assert not valid[1, :, -26:].any()
    assert valid[1, :, 5:-28, 5:-5].all()
    assert result.diagnostics.clipped == 0
    assert SeparationWarning.SATURATED not in result.diagnostics.warnings


def test_what_moves_is_found_among_photographs_that_were_turned_back() -> None:
    capture = taken("hand").capture
    seen = capture.intensities.copy()
    for k, photograph in enumerate(seen):
        photograph[:, 50:90, 50 + 10 * k : 80 + 10 * k] = 0.35
    moved = capture.replace(intensities=seen)
    _, still, matching = agreeing_photographs(moved, still_photographs(moved))
    assert matching is not None
    assert matching.motions is not None
    assert still.moving is not None
    assert still.moving[56:84, 56:104].mean() > 0.9
    assert still.moving.mean() < 0.3


def test_the_command_says_so_and_can_be_told_not_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = written_photographs(taken("hand").capture, tmp_path)
    out = tmp_path / "out"
    assert main(["separate", *files, *PANE, "-o", str(out), *QUICK]) == 0
    assert "turned back onto the first by up to 0.8 degrees and scaled by up to 0.4 %" in capsys.readouterr().out
    told = json.loads((out / "report.json").read_text())["matching"]
    np.testing.assert_allclose(told["rotations_deg"], HAND.rotations_deg, atol=0.05)
    np.testing.assert_allclose(told["scales"], HAND.scales, atol=1e-3)
    np.testing.assert_allclose(told["shifts_px"], HAND.offsets, atol=0.1)
    assert main(["estimate", *files, *PANE, "--no-match"]) == 0
    assert "turned back" not in capsys.readouterr().out
