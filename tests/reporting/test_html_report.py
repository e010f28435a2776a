"""The page of a separation: complete, self-contained, and it works in a browser."""

from __future__ import annotations

import copy
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.io import imread

from polaropt.capture.capture import Capture
from polaropt.optics.scene import SceneErrors, SceneParameters
from polaropt.reporting.files import write_separation
from polaropt.reporting.page import _pane, convergence_chart, page_pictures, parameters, write_html_report
from polaropt.reporting.pictures import UncertaintySummary
from polaropt.reporting.report import json_values, scene_report
from polaropt.reporting.words import _uncertainty_sentence
from polaropt.separation import separate
from solvers.base import StoppingRule
from studies.kit.page import write_index
from tests.blends import blend
from tests.browser import dom_of, screenshot_of

UNKNOWN = SceneParameters(None, None, None)
HOSTILE = "<script>alert(1).png"


class Elements(HTMLParser):
    """All tags with their attributes, and the text between them."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)

    def of(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


# One clear pane of which nothing else is told.
BLIND = SceneParameters(None, None, None)


def blend_result():
    capture = blend(65.0, 96, noise=0.004).capture
    return separate(capture, BLIND, stopping=StoppingRule(max_evaluations=1)), capture


def written(folder, capture):
    result = separate(capture, BLIND)
    report = write_separation(folder, result, capture)
    return folder / "report.html", report


@pytest.fixture(scope="module")
def separated(tmp_path_factory):
    capture = blend(65.0, 96, noise=0.004).capture
    capture = capture.with_origin(files=(f"photos/{HOSTILE}", "b.png"), layout="files", sample_type="uint16")
    return written(tmp_path_factory.mktemp("separated"), capture)


@pytest.fixture(scope="module")
def unpolarized(tmp_path_factory):
    image = blend(65.0, 96).capture.stokes[0] / 2
    noise = 0.004 * np.random.default_rng(0).standard_normal((4, *image.shape))
    return written(tmp_path_factory.mktemp("unpolarized"), Capture.of_planes(image[None] + noise))


def test_the_page_needs_nothing_beside_it(separated):
    page = Elements(separated[0].read_text())
    links = [value for _, attributes in page.tags for name, value in attributes.items() if name == "src"]
    assert len(links) == 8
    assert all(link.startswith("data:image/jpeg;base64,") for link in links)
    assert "@import" not in separated[0].read_text()


def test_the_files_beside_the_page_are_linked(separated):
    path, report = separated
    linked = [attributes["href"] for attributes in Elements(path.read_text()).of("a")]
    assert linked == [name for name in report["written"] if name != "report.html"]
    assert all((path.parent / name).is_file() for name in linked)


def test_every_value_of_a_table_has_a_name_for_phones(separated):
    cells = Elements(separated[0].read_text()).of("td")
    assert len(cells) > 10
    assert all(cell.get("data-name") for cell in cells)


def test_layers_can_be_looked_at_pixel_by_pixel(separated):
    page = Elements(separated[0].read_text())
    assert any(attributes.get("id") == "whole-pixels" for attributes in page.of("input"))
    full = {image["id"]: image["data-full"] for image in page.of("img") if image.get("data-full")}
    assert full == {"transmission": "transmission.png", "reflection": "reflection.png"}


def test_captions_say_what_is_shown(separated):
    text = re.sub(r"\s+", " ", " ".join(Elements(separated[0].read_text()).text))
    assert "How far each pixel of the transmission may be from the truth" in text
    assert "How strongly the photographs' light is polarized" in text


def test_every_picture_says_what_it_shows(separated):
    page = Elements(separated[0].read_text())
    shown = [image for image in page.of("img") if "src" in image]
    assert {image["id"] for image in shown} >= {"photograph", "transmission", "reflection", "dolp", "aolp"}
    assert all(len(image["alt"]) > 10 for image in shown)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ({"rung": "ghosts", "n_panes": 1}, "a flat pane seen from afar, with double images"),
        ({"rung": "ghosts", "n_panes": 2}, "two flat panes seen from afar, with double images"),
        ({"rung": "pixelwise", "n_panes": 4}, "4 flat panes seen from afar, all bounces in place"),
        ({"rung": "curved", "n_panes": 1}, "a bent pane before a wide lens"),
    ],
)
def test_the_page_says_how_many_panes_were_found(scene, words):
    assert _pane(scene) == words


def test_the_page_tells_the_pane_and_the_solve(separated):
    page, report = separated
    text = re.sub(r"\s+", " ", " ".join(Elements(page.read_text()).text))
    assert f"{report['scene']['incidence_deg']:.2f} deg" in text
    assert f"{report['solver']['n_evaluations']} evaluations" in text
    assert report["rungs"][0]["reason"] in text
    warnings = report["diagnostics"]["warnings"]
    assert all(warning["sentence"] in text for warning in warnings)
    # Each says what it means.
    assert page.read_text().count('<details class="meaning">') == len(warnings)


def test_file_names_are_text(separated):
    page = separated[0].read_text()
    assert HOSTILE not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "photos/" not in page


def test_a_capture_that_tells_nothing_has_a_page_that_warns(unpolarized):
    page, report = unpolarized
    elements = Elements(page.read_text())
    assert report["diagnostics"]["warnings"]
    assert any(attributes.get("role") == "alert" for attributes in elements.of("section"))
    assert 'id="parameters"' not in page.read_text()
    assert 'id="convergence"' not in page.read_text()


def test_the_misfit_is_shown_where_there_is_a_map(separated):
    page, report = separated
    assert ("MODEL_DOES_NOT_EXPLAIN" in {warning["name"] for warning in report["diagnostics"]["warnings"]}) == (
        'id="misfit"' in page.read_text()
    )
    result, capture = blend_result()
    summary = UncertaintySummary(result.layers.shape)
    for strip in result.uncertainty_strips():
        summary.add(strip)
    pictures = page_pictures(result, capture, {}, summary.panels(), np.full((96, 96), 3.0, np.float32))
    assert pictures[-1].name == "misfit"
    assert pictures[-1].key.ticks[0] == "0"


def test_standard_errors_stand_beside_what_was_estimated():
    found = SceneParameters(40.0, 20.0, 3.0, focal_px=900.0, reflection_polarization=(0.3, 60.0))
    errors = SceneErrors(incidence_deg=0.5, focal_px=12.0, reflection_polarization=(0.021, 3.0))
    report = {**scene_report(found, UNKNOWN.replace(azimuth_deg=20.0)), "errors": json_values(errors)}
    table = {parameter.name: parameter for parameter in parameters(report)}
    assert table["Angle of incidence"].error == "± 0.5 deg"
    assert table["Azimuth of the plane of incidence"].error == ""
    assert table["Azimuth of the plane of incidence"].how == "given"
    assert table["Focal length"].value == "900 px"
    assert table["Focal length"].error == "± 12 px"
    assert table["Polarization of the mirrored light"].value == "degree 0.30, angle 60 deg"
    assert table["Polarization of the mirrored light"].error == "± 0.021, ± 3 deg"
    assert table["Polarization of the mirrored light"].how == "estimated"


def test_the_page_states_the_standard_errors_of_the_report(separated):
    page, report = separated
    text = re.sub(r"\s+", " ", " ".join(Elements(page.read_text()).text))
    assert report["estimated"] == ["incidence_deg", "azimuth_deg", "ghost_shift"]
    for name, unit in (("incidence_deg", "deg"), ("azimuth_deg", "deg"), ("ghost_shift", "px")):
        assert f"± {report['errors'][name]:.2g} {unit}" in text


values = st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=40)


@given(values)
def test_smaller_values_lie_lower_and_all_within_the_chart(values):
    chart = convergence_chart(values)
    heights = [y for _, y in chart.points]
    order = np.argsort(values, kind="stable")
    assert (np.diff(np.array(heights)[order]) <= 1e-9).all()
    assert heights[int(order[0])] == max(heights)
    for x, y in chart.points:
        assert chart.left - 1e-6 <= x <= chart.right + 1e-6
        assert chart.top - 1e-6 <= y <= chart.bottom + 1e-6
    assert all(chart.top - 1e-6 <= tick.place <= chart.bottom + 1e-6 for tick in chart.up)
    assert all(chart.left - 1e-6 <= tick.place <= chart.right + 1e-6 for tick in chart.across)


def test_one_value_is_no_course():
    assert convergence_chart([]) is None
    assert convergence_chart([1.0]) is None
    assert convergence_chart([1e6, 10.0, 1.0]).logarithmic


@given(values)
def test_ticks_are_few_and_state_first_and_last_of_both_axes(values):
    chart = convergence_chart(values)
    assert chart.across[0].text == "1"
    assert chart.across[-1].text == str(len(values))
    assert 1 <= len(chart.up) <= 5
    heights = [y for _, y in chart.points]
    assert chart.up[0].place == pytest.approx(max(heights))
    assert chart.up[-1].place == pytest.approx(min(heights))


def test_the_slider_compares_what_is_chosen(separated, tmp_path):
    page = tmp_path / "report.html"
    moved = """<script>
    byId("right").value = "reflection"; byId("right").dispatchEvent(new Event("change"));
    byId("slider").value = 30; byId("slider").dispatchEvent(new Event("input"));
    byId("slider").focus(); document.body.dataset.focus = document.activeElement.id;
    </script></body>"""
    page.write_text(separated[0].read_text().replace("</body>", moved))
    elements = Elements(dom_of(page, tmp_path))
    (section,) = (part for part in elements.of("section") if part.get("id") == "compare-section")
    (compare,) = (part for part in elements.of("div") if part.get("id") == "compare")
    images = {image.get("class") or image["id"]: image for image in elements.of("img")}
    assert "hidden" not in section
    assert "--at: 30%" in compare["style"]
    assert images["over"]["src"] == images["photograph"]["src"]
    assert images["under"]["src"] == images["reflection"]["src"]
    assert images["under"]["alt"] == images["reflection"]["alt"]
    assert elements.of("body")[0]["data-focus"] == "slider"


@pytest.mark.parametrize("dark", [False, True])
def test_the_page_is_seen_light_and_dark(separated, tmp_path, dark):
    picture = imread(screenshot_of(separated[0], tmp_path, 700, 900, dark=dark))[..., :3]
    background = picture[-20:, :8].mean()
    assert (background < 60) if dark else (background > 220)
    # Half photograph, half transmission: the middle of the page is no plain card.
    assert picture[400:700, 150:550].std() > 15


def test_the_studies_index_is_seen(tmp_path):
    folder = tmp_path / "stability"
    folder.mkdir()
    (folder / "stability.md").write_text("| a | b |\n|---|---|\n| 1 | 2 |\n")
    elements = Elements(dom_of(write_index(tmp_path), tmp_path))
    assert len(elements.of("table")) == 1
    assert any(link.get("href") == "#stability" for link in elements.of("a"))


def test_numbers_beyond_any_are_said_to_be_unbounded(separated, tmp_path):
    """JSON has no infinity: they are null in the report."""
    report = copy.deepcopy(separated[1])
    report["uncertainty"]["typical_error"]["reflection"] = None
    report["diagnostics"]["misfit_ratio"] = report["solver"]["value"] = None
    result, capture = blend_result()
    write_html_report(tmp_path / "report.html", result, report, page_pictures(result, capture, {}, None))
    page = " ".join("".join(Elements((tmp_path / "report.html").read_text()).text).split())
    assert "reflection unbounded (white" in page
    assert "The residuals are unbounded times" in page
    assert _uncertainty_sentence(report["uncertainty"]).startswith("standard errors, typically ")
    assert " and unbounded;" in _uncertainty_sentence(report["uncertainty"])
