"""Photographs turned and scaled against each other are found out and put back; those that lie still are left alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt import Capture, SeparationWarning, align, separate
from polaropt.capture.checks import visible_shift
from polaropt.capture.registration import Motions, corners, finely_moved_back, measure_shifts, measure_turns
from polaropt.cli.app import main
from polaropt.judging.warnings import diagnose
from polaropt.reporting.words import alignment_sentence
from polaropt.simulation.metrics import psnr_db
from tests.blends import blend
from tests.command_line import QUICK
from tests.turned import Turned, similarities, turned_blend

PANE = ["--incidence", "60", "--azimuth", "25", "--shift", "5.3"]
STILL = similarities(np.zeros(4), np.ones(4), np.zeros((4, 2)))
HAND = similarities(
    np.array([0, 1.3, -0.8, 0.4]),
    np.array([1, 1.012, 0.99, 1.004]),
    np.array([[0, 0], [3.4, -7.2], [-6.6, 5.5], [4.3, 6.7]]),
)


def corner_error(example: Turned, found: Motions) -> float:
    """Largest distance at the frame's corners between where photographs lie and where they were found."""
    at = corners(example.capture.shape)
    return float(np.linalg.norm(found.displacements(at) - example.motions.displacements(at), axis=-1).max())


def measured(capture: Capture) -> Motions:
    return measure_turns(capture, measure_shifts(capture)).motions


motions = st.builds(
    lambda rotations, scales, shifts: similarities(
        np.array([0, *rotations]), np.array([1, *scales]), np.array([(0, 0), *shifts])
    ),
    st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    st.lists(st.floats(0.98, 1.02), min_size=3, max_size=3),
    st.lists(st.tuples(st.floats(-14, 14), st.floats(-14, 14)), min_size=3, max_size=3),
)


@given(motions, st.sampled_from([20, 40, 60]))
@settings(max_examples=4, deadline=None)
def test_small_similarities_come_back(moved: Motions, incidence: float) -> None:
    example = turned_blend(incidence, 144, moved, color=False)
    assert corner_error(example, measured(example.capture)) < 0.1


def test_near_grazing_ghosts_of_a_small_frame_cost_accuracy() -> None:
    example = turned_blend(80, 184, HAND, color=False)
    assert corner_error(example, measured(example.capture)) < 0.25


@pytest.mark.parametrize("angles", [(0, 60, 120), (5, 40, 77, 110, 150)])
def test_any_angles(angles: tuple[float, ...]) -> None:
    rotations, scales = np.linspace(0, 1.5, len(angles)), np.linspace(1, 0.985, len(angles))
    moved = similarities(rotations, scales, np.outer(np.arange(len(angles)), (2.5, -1.5)))
    example = turned_blend(60, 160, moved, color=False, angles_deg=angles)
    assert corner_error(example, measured(example.capture)) < 0.15


@pytest.mark.parametrize(("incidence", "noise"), [(20, 0.01), (60, 0.002), (80, 0.01)])
def test_photographs_that_lie_still_are_neither_turned_nor_moved(incidence: float, noise: float) -> None:
    capture = blend(incidence, 128, noise=noise).capture
    assert align(capture) is capture


def test_photographs_that_are_shifted_only_are_not_turned() -> None:
    moved = similarities(np.zeros(4), np.ones(4), HAND.offsets)
    aligned = align(turned_blend(60, 144, moved).capture)
    assert aligned.origin is not None
    assert aligned.origin.rotations_deg == ()
    np.testing.assert_allclose(aligned.origin.shifts_px, HAND.offsets, atol=0.05)


def test_turns_that_leave_the_middle_in_place_are_seen() -> None:
    turned = similarities(np.array([0, 1.0, -1.0, 0.5]), np.ones(4), np.zeros((4, 2)))
    capture = turned_blend(60, 160, turned).capture
    assert visible_shift(capture) > 0.5
    said = diagnose(capture, 0.005, misfit_ratio=1.0, reflection_unknown=0.3, estimate=None).warnings
    assert SeparationWarning.MISALIGNED in said
    assert SeparationWarning.GAMMA_ENCODED not in said
    assert visible_shift(align(capture)) == 0


def test_what_was_done_is_told_and_needs_not_be_done_again() -> None:
    example = turned_blend(60, 160, HAND)
    aligned = align(example.capture)
    assert aligned.origin is not None
    np.testing.assert_allclose(aligned.origin.rotations_deg, HAND.rotations_deg, atol=0.05)
    np.testing.assert_allclose(aligned.origin.scales, HAND.scales, atol=1e-3)
    assert "turned back by +1.3" in alignment_sentence(aligned)
    assert aligned.valid.all()
    assert align(aligned) is aligned


def test_a_separation_loses_little_by_having_been_turned_back() -> None:
    turned, still = (turned_blend(60, 176, moved, color=False) for moved in (HAND, STILL))
    aligned = align(turned.capture)
    height, width = aligned.shape[-2:]
    # The first photograph stays where it is: it tells which part of the frame was kept.
    top, left = next(
        (y, x)
        for y in range(176 - height + 1)
        for x in range(176 - width + 1)
        if np.array_equal(turned.capture.intensities[0, y : y + height, x : x + width], aligned.intensities[0])
    )
    frame = slice(top, top + height), slice(left, left + width)
    truth = still.layers[..., frame[0], frame[1]]
    reached = [separate(capture, still.scene).layers for capture in (still.capture.part(*frame), aligned)]
    for layer in (0, 1):
        unmoved, moved = (psnr_db(layers[layer], truth[layer], 8) for layers in reached)
        assert moved > unmoved - 1


@given(st.floats(-3, 3), st.floats(0.97, 1.03), st.tuples(st.floats(-5, 5), st.floats(-5, 5)))
@settings(max_examples=20, deadline=None)
def test_moving_back_undoes_a_motion_and_keeps_fine_detail(
    rotation: float, scale: float, shift: tuple[float, float]
) -> None:
    y, x = np.mgrid[:96, :96] - 47.5
    moved = similarities(np.array([rotation]), np.array([scale]), np.array([shift]))
    (matrix,), (offset,) = moved.matrices, moved.offsets

    def waves(y: np.ndarray, x: np.ndarray) -> np.ndarray:
        return (0.5 + 0.2 * np.sin(1.9 * x + 0.3 * y) + 0.2 * np.cos(0.4 * x - 1.7 * y)).astype(np.float32)

    # The photograph shows at `matrix u + offset` what the first one shows at u.
    first = np.einsum("ij,jyx->iyx", np.linalg.inv(matrix), np.stack([y - offset[0], x - offset[1]]))
    back = finely_moved_back(waves(*first), matrix, offset)
    inner = (slice(20, -20), slice(20, -20))
    np.testing.assert_allclose(back[inner], waves(y, x)[inner], atol=0.01)


def test_the_command_line_turns_back_and_tells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = turned_blend(60, 128, HAND)
    np.savez(tmp_path / "turned.npz", intensities=np.moveaxis(example.capture.intensities, 1, -1))
    out = tmp_path / "out"
    said = ["separate", str(tmp_path / "turned.npz"), "--align", *PANE, "-o", str(out), *QUICK]
    assert main(said) == 0
    assert "turned back by" in capsys.readouterr().out
    report = json.loads((out / "report.json").read_text())
    np.testing.assert_allclose(report["input"]["rotations_deg"], HAND.rotations_deg, atol=0.1)
    assert "MISALIGNED" not in [warning["name"] for warning in report["diagnostics"]["warnings"]]
