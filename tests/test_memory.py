"""Large photographs take little memory beside themselves."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from polaropt.capture import Capture, polarization, read_capture, stokes_images, write_capture, write_picture
from polaropt.capture import capture as capture_module
from polaropt.capture.alignment import _aligned, _common_frame
from polaropt.capture.registration import Motions
from polaropt.numerics import BitMask, blocks, fill_gaps
from polaropt.optics import SceneParameters
from polaropt.progress import Stages
from polaropt.reporting.inspection import _polarization, _saturated_share, inspect_still
from polaropt.reporting.pictures import reduced_intensity
from polaropt.separation import separate
from polaropt.simulation import simulate
from polaropt.solving import solution
from solvers.base import StoppingRule

PANE = SceneParameters(60.0, 20.0, 6.3)
SIZE = (640, 800)


@pytest.fixture(scope="module")
def layers() -> list[np.ndarray]:
    random = np.random.default_rng(0)
    coarse = (random.uniform(0.1, 0.7, (SIZE[0] // 8, SIZE[1] // 8, 3)).astype(np.float32) for _ in range(2))
    return [np.repeat(np.repeat(layer, 8, axis=0), 8, axis=1) for layer in coarse]


@pytest.fixture(scope="module")
def capture(layers: list[np.ndarray]) -> Capture:
    return simulate(*layers, PANE)


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Strips as small against these photographs as usual ones are against 24 megapixels."""
    monkeypatch.setattr(blocks, "_STRIP_VALUES", 2**17)
    monkeypatch.setattr(polarization, "_LARGE", 2**17)
    monkeypatch.setattr(capture_module, "_LARGE", 2**17)


@contextmanager
def peak() -> Iterator[Callable[[], float]]:
    """Most bytes allocated inside, beyond those before."""
    tracemalloc.start()
    try:
        yield lambda: tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_simulating_takes_little_beside_the_capture(layers: list[np.ndarray], narrow: None) -> None:
    simulate(*(layer[:64, :64] for layer in layers), PANE)
    with peak() as taken:
        made = simulate(*layers, PANE)
        assert taken() < 1.25 * (made.intensities.nbytes + made.valid.nbytes)


def test_strips_change_nothing(layers: list[np.ndarray], capture: Capture, narrow: None) -> None:
    np.testing.assert_array_equal(simulate(*layers, PANE).intensities, capture.intensities)


@pytest.mark.parametrize("suffix", ["png", "tiff"])
def test_reading_and_writing_take_the_file_s_values_and_little_more(
    capture: Capture, narrow: None, tmp_path: Path, suffix: str
) -> None:
    photograph = capture.intensities.nbytes / 4
    small = capture.part(slice(0, 64), slice(0, 64))
    read_capture(write_capture(small, tmp_path / f"small.{suffix}"))
    with peak() as taken:
        files = write_capture(capture, tmp_path / f"capture.{suffix}")
        assert taken() < 3.5 * photograph
    in_file = 2 if suffix == "png" else 4
    with peak() as taken:
        read = read_capture(files)
        kept = read.intensities.nbytes + read.valid.nbytes
        assert taken() < 1.1 * kept + 2 * in_file * capture.intensities.size
    np.testing.assert_allclose(read.intensities, np.maximum(capture.intensities, 0 if in_file == 2 else -1), atol=1e-5)


def test_stokes_images_of_large_photographs_are_not_kept(capture: Capture, narrow: None) -> None:
    with peak() as taken:
        stokes = stokes_images(capture, 0.005)
        stokes.means(32)
        reduced_intensity(capture, 8)
        assert taken() < 0.35 * capture.intensities.nbytes


@pytest.mark.parametrize("clipped", [False, True])
def test_stokes_images_of_large_photographs_are_those_of_small_ones(
    capture: Capture, monkeypatch: pytest.MonkeyPatch, clipped: bool
) -> None:
    part = capture.part(slice(0, 640), slice(0, 300))
    valid = np.random.default_rng(1).uniform(size=part.valid.shape) > (0.3 if clipped else -1)
    valid[..., 60:600, 40:280] &= not clipped
    part = part.replace(valid=valid)
    kept = stokes_images(part, 0.005)
    monkeypatch.setattr(blocks, "_STRIP_VALUES", 2**17)
    monkeypatch.setattr(polarization, "_LARGE", 2**17)
    # Of the same capture they would be those that were kept.
    read = stokes_images(part.replace(), 0.005)
    assert isinstance(read.images, polarization.MixedImages)
    np.testing.assert_array_equal(read.images[..., 100:300, 7:90], kept.images[..., 100:300, 7:90])
    np.testing.assert_array_equal(read.means(8), kept.means(8))
    np.testing.assert_array_equal(read.shares(8), kept.shares(8))
    np.testing.assert_array_equal(read.reversed().means(8), kept.reversed().means(8))


def test_gaps_as_wide_as_the_frame_are_filled() -> None:
    images = np.ones((1, 600, 300), dtype=np.float32)
    valid = np.zeros(images.shape, dtype=bool)
    assert (fill_gaps(images, valid) == 0).all()
    valid[0, 590:, 290:] = True
    np.testing.assert_allclose(fill_gaps(images, valid), 1, rtol=1e-6)


def no_progress(fraction: float) -> None:
    """Nobody watches."""


@pytest.mark.parametrize("turn_deg", [0.0, 0.2])
def test_moving_photographs_back_in_place_takes_a_few_planes(capture: Capture, narrow: None, turn_deg: float) -> None:
    motions = Motions.of_shifts(np.array([[0, 0], [1.5, -2], [0, 0], [-3, 0.5]]))
    if turn_deg:
        cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        motions.matrices[1] = [[cos, sin], [-sin, cos]]
    frame = _common_frame(motions, capture.shape[-2:])
    expected = _aligned(capture, motions, frame, overwrite=False, tell=no_progress)
    apart = capture.replace(intensities=capture.intensities.copy(), valid=capture.valid.copy())
    with peak() as taken:
        aligned = _aligned(apart, motions, frame, overwrite=True, tell=no_progress)
        assert taken() < 6.5 * apart.intensities[0, 0].nbytes
    assert np.shares_memory(aligned.intensities, apart.intensities)
    np.testing.assert_array_equal(aligned.intensities, expected.intensities)
    np.testing.assert_array_equal(aligned.valid, expected.valid)


def test_the_mask_of_large_photographs_is_kept_in_bits(capture: Capture, narrow: None) -> None:
    clipped = np.random.default_rng(2).uniform(size=capture.intensities.shape) > 0.2
    large = capture.replace(valid=clipped)
    assert isinstance(large.mask, BitMask)
    np.testing.assert_array_equal(large.valid, clipped)
    assert large.n_valid == clipped.sum()
    part = large.part(slice(3, 99), slice(5, 77))
    np.testing.assert_array_equal(part.valid, clipped[..., 3:99, 5:77])
    assert isinstance(large.with_origin(focal_px=1000.0).mask, BitMask)
    assert isinstance(large.part(slice(0, 32), slice(0, 32)).mask, np.ndarray)


def test_tiles_leave_little_but_their_layers(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    tiles = solution.tiles
    monkeypatch.setattr(solution, "tiles", lambda height, width: tiles(height, width, 160))
    settings = solution.Settings(stopping=StoppingRule(max_evaluations=1))

    def most(height: int, width: int) -> tuple[float, solution.Solution]:
        frame = Capture.of_planes(capture.intensities[:, 0, :height, :width])
        with peak() as taken:
            solved = solution.solve(frame.part(slice(height), slice(width)), PANE, 0.005, settings, Stages())
            return taken(), solved

    most(64, 64)
    (of_one, _), (of_many, solved) = most(160, 160), most(352, 448)
    assert len(solved.pieces) == 12
    # Spectra are told at some thousand frequencies of each tile, which are much beside tiles as small as these.
    spectra = sum(piece.known.prior.nbytes for piece in solved.pieces)
    of_tile = 160 * 160 * len(capture.angles_deg) * (4 + 1)
    assert of_many < 1.1 * (of_one + of_tile + solved.layers.nbytes + spectra)


def test_tiles_of_a_large_frame_keep_a_quarter_of_their_spectra(
    capture: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = Capture.of_planes(capture.intensities[:, :1, :280, :440])
    few = StoppingRule(max_evaluations=1)
    tiles = solution.tiles
    monkeypatch.setattr(solution, "tiles", lambda height, width, *most: tiles(height, width, 256))
    whole = separate(frame, PANE, stopping=few)
    monkeypatch.setattr(solution, "_MUCH", 0)
    large = separate(frame, PANE, stopping=few)
    np.testing.assert_array_equal(large.layers, whole.layers)
    kept = [sum(piece.known.prior.nbytes for piece in result.judge.args[3]) for result in (large, whole)]
    assert 4 * kept[0] == pytest.approx(kept[1], rel=0.01)
    np.testing.assert_allclose(large.uncertainty, whole.uncertainty, rtol=0.05)
    assert np.median(np.abs(large.uncertainty / whole.uncertainty - 1)) < 0.005
    np.testing.assert_allclose(large.reflection_known, whole.reflection_known, atol=0.02)


def test_looking_at_large_photographs_takes_little(capture: Capture, narrow: None) -> None:
    clipped = capture.replace(valid=np.random.default_rng(3).uniform(size=capture.intensities.shape) > 0.2)
    for photographs in (capture, clipped):
        with peak() as taken:
            _polarization(photographs)
            _saturated_share(photographs)
            assert taken() < 0.15 * photographs.intensities.nbytes


def test_inspecting_in_strips_changes_nothing(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    clipped = capture.replace(valid=np.random.default_rng(3).uniform(size=capture.intensities.shape) > 0.02)
    at_once = inspect_still(clipped, None)
    monkeypatch.setattr(blocks, "_STRIP_VALUES", 2**17)
    in_strips = inspect_still(clipped, None)
    for name, value in at_once.as_dict().items():
        assert in_strips.as_dict()[name] == (pytest.approx(value) if isinstance(value, float) else value)


def test_a_picture_is_written_without_a_copy_of_its_file(tmp_path: Path) -> None:
    pixels = np.random.default_rng(4).integers(0, 256, (600, 500, 3), dtype=np.uint8)
    write_picture(tmp_path / "small.png", pixels[:16])
    with peak() as taken:
        write_picture(tmp_path / "large.png", pixels)
        assert taken() < 2.5 * (tmp_path / "large.png").stat().st_size


def test_a_large_frame_is_solved_in_smaller_tiles(layers: list[np.ndarray], monkeypatch: pytest.MonkeyPatch) -> None:
    made, tiles = [], solution.tiles
    monkeypatch.setattr(solution, "tiles", lambda *given: made.append(tiles(*given)) or made[-1])
    monkeypatch.setattr(solution, "_MUCH", 2 * 3 * 64 * 520 - 1)
    for width in (519, 520):
        capture = simulate(*(layer[:64, :width] for layer in layers), PANE)
        separate(capture, PANE, stopping=StoppingRule(max_evaluations=1))
    assert [len(parts) for parts in made] == [1, 2]
