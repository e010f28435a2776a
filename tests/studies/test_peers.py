"""The peers do what their papers say, and the tables tell what was measured."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.io import imsave

from polaropt.optics.plate import in_place_reflectance
from studies.kit.charts import write_figures
from studies.kit.frames import frame_of
from studies.peers.multiscale import LABELS_DEG, _patch_entropy, _propagated, nonnegative_layers, separate_in_scales
from studies.peers.published import TABLES
from studies.peers.semireflector import correlation, invert, mutual_information, plane_images, separate_by
from studies.peers.single_image import STRENGTHS, built, suppressed
from studies.peers.study import (
    MEASURED,
    PROTOCOL,
    SPECIAL_CASES,
    Job,
    Row,
    figures,
    jobs_of,
    margins,
    run,
    tables,
)
from studies.scenes import protocol
from studies.scores import psnr
from studies.ways import FULL, METHODS, NETWORKS, PLAIN, Method, NotRun
from tests.blends import blend

IN_PLACE = blend(60.0, 96, ghost_shift=0.0, noise=0.0)
RANDOM = np.random.default_rng(0)


def test_a_known_pane_in_place_is_inverted_exactly():
    across = plane_images(IN_PLACE.capture, IN_PLACE.scene.azimuth_deg)
    np.testing.assert_allclose(invert(across, 60.0, 1.5), IN_PLACE.layers, atol=2e-5)


@pytest.mark.parametrize("criterion", [correlation, mutual_information])
def test_layers_are_least_alike_near_the_true_incidence(criterion):
    found = separate_by(criterion, IN_PLACE.capture, IN_PLACE.scene.azimuth_deg, 1.5)
    assert psnr(found[0], IN_PLACE.layers[0], np.ones((96, 96), bool)) > 30


def test_information_is_shared_by_equal_images_and_not_by_independent_ones():
    first, second = RANDOM.random((2, 400, 400)).astype(np.float32)
    assert mutual_information(first, first) == pytest.approx(1)
    assert mutual_information(np.round(4 * first) / 4, np.round(4 * second) / 4) < 0.001
    assert correlation(first, 1 - first) == pytest.approx(1)
    assert np.isnan(mutual_information(first, np.zeros_like(first)))


@settings(deadline=None)
@given(st.integers(5, 86), st.lists(st.floats(-0.2, 1), min_size=2, max_size=2))
def test_layers_of_at_least_zero_are_the_best_there_are(incidence, seen):
    """Karush, Kuhn, Tucker: the slope is 0 where a layer is positive, and not negative where it is 0."""
    reflectances = np.array(in_place_reflectance(incidence, 1.5, False)).reshape(2, 1, 1)
    mixing = np.array([[1 - r, r] for r in reflectances.ravel()]) / 2
    layers = nonnegative_layers(np.reshape(seen, (2, 1, 1, 1)), reflectances).ravel().astype(np.float64)
    slope = mixing.T @ (mixing @ layers - seen)
    assert (layers >= 0).all()
    assert (slope > -1e-5).all()
    np.testing.assert_allclose((slope * layers), 0, atol=1e-5)


def test_entropy_of_a_patch():
    stripes = np.tile(np.arange(30) % 2, (30, 1))
    np.testing.assert_allclose(_patch_entropy(np.zeros((20, 20), int)), 0, atol=1e-12)
    assert _patch_entropy(stripes)[15, 15] == pytest.approx(np.log(2), abs=0.01)


def test_labels_spread_from_where_they_are_certain_to_where_they_are_not():
    costs = np.zeros((5, 6, 6), np.float32)
    costs[:, 0, 0] = (9, 9, 9, 0, 9)
    np.testing.assert_array_equal(_propagated(costs), 3)
    costs[:, 5, 5] = (0, 9, 9, 9, 9)
    found = _propagated(costs)
    assert found[0, 0] == 3
    assert found[5, 5] == 0


def test_scales_find_a_pane_whose_azimuth_is_known_roughly():
    found = separate_in_scales(IN_PLACE.capture, IN_PLACE.scene.azimuth_deg + 30, 1.5)
    plain = IN_PLACE.capture.stokes[0]
    levels = [psnr(image, IN_PLACE.layers[0], np.ones((96, 96), bool)) for image in (found[0], plain)]
    assert (found >= 0).all()
    assert levels[0] > levels[1] + 3
    assert LABELS_DEG[0] < 60 < LABELS_DEG[-1]


def test_the_single_image_method_has_its_environment():
    if not built():
        pytest.skip("no .venv-peers; `make peers` builds it")
    found = suppressed(IN_PLACE.capture)
    assert found.shape == (len(STRENGTHS), 3, 96, 96)
    assert np.isfinite(found).all()


def test_jobs_are_the_papers_scenes():
    jobs = jobs_of(None, None, 4, quick=False, size=32)
    assert [job.column for job in jobs if (job.group, job.pair) == (PROTOCOL, 3)] == [
        "10",
        "40",
        "60",
        "70",
        "80",
        "85",
    ]
    special = [job for job in jobs if job.group == SPECIAL_CASES]
    assert len({job.column for job in special}) == 4
    assert {job.pair for job in special} == {0, 1, 2}
    assert special[0].sample().layers.shape == (2, 3, 32, 32)
    assert len(jobs_of(None, None, 1, quick=True, size=32)) == 4


def test_measured_layers_are_jobs_where_they_are_given(tmp_path):
    for name, level in (("a_T", 128), ("a_R", 64)):
        ramp = np.linspace(0, level, 40 * 30).reshape(40, 30).astype(np.uint8)
        imsave(tmp_path / f"{name}.png", np.stack([ramp] * 3, axis=-1), check_contrast=False)
    jobs = jobs_of(None, str(tmp_path), 1, quick=True, size=32)
    assert [job.column for job in jobs if job.group == MEASURED] == ["40", "70"]


def refuses(sample):
    raise NotRun("no weights")


def test_what_a_method_does_not_show_is_not_scored():
    plain = METHODS[PLAIN]
    job = Job(protocol(60), 0, size=64)
    shown, not_run = run(job, (plain, Method("refused", refuses, ours=True)))
    assert shown.transmission > 10
    assert 0 < shown.transmission_ssim < 1
    assert shown.transmission_fitted >= shown.transmission
    assert math.isnan(shown.reflection)
    assert math.isnan(not_run.transmission)
    assert not_run.not_run == "no weights"


def measured(method, scene, pair, transmission, reflection=math.nan):
    return Row(PROTOCOL, scene, pair, method, transmission, reflection, 0.9, 0.8, transmission, reflection, 0.1)


MEASUREMENTS = [
    measured(FULL, "10", 0, 40.0, 20.0), measured(FULL, "10", 1, 42.0, 20.0),
    measured(FULL, "40", 0, 45.0, 25.0),
    measured(PLAIN, "10", 0, 30.0), measured(PLAIN, "10", 1, 30.0), measured(PLAIN, "40", 0, 31.0),
    measured("FastICA", "10", 0, 33.0, 14.0), measured("FastICA", "10", 1, 33.0, 14.0),
    measured("FastICA", "40", 0, 20.0, 15.0),
    Row(PROTOCOL, "10", 0, NETWORKS, not_run="no weights"),
]  # fmt: skip
ROWS = frame_of(Row, MEASUREMENTS)


def test_the_lead_is_over_the_best_peer_of_each_column():
    assert margins(ROWS, "transmission") == [
        ("10", 8.0, "FastICA"),
        ("40", 14.0, PLAIN),
        ("mean", pytest.approx(127 / 3 - 91 / 3), PLAIN),
    ]
    assert [peer for *_, peer in margins(ROWS, "reflection")] == ["FastICA"] * 3


def test_the_page_tells_all_methods_and_the_papers_own_figures(tmp_path):
    page = tables(ROWS)
    assert "| FastICA* | 33.0 / 14.0 | 20.0 / 15.0 |" in page
    assert f"| **{FULL}** | 41.0 / 20.0 | 45.0 / 25.0 |" in page
    assert f"| {PLAIN} | 30.0 / - |" in page
    assert "| **PolarNet and FusionNet alone** | not run: no weights |" in page
    assert (
        "| the paper's method | 31.08 / 0.911 | 25.73 / 0.817 | 29.16 / 0.907 | 22.91 / 0.696 | 27.22 / 0.833 |" in page
    )
    assert [file.name for file in write_figures(tmp_path, figures(ROWS))] == ["peers.png", "peers.svg"]
    assert figures(ROWS.assign(group=MEASURED)) == {}


def test_published_tables_are_complete():
    for table in TABLES:
        assert all(len(figures) == len(table.scenes) for figures in table.methods.values())
