"""Frames of one camera: what is kept of the first one changes nothing, and is given up where the scene changes."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import InputError
from polaropt.capture import Capture, FrameReader, mosaic_capture
from polaropt.capture.mosaic import filled_samples, wiener_photographs
from polaropt.capture.reading import frames as frames_module
from polaropt.capture.reading.cell_filter import CellFilter
from polaropt.numerics import block_mean
from polaropt.optics import Analyzer
from tests.captured import color_mosaic, mono_mosaic, scene_intensities


def raws(color: bool, n: int = 3, shape: tuple[int, int] = (128, 96), seed: int = 0) -> np.ndarray:
    """Frames (n, h, w) of 12 bits in 16 of a still scene."""
    intensities = scene_intensities((3, *shape) if color else shape, seed=seed)
    clean = (color_mosaic if color else mono_mosaic)(intensities)
    noise = 0.005 * np.random.default_rng(1).standard_normal((n, *shape))
    return np.round(4095 * np.clip(0.7 * clean + 0.05 + noise, 0, 1)).astype(np.uint16)


def read(color: bool) -> dict[str, object]:
    return {"bits": 12, "resolution": "cell", "sensor": "color" if color else "mono", "white_level": 4095}


@pytest.mark.parametrize("color", [False, True])
def test_a_filter_of_cells_is_wieners_averaged_over_the_patterns(color: bool) -> None:
    capture = mosaic_capture(raws(color)[0], bits=12, sensor="color" if color else "mono", white_level=4095)
    assert capture.samples is not None
    assert capture.cells is not None
    assert capture.origin is not None
    samples, cells = capture.samples, capture.cells.capture.intensities
    expected = cells.reshape(4, -1, *cells.shape[-2:])
    noise = capture.origin.raw_noise
    assert noise is not None
    values = filled_samples(samples.values, samples.valid, samples.sampling, expected)
    full = wiener_photographs(samples.values, samples.valid, samples.sampling, capture.angles_deg, noise, expected)
    cell_filter = CellFilter.fitted(values, samples.sampling, capture.angles_deg, noise, expected, detail_power=1.0)
    found = cell_filter.photographs(values)
    np.testing.assert_allclose(found, block_mean(full, samples.sampling.period), atol=1e-4)


@pytest.mark.parametrize("color", [False, True])
def test_frames_are_what_they_are_read_alone(color: bool) -> None:
    frames = raws(color)
    reader = FrameReader(**read(color))
    first = reader.read(frames[0])
    assert first.origin is not None
    known = {"white_level": 4095, "pair_gain": first.origin.pair_gain, "cell_order": first.origin.cell_order}
    for frame in frames[1:]:
        found = reader.read(frame)
        alone = mosaic_capture(frame, **{**read(color), **known})
        assert found.origin == first.origin
        assert found.shape == alone.shape
        # Noise and spectra are fitted to another frame of the scene.
        away = found.intensities - alone.intensities
        assert np.sqrt(np.mean(away**2)) < 0.1 * 0.005
        assert found.cells is not None
        np.testing.assert_allclose(found.registered.intensities, alone.registered.intensities, atol=1e-6)
        np.testing.assert_array_equal(found.valid, alone.valid)


def test_clipped_samples_are_left_out_of_a_frame() -> None:
    frames = raws(False)
    frames[:, 20:30, 20:30] = 4095
    reader = FrameReader(**read(False))
    reader.read(frames[0])
    found, alone = reader.read(frames[1]), mosaic_capture(frames[1], **read(False))
    assert not found.valid.all()
    np.testing.assert_array_equal(found.valid, alone.valid)
    assert np.sqrt(np.mean((found.intensities - alone.intensities) ** 2)) < 0.001


def test_an_analyzer_and_its_gains_hold_for_all_frames() -> None:
    analyzer = Analyzer((0, 45, 90, 135), (1.0, 1.05, 0.97, 1.02), (0.97, 0.98, 0.99, 0.96), (0.5, 45.0, 90.0, 135.5))
    frames = raws(False)
    reader = FrameReader(**read(False), analyzer=analyzer)
    reader.read(frames[0])
    found, alone = reader.read(frames[1]), mosaic_capture(frames[1], **read(False), analyzer=analyzer)
    assert np.sqrt(np.mean((found.intensities - alone.intensities) ** 2)) < 0.001
    np.testing.assert_allclose(found.registered.intensities, alone.registered.intensities, atol=1e-3)


def test_another_scene_is_looked_at_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[object] = []
    anew = frames_module.first_frame
    monkeypatch.setattr(frames_module, "first_frame", lambda *given: begun.append(given) or anew(*given))
    reader = FrameReader(**read(False))
    still = raws(False)
    for frame in still:
        reader.read(frame)
    assert len(begun) == 1
    flat = (2000 + 0.2 * (still[0].astype(float) - 2000)).astype(np.uint16)
    captures: list[Capture] = [reader.read(flat), reader.read(flat)]
    assert len(begun) == 2
    # White and gain stay those of the camera.
    assert captures[0].origin is not None
    assert captures[0].origin.white_level == 4095


def test_frames_of_another_camera_are_refused() -> None:
    reader = FrameReader(**read(False))
    reader.read(raws(False)[0])
    with pytest.raises(InputError, match=r"a frame has 64x64 px, the first 96x128"):
        reader.read(raws(False, shape=(64, 64))[0])
