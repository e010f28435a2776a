"""The study of mosaics runs as one command, tells every way apart, and judges nothing on what was trained on."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from polaropt.capture import ANGLES_DEG, WHITE_16, Capture, sampling_of, write_png
from polaropt.optics import SceneParameters
from polaropt.simulation import exact_photographs, stack_layers
from studies.mosaic import cameras, demosaicking, full_resolution, layers, study
from studies.mosaic.demosaicking import bilinear, trained
from studies.photographs import pairs_of, shipped_pairs, unseen_pairs
from tests.documents import document_of

SIZE_PX = 128


@pytest.fixture(autouse=True)
def small_frames(monkeypatch):
    monkeypatch.setattr(layers, "SIZE_PX", SIZE_PX)
    monkeypatch.setattr(demosaicking, "SIZE_PX", SIZE_PX)
    trained.cache_clear()
    yield
    trained.cache_clear()


def photographs_of(pair: int) -> np.ndarray:
    """Photographs (k, channel, h, w) of a shipped pair behind a pane."""
    behind = shipped_pairs(SIZE_PX, 0)[pair]
    seen = stack_layers(behind.transmission, behind.reflection)
    return exact_photographs(seen, SceneParameters(65.0, 20.0, 0.0), ANGLES_DEG)


def write_data(folder):
    """The folders that `--data` names: photographs of full resolution, and one mosaic."""
    full = folder / full_resolution.FOLDER
    full.mkdir(parents=True)
    mosaic = folder / cameras.MOSAICS[0].file
    mosaic.parent.mkdir(parents=True)
    photographs = photographs_of(0)
    for image, angle in zip(photographs, ANGLES_DEG, strict=True):
        values = np.round(np.moveaxis(image, 0, -1) * WHITE_16).astype(np.uint16)
        write_png(full / f"{full_resolution.SCENE}_{angle:03.0f}.png", values)
    sampling, _ = sampling_of(color=False)
    raw = sampling.sample(photographs.mean(axis=1, keepdims=True))
    # Files are told apart by their first bytes, not by their name.
    write_png(mosaic, np.round(raw * WHITE_16).astype(np.uint16))
    return folder


def test_the_truth_is_what_the_lens_images():
    pair = pairs_of(None, SIZE_PX, layers.MARGIN_PX)[0]
    sharp, soft, *others = (layers.take(pair, layers.Job(0, 60.0, "mono", lens)) for lens in layers.BLURS_PX)
    assert sharp.layers.shape == soft.layers.shape == (2, SIZE_PX, SIZE_PX)
    assert soft.layers.std() < sharp.layers.std()
    for defective_or_polarized in others:
        np.testing.assert_array_equal(defective_or_polarized.layers, soft.layers)


@pytest.mark.parametrize("color", [False, True], ids=["mono", "color"])
def test_things_that_are_polarized_add_no_light(color):
    pair = pairs_of(None, SIZE_PX, layers.MARGIN_PX)[0]
    sensor = "color" if color else "mono"
    plain, polarized = (
        layers.take(pair, layers.Job(0, 60.0, sensor, lens)) for lens in (layers.USUAL, layers.POLARIZED)
    )
    more = polarized.photographs.stokes - plain.photographs.stokes
    behind = polarized.layers[0].reshape(more[0].shape)
    np.testing.assert_allclose(more[0], 0, atol=1e-6)
    assert np.hypot(*more[1:]).max() <= layers.THINGS_DOLP * behind.max() * 1.01
    assert 0.3 < np.mean(np.hypot(*more[1:]) > 0.5 * layers.THINGS_DOLP * behind) < 0.7
    sampled = sampling_of(color)[0].sample(polarized.photographs.intensities.reshape(4, -1, SIZE_PX, SIZE_PX))
    unpolarized = sampling_of(color)[0].sample(plain.photographs.intensities.reshape(4, -1, SIZE_PX, SIZE_PX))
    np.testing.assert_allclose(polarized.raw - plain.raw, sampled - unpolarized, atol=1e-5)


def test_what_is_trained_on_shares_no_photograph_with_what_is_judged():
    pairs = shipped_pairs(64, 0)
    assert unseen_pairs() == tuple(range(len(pairs)))
    for judged in pairs:
        unseen = [pairs[number] for number in unseen_pairs(judged.number)]
        assert unseen
        for other in unseen:
            for image in (other.transmission, other.reflection):
                assert not np.array_equal(image, judged.transmission)
                assert not np.array_equal(image, judged.reflection)


@pytest.mark.parametrize("color", [False, True], ids=["mono", "color"])
def test_least_squares_beat_bilinear_interpolation_and_keep_what_is_even(color):
    truth = photographs_of(0)
    truth = truth if color else truth.mean(axis=1, keepdims=True)
    sampling, _ = sampling_of(color)
    kernels = trained(color, 0.0, judged_pair=0)
    inner = (..., slice(16, -16), slice(16, -16))
    raw = sampling.sample(truth)
    errors = [
        np.square(images.reshape(truth.shape) - truth)[inner].mean()
        for images in (kernels.interpolate(raw, 0.001), bilinear(raw, color))
    ]
    assert errors[0] < 0.7 * errors[1]
    even = np.broadcast_to(truth.mean(axis=(-1, -2), keepdims=True), truth.shape)
    found = kernels.interpolate(sampling.sample(even), 0.001).reshape(truth.shape)
    np.testing.assert_allclose(found, even, atol=1e-5)


def test_an_angle_is_judged_as_one_of_an_axis():
    angle = np.radians([[[2.0]], [[178.0]]])
    photographs = [0.5 * (1 + 0.5 * np.cos(2 * (np.radians(ANGLES_DEG)[:, None, None, None] - a))) for a in angle]
    found, truth = (np.broadcast_to(images, (4, 1, 64, 64)) for images in photographs)
    truth = truth * np.linspace(0.5, 1, 64, dtype=np.float32)
    scores = full_resolution._scores(found, truth, 1)
    assert scores[3] == pytest.approx(4, abs=1e-3)


def test_unpolarized_detail_is_neither_even_nor_polarized():
    random = np.random.default_rng(0)
    texture = 0.3 + 0.1 * random.random((96, 96))
    texture[:, :32] = 0.3
    photographs = np.stack([texture] * 4)
    photographs[0, :, 64:] *= 1.4
    detail = cameras.unpolarized_detail(Capture.of_planes(photographs), 4)
    assert 0.05 < detail.mean() < 0.15
    # Even on the left, polarized on the right.
    assert not detail[:, :28].any()
    assert not detail[:, 64:].any()


def test_the_study_is_one_command(tmp_path, capsys, monkeypatch, told_pane, png_alone):
    ways = (layers.BOUND, layers.JOINT, layers.CELL, layers.LMMSE)
    monkeypatch.setattr(layers, "Job", partial(layers.Job, ways=ways))
    data = write_data(tmp_path / "data")
    study.main(["--quick", "--sensors", "mono", "--data", str(data), "-o", str(tmp_path)])
    text = capsys.readouterr().out
    assert "| mono | lens blur 0.7 px | 60 | joint solve |" in text
    rows = document_of(tmp_path / "mosaic.json")["results"]
    by_way = {row["way"]: row["known_transmission"] for row in rows}
    assert set(by_way) == set(ways)
    # No mosaic tells as much as four full photographs.
    assert by_way[layers.BOUND] > max(by_way[layers.JOINT], by_way[layers.LMMSE])
    full = {row["way"]: row for row in document_of(tmp_path / "demosaicking.json")["results"]}
    assert set(full) == set(full_resolution.WAYS["mono"])
    for score in ("intensity", "degree", "angle"):
        assert full[full_resolution.WIENER][score] > full[full_resolution.BILINEAR][score]
    real = {row["way"]: row for row in document_of(tmp_path / "real_mosaics.json")["results"]}
    assert set(real) == set(cameras.WAYS)
    # The photographs of least squares are Stokes vectors.
    assert real[cameras.LMMSE]["closure"] < 1e-4 < real[cameras.BILINEAR]["closure"]
    for name in ("mosaic.png", "real_mosaics.png", "pictures/all.png"):
        assert (tmp_path / name).stat().st_size > 10_000
