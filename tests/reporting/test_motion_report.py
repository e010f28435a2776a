"""What moves between the photographs is told, and shown in a picture."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from polaropt.reporting import inspect_capture, report_sentences, write_separation
from polaropt.reporting.words import MOTION_UNSEEN, inspection_sentences
from polaropt.separation import separate
from solvers.base import StoppingRule
from tests.blends import blend
from tests.captured import photographed
from tests.moving import walked_by

SCENE = blend(60.0, 128, noise=0.005)
MOVING = walked_by(SCENE)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("moving")
    result = separate(MOVING.capture, SCENE.scene, stopping=StoppingRule(max_evaluations=1))
    return folder, result, write_separation(folder, result, MOVING.capture)


def test_where_it_moves_is_red(written):
    folder, result, _ = written
    picture = np.asarray(Image.open(folder / "moving.png"), dtype=int)
    assert picture.shape == (128, 128, 3)
    red = picture[..., 0] - picture[..., 2] > 40
    np.testing.assert_array_equal(red, result.moving)


def test_the_report_and_the_page_tell_it(written):
    folder, result, report = written
    share = float(result.moving.mean())
    assert report["diagnostics"]["moving"] == report["inspection"]["moving_share"] == pytest.approx(share)
    assert "MOVING" in {warning["name"] for warning in report["diagnostics"]["warnings"]}
    # The warning says it: not twice.
    assert not any("moves" in sentence for sentence in report["attention"])
    assert any("moving.png" in line and f"{100 * share:.2g} %" in line for line in report_sentences(report, folder))
    assert 'id="moving"' in (folder / "report.html").read_text(encoding="utf-8")


def test_an_inspection_tells_how_much():
    it = inspect_capture(MOVING.capture)
    assert it.moving_share is not None
    (sentence,) = (line for line in inspection_sentences(it) if "moves between" in line)
    assert sentence.startswith("ATTENTION")
    assert f"{100 * it.moving_share:.2g} %" in sentence
    # What moves is neither an encoding nor a shift.
    assert not it.looks_encoded
    assert it.visible_shift_px == 0


def test_nothing_is_told_where_nothing_moves(tmp_path):
    assert inspect_capture(SCENE.capture).moving_share == 0
    result = separate(SCENE.capture, SCENE.scene, stopping=StoppingRule(max_evaluations=1))
    report = write_separation(tmp_path, result, SCENE.capture)
    assert not (tmp_path / "moving.png").exists()
    assert not any("mov" in line for line in report_sentences(report, tmp_path))


def test_of_three_angles_it_is_said_once_that_it_would_not_show(tmp_path):
    capture = photographed((64, 64), (0, 60, 120))
    assert inspection_sentences(inspect_capture(capture)).count(MOTION_UNSEEN) == 1
    assert inspect_capture(capture).moving_share is None
    result = separate(capture, SCENE.scene, stopping=StoppingRule(max_evaluations=1))
    report = write_separation(tmp_path, result, capture)
    assert report_sentences(report, tmp_path).count(MOTION_UNSEEN) == 1
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count(MOTION_UNSEEN) == 1
