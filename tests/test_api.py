"""What is offered by name: help, results that show themselves, plain words for wrong types, earlier scenes."""

from __future__ import annotations

import pydoc
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from skimage import data

import polaropt
from polaropt import InputError, ResultWarning, SceneParameters, simulate
from polaropt.estimation.ladder import LadderResult
from tests.command_line import RESULTS

PANE = SceneParameters(65.0, 30.0, 4.0)


@pytest.fixture(scope="module")
def capture() -> polaropt.Capture:
    return simulate(data.coffee()[150:246, 200:296], data.astronaut()[30:126, 160:256], PANE, noise=0.005)


@pytest.fixture(scope="module")
def result(capture: polaropt.Capture) -> polaropt.Separation:
    return polaropt.separate(capture, PANE)


@pytest.fixture(scope="module")
def found(capture: polaropt.Capture) -> LadderResult:
    return polaropt.estimate(capture, PANE.replace(incidence_deg=None))


def test_the_public_names_are_shown() -> None:
    assert {"separate", "inspect", "estimate", "read_capture", "Capture", "Separation"} <= set(dir(polaropt))
    assert {"__version__", "__doc__"} <= set(dir(polaropt))
    text = pydoc.render_doc(polaropt, renderer=pydoc.plaintext)
    for name in ("separate(capture", "inspect(capture", "estimate(capture", "class Separation"):
        assert name in text


def test_a_result_is_a_short_table(result: polaropt.Separation) -> None:
    lines = repr(result).splitlines()
    assert lines[0] == "Separation of 96x96 px, 3 channels"
    assert 5 <= len(lines) <= 15
    assert any("incidence" in line and "65.00 deg" in line for line in lines)
    assert lines[-1].split() == ["warnings", "none"]


def test_a_notebook_sees_layers_and_scene(result: polaropt.Separation) -> None:
    page = result._repr_html_()
    assert page.count("<img") == 2
    assert "transmission" in page
    assert "incidence" in page


def test_a_result_can_be_plotted(result: polaropt.Separation) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    figure = result.plot()
    assert [axis.get_title() for axis in figure.axes] == ["photograph", "transmission", "reflection"]


def test_a_result_can_be_saved_and_its_scene_taken_again(
    result: polaropt.Separation, capture: polaropt.Capture, tmp_path: Path
) -> None:
    folder = result.save(tmp_path / "out", uncertainty=False)
    assert {path.name for path in folder.iterdir()} == {name for name in RESULTS if "error" not in name} - {
        "reflection_known.tiff",
        "uncertainty.png",
    }
    again = polaropt.separate(capture, scene=folder / "report.json")
    assert again.scene == result.scene
    np.testing.assert_allclose(again.layers, result.layers, atol=1e-5)
    half = polaropt.Capture(np.moveaxis(capture.intensities[..., ::2, ::2], 1, -1), capture.angles_deg)
    assert polaropt.estimate(half, folder / "report.json").scene.ghost_shift == 2.0
    wide = polaropt.Capture(np.moveaxis(capture.intensities[..., :40, :], 1, -1), capture.angles_deg)
    with pytest.raises(InputError, match="same view"):
        polaropt.estimate(wide, folder / "report.json")


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"input": {"height": 1, "width": 1}, "scene": []}'])
def test_a_file_that_is_no_report_is_refused(capture: polaropt.Capture, tmp_path: Path, text: str) -> None:
    path = tmp_path / "report.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"report\.json: is no report"):
        polaropt.estimate(capture, path)
    with pytest.raises(InputError, match="no such file"):
        polaropt.estimate(capture, tmp_path / "absent.json")


@pytest.mark.parametrize(
    ("wrong", "advice"),
    [
        (np.zeros((4, 32, 32)), "Capture"),
        ("raw.png", "read_capture"),
        (["a.png", "b.png"], "read_capture"),
        (3, "Capture"),
    ],
)
def test_wrong_types_get_one_sentence(wrong: object, advice: str) -> None:
    for function in (polaropt.separate, polaropt.inspect, polaropt.estimate):
        with pytest.raises(InputError, match=advice) as error:
            function(wrong)  # type: ignore[operator]
        assert "\n" not in str(error.value)


def test_a_scene_of_another_type_is_refused(capture: polaropt.Capture) -> None:
    with pytest.raises(InputError, match="scene is a dict; give SceneParameters"):
        polaropt.separate(capture, {"incidence_deg": 60})  # type: ignore[arg-type]


def test_inspecting_and_estimating_are_public(capture: polaropt.Capture, found: LadderResult) -> None:
    assert polaropt.inspect(capture).width == 96
    assert abs((found.scene.incidence_deg or 0) - 65) < 5


def test_what_is_found_shows_itself_as_the_commands_do(capture: polaropt.Capture, found: LadderResult) -> None:
    facts = repr(polaropt.inspect(capture)).splitlines()
    assert facts[0].startswith("4 photographs of 96x")
    assert any(line.startswith("The noise of one photograph is") for line in facts)
    lines = repr(found).splitlines()
    assert re.fullmatch(r"incidence +6\d\.\d+ \+- [\d.]+ deg \(estimated\)", lines[0])
    assert any(line.startswith("ghost shift") and line.endswith("(given)") for line in lines)
    assert max(map(len, lines)) < 120
    # It is still what it was, with all that it holds.
    assert isinstance(found, LadderResult)
    assert found.scaled(2.0).scene.ghost_shift == 2 * found.scene.ghost_shift


def test_an_estimate_can_be_separated_with(capture: polaropt.Capture, found: LadderResult) -> None:
    result = polaropt.separate(capture, found)
    assert result.scene == found.scene
    assert result.errors == found.errors


def test_a_result_that_is_warned_of_warns(capture: polaropt.Capture) -> None:
    grey = polaropt.Capture(np.repeat(np.moveaxis(capture.intensities[:1], 1, -1), 4, axis=0))
    with pytest.warns(ResultWarning):
        polaropt.separate(grey)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        polaropt.separate(capture, PANE)
