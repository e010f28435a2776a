"""What is offered by name: help, results that show themselves, plain words for wrong types, earlier scenes."""

from __future__ import annotations

import copy
import json
import pydoc
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from skimage import data

import polaropt
from polaropt import InputError, ResultWarning, SceneParameters, StoppingRule, Weights, simulate
from polaropt.cli.app import main
from polaropt.estimation.ladder import LadderResult
from polaropt.optics import SceneErrors
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


def test_the_table_tells_all_seconds_as_such(result: polaropt.Separation) -> None:
    rows = dict(line.strip().split(maxsplit=1) for line in repr(result).splitlines()[1:])
    assert rows["solve"] == f"{result.solver.n_evaluations} evaluations"
    assert rows["time"] == f"{sum(result.seconds.values()):.1f} s altogether"


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
    functions = (
        polaropt.separate,
        polaropt.inspect,
        polaropt.estimate,
        polaropt.align,
        polaropt.find_start_angle,
    )
    for function in functions:
        with pytest.raises(InputError, match=advice) as error:
            function(wrong)  # type: ignore[operator]
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("several", [polaropt.separate_many, polaropt.separate_sequence])
def test_one_capture_is_not_several(several: Any, capture: polaropt.Capture) -> None:
    with pytest.raises(InputError, match="captures is a Capture; give several in a list, or call separate"):
        several(capture)
    with pytest.raises(InputError, match="captures is a NoneType; give a list of captures"):
        several(None)


def test_texts_for_what_is_saved_are_refused(result: polaropt.Separation, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="uncertainty is 'no'; give True or False"):
        result.save(tmp_path / "out", uncertainty="no")  # type: ignore[arg-type]


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


def test_the_scene_of_a_result_can_be_separated_with(capture: polaropt.Capture, result: polaropt.Separation) -> None:
    again = polaropt.separate(capture, result)
    assert (again.scene, again.errors) == (result.scene, result.errors)


def test_a_result_that_is_warned_of_warns(capture: polaropt.Capture) -> None:
    grey = polaropt.Capture(np.repeat(np.moveaxis(capture.intensities[:1], 1, -1), 4, axis=0))
    with pytest.warns(ResultWarning):
        polaropt.separate(grey)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        polaropt.separate(capture, PANE)


@pytest.mark.parametrize("several", [polaropt.separate_many, polaropt.separate_sequence])
def test_results_of_many_that_are_warned_of_warn(several: Callable[..., Iterator[polaropt.Separation]]) -> None:
    grey = polaropt.Capture(np.repeat(np.random.default_rng(0).uniform(0.2, 0.8, (1, 32, 32)), 4, axis=0))
    for result in [polaropt.separate(grey)]:
        assert result.diagnostics.warnings
    with pytest.warns(ResultWarning) as told:
        results = list(several([grey, grey]))
    assert len([warning for warning in told if Path(warning.filename) == Path(__file__)]) == len(results) == 2


@pytest.mark.parametrize("of_report", [True, False])
def test_a_scene_is_given_to_many_as_to_one(
    capture: polaropt.Capture, result: polaropt.Separation, found: LadderResult, tmp_path: Path, *, of_report: bool
) -> None:
    scene = result.save(tmp_path / "first", layers_only=True) / "report.json" if of_report else found
    alone = polaropt.separate(capture, scene)
    for several in (polaropt.separate_many, polaropt.separate_sequence):
        (one,) = several([capture], scene)
        np.testing.assert_allclose(one.layers, alone.layers, atol=1e-3)
        assert one.errors == alone.errors


def test_a_report_is_for_captures_of_one_size(result: polaropt.Separation, tmp_path: Path) -> None:
    report = result.save(tmp_path / "first", layers_only=True) / "report.json"
    other = simulate(data.coffee()[150:214, 200:264], data.astronaut()[30:94, 160:224], PANE, noise=0.005)
    with pytest.raises(InputError, match="a capture has 64x64 px, the first 96x96"):
        list(polaropt.separate_many([polaropt.Capture.of_planes(result.capture.intensities), other], report))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"keep_start": "a"}, "keep_start is 'a'; give a number"),
        ({"keep_start": None}, "keep_start is None"),
        ({"refractive_index": "1.5"}, "refractive_index is '1.5'"),
        ({"progress": 3}, "progress is a int"),
        ({"weights": {"misfit": 1}}, "weights is a dict; give Weights"),
        ({"stopping": None}, "stopping is a NoneType; give StoppingRule"),
        ({"thickness_kind": "thin"}, "unknown thickness_kind 'thin'; there are: paper, plate"),
        ({"scene": PANE, "thickness_px": 10.0}, "give one of them"),
        ({"scene": ""}, "scene is empty"),
        ({"scene": "."}, "is a folder; give the report.json in it"),
        ({"start": np.full((2, 3, 96, 96), np.nan, np.float32)}, "the start holds NaN"),
        ({"start": np.zeros((2, 3, 96, 96)).tolist()}, "or is no array"),
        ({"robust": "no"}, "robust is 'no'; give True or False"),
        ({"index_known": "no"}, "index_known is 'no'"),
        ({"scene": PANE, "refractive_index": 1.7}, "refractive_index is 1.7, that of the scene 1.5; give it in"),
        ({"scene": PANE.replace(incidence_deg=None), "single_surface": True}, "single_surface is asked for, and the"),
        ({"scene": PANE, "model": "pixelwise"}, "the model 'pixelwise' is asked for, and the scene is given as a"),
    ],
)
def test_what_separate_cannot_use_gets_one_sentence(
    capture: polaropt.Capture, options: dict[str, object], said: str
) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        polaropt.separate(capture, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("several", [polaropt.separate_many, polaropt.separate_sequence])
def test_what_contradicts_the_scene_is_refused_of_many_too(
    capture: polaropt.Capture, several: Callable[..., Iterator[object]]
) -> None:
    with pytest.raises(InputError, match="the model 'none' is asked for, and the scene is given as a whole"):
        next(several([capture], PANE, model="none"))


def test_a_model_beside_an_earlier_scene_is_refused(
    result: polaropt.Separation, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = str(result.save(tmp_path, layers_only=True) / "report.json")
    assert main(["separate", "a.png", "--scene", report, "--model", "ghosts", "-o", "out"]) == 2
    assert capsys.readouterr().err == "polaropt: --scene gives the whole pane; leave it or --model out\n"


def test_what_agrees_with_the_scene_is_taken(capture: polaropt.Capture) -> None:
    glass = PANE.replace(refractive_index=1.6)
    assert polaropt.estimate(capture, glass, refractive_index=1.6, model="ghosts").scene == glass


@pytest.mark.parametrize("several", [polaropt.separate_many, polaropt.separate_sequence])
def test_an_unknown_option_is_named_at_once(several: Callable[..., object]) -> None:
    with pytest.raises(TypeError, match="unexpected option 'foo'; `separate` has: solver, init"):
        several([], foo=1)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: SceneParameters("60", 20.0, 4.0), "incidence_deg is '60'; give a number"),
        (lambda: PANE.replace(transmission_polarization=None), "give two finite numbers"),
        (lambda: SceneErrors(incidence_deg=-1.0), "the standard error of incidence_deg is -1.0"),
        (lambda: Weights(misfit="a"), "weight misfit is 'a'"),
        (lambda: StoppingRule(max_evaluations=1.5), "give a whole number from 1 on"),
        (lambda: polaropt.Capture(np.ones((64, 64, 4))), "give angles first"),
        (lambda: simulate(np.ones((32, 32)), np.ones((32, 32)), PANE, bits=1.5), "bits is 1.5"),
        (lambda: simulate(np.ones((32, 32)), np.ones((32, 32)), PANE, seed=-1), "seed is -1"),
        (lambda: simulate(np.ones((32, 32)), np.ones((32, 32)), "report.json"), "scene is a str"),
        (lambda: PANE.replace(single_surface="no"), "single_surface is 'no'; give True or False"),
        (lambda: StoppingRule(max_evaluations="3"), "max_evaluations is '3'; give a number"),
        (lambda: polaropt.ghost_step("60", 1.5, 1.0), "incidence_deg is '60'; give a number"),
        (lambda: polaropt.ghost_step(np.array([60.0, 70.0]), 1.5, 1.0), "incidence_deg is array"),
        (lambda: polaropt.Capture(np.ones((4, 32, 32)), (0, 0.785, 1.571, 2.356)), "give degrees, not radians"),
        (lambda: list(polaropt.separate_many(None)), "captures is a NoneType; give a list of captures"),
        (lambda: list(polaropt.separate_sequence([], first=2.5)), "first is 2.5; give a whole number"),
        (lambda: list(polaropt.separate_sequence([], start=np.zeros(2))), "leave out start"),
    ],
)
def test_numbers_of_another_type_get_one_sentence(make: Callable[[], object], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        make()


def test_whole_numbers_may_come_as_others() -> None:
    pane = PANE.replace(n_panes=2.0, gap_shift=9.0)
    assert isinstance(pane.n_panes, int)


def test_a_scene_of_json_is_the_one_that_it_was_written_of() -> None:
    pane = PANE.replace(transmission_polarization=(0.3, 20.0), focal_px=300.0, bend_deg_per_px=(0.01, 0.0, 0.0))
    again = SceneParameters(**json.loads(json.dumps(asdict(pane))))
    assert again == pane
    assert hash(again) == hash(pane)


def test_results_can_be_compared_and_kept_in_sets(result: polaropt.Separation) -> None:
    other = copy.deepcopy(result)
    assert result == result
    assert result != other
    assert len({result, other}) == 2
    np.testing.assert_array_equal(other.layers, result.layers)


@pytest.mark.parametrize("angles", [(0, 45, 90, 135), np.array([0, 45, 90, 135]), range(0, 180, 45)])
def test_angles_come_in_any_sequence(capture: polaropt.Capture, angles: object) -> None:
    photographs = np.moveaxis(capture.intensities, 1, -1)
    for given in (angles, iter(angles)):  # type: ignore[call-overload]
        assert polaropt.Capture(photographs, given).angles_deg == (0.0, 45.0, 90.0, 135.0)


def test_tensors_are_photographs_and_what_is_no_array_is_named(capture: polaropt.Capture) -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    tensor = torch.from_numpy(np.moveaxis(capture.intensities, 1, -1).copy()).requires_grad_()
    np.testing.assert_array_equal(polaropt.Capture(tensor).intensities, capture.intensities)
    with pytest.raises(InputError, match="the photographs cannot be read as an array of numpy"):
        polaropt.Capture(tensor.to(torch.bfloat16))


def test_no_captures_share_no_scene_and_give_no_results() -> None:
    assert list(polaropt.separate_many([], "shared")) == []


@pytest.mark.parametrize("scene", [PANE.replace(signal=False), None])
def test_where_nothing_is_polarized_the_intensity_is_the_transmission(
    capture: polaropt.Capture, scene: SceneParameters | None
) -> None:
    given = polaropt.estimate(capture, model="none") if scene is None else scene
    found = polaropt.separate(capture, given)
    np.testing.assert_array_equal(found.layers[0], capture.stokes[0])
    assert not found.layers[1].any()


def test_what_a_masked_array_masks_is_not_trusted(capture: polaropt.Capture) -> None:
    photographs = np.ma.masked_array(np.moveaxis(capture.intensities, 1, -1), mask=False)
    photographs[0, 40:60, 40:60] = np.ma.masked
    photographs.data[0, 40:60, 40:60] = np.nan
    masked = polaropt.Capture(photographs)
    assert not masked.valid[0, :, 40:60, 40:60].any()
    np.testing.assert_array_equal(masked.valid[1:], capture.valid[1:])
    told = polaropt.Capture(photographs.data, valid=~photographs.mask)
    np.testing.assert_array_equal(told.intensities, masked.intensities)
    with pytest.raises(InputError, match="NaN"):
        polaropt.Capture(photographs.data, valid=np.ones(photographs.shape, dtype=bool))
