"""The studies' scenes and tables."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from skimage.io import imsave

from polaropt.errors import InputError
from polaropt.optics.scene import SceneParameters
from studies import coverage, paper_protocol
from studies.coverage_figure import draw
from studies.paper_protocol import scene_errors
from studies.protocol import protocol_capture, protocol_pairs, protocol_scene, shipped_pairs, truth
from studies.real_captures import edge_correlation
from tests.documents import document_of


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    for number in range(24):
        imsave(folder / f"p{number:02d}.png", np.full((40, 50, 3), 10 * number, np.uint8), check_contrast=False)
    return folder


def test_pairs_are_every_second_photograph_with_the_eleventh_after_it(photos):
    pairs = protocol_pairs(photos, size=16, margin=8)
    assert len(pairs) == 12
    for i, pair in enumerate(pairs):
        behind, mirrored = truth(pair)
        assert behind.shape == (16, 16, 3)
        assert behind[0, 0, 0] * 255 == pytest.approx(10 * 2 * i)
        assert mirrored[0, 0, 0] * 255 == pytest.approx(10 * ((2 * i + 11) % 24))


def test_photographs_are_mirrored_where_they_end(tmp_path):
    ramp = np.repeat(np.arange(20, dtype=np.uint8)[:, None], 20, axis=1)
    for name in "ab":
        imsave(tmp_path / f"{name}.png", np.stack([ramp] * 3, axis=-1), check_contrast=False)
    larger = protocol_pairs(tmp_path, size=20, margin=4)[0].transmission[:, 0, 0] * 255
    np.testing.assert_allclose(larger, [3, 2, 1, 0, *range(20), 19, 18, 17, 16], atol=1e-4)


def test_a_folder_without_photographs_is_refused(tmp_path):
    with pytest.raises(InputError, match="at least 2"):
        protocol_pairs(tmp_path)


def test_captures_are_the_same_each_time():
    pair = shipped_pairs(size=32, margin=32)[0]
    first, second = (protocol_capture(pair, 60) for _ in range(2))
    np.testing.assert_array_equal(first.intensities, second.intensities)
    assert protocol_scene(pair, 60).ghost_shift == pytest.approx(8.165, abs=0.01)


@pytest.mark.parametrize(
    ("found", "errors"),
    [((61, 30, 5.5), (1, 0, 0.5)), ((60, 210, -5), (0, 0, 0)), ((60, 209, -5), (0, 1, 0)), ((60, 120, 5), (0, 90, 0))],
)
def test_a_turned_azimuth_with_a_turned_shift_is_the_same_scene(found, errors):
    result = SimpleNamespace(scene=SceneParameters(*map(float, found)))
    assert scene_errors(result, (60.0, 30.0, 5.0)) == pytest.approx(errors)


def test_edges_correlate_with_themselves():
    random = np.random.default_rng(0)
    image, other = random.standard_normal((2, 40, 40))
    assert edge_correlation(image, image) == pytest.approx(1)
    assert abs(edge_correlation(image, other)) < 0.2


def test_the_table_is_one_command(tmp_path, capsys):
    paper_protocol.main(["--pairs", "1", "--incidences", "65", "--kind", "paper", "-o", str(tmp_path)])
    assert "| paper | 65 |" in capsys.readouterr().out
    document = document_of(tmp_path / "paper_protocol.json")
    (row,) = document["results"]
    assert {"settings", "machine", "libraries", "commit", "sources", "seeds"} <= document["metadata"].keys()
    assert (tmp_path / "paper_protocol.png").stat().st_size > 10_000
    assert (tmp_path / "paper_protocol.csv").read_text().splitlines()[0] == ",".join(row)
    assert row["blind_transmission"] > row["nothing"] + 10


def test_coverage_is_drawn_for_whatever_incidences_there_are(tmp_path):
    rows = [
        coverage.Row(0, incidence, 0.005, "blind", layer, 0.95, 0.9, 0.9, 1.0, 0.5, 0.8)
        for incidence in (10.0, 60.0)
        for layer in coverage.LAYERS
    ]
    assert all(file.stat().st_size > 10_000 for file in draw(rows, tmp_path))
