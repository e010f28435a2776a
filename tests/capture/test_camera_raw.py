"""Raw files of photographers' cameras: nothing interpolated, one white level and balance, exposures divided out."""

import sys

import numpy as np
import pytest
import tifffile

from polaropt import InputError, read_capture
from polaropt.capture.files.formats.camera_raw import _first_cell, _of_cells
from polaropt.capture.files.write import write_png
from tests.captured import scene_intensities

BLACK, WHITE = 64, 4095
COLORS = np.array([[0, 1], [1, 2]])
SHARES = np.array([0.5, 0.9, 0.6])


# Six pixels a side of Fujifilm's sensors: cells of three with green in the corners and the middle.
X_TRANS = np.array(
    [
        [1, 2, 1, 1, 0, 1],
        [0, 1, 0, 2, 1, 2],
        [1, 2, 1, 1, 0, 1],
        [1, 0, 1, 1, 2, 1],
        [2, 1, 2, 0, 1, 0],
        [1, 0, 1, 1, 2, 1],
    ]
)


def write_dng(path, light, seconds=0.01, balance=(0.5, 1.0, 0.6), pattern=COLORS, side=2):
    """A small DNG of light (h, w, 3), white = 1, behind a pattern of cells so many pixels a side; None: linear."""
    stored = np.round(BLACK + np.clip(light, 0, 1) * (WHITE - BLACK)).astype(np.uint16)
    if pattern is not None:
        rows, columns = np.indices((side * light.shape[0], side * light.shape[1]))
        colors = pattern[rows % len(pattern), columns % len(pattern)]
        stored = stored[rows // side, columns // side, colors]
    levels = 1 if pattern is not None else 3

    def rationals(values):
        return [part for value in values for part in (round(10000 * value), 10000)]

    tags = [
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),  # version
        (50707, "B", 4, bytes([1, 1, 0, 0]), True),
        (50708, "s", 0, "Test Camera", True),
        (50714, "H", levels, (BLACK,) * levels, True),
        (50717, "H", levels, (WHITE,) * levels, True),
        (50721, "2i", 9, rationals(np.eye(3).ravel()), True),
        (50728, "2I", 3, rationals(balance), True),
        (50778, "H", 1, 21, True),
        (33434, "2I", 1, (round(seconds * 10000), 10000), True),
    ]
    if pattern is not None:  # its size, and its colours
        tags += [(33421, "H", 2, pattern.shape, True), (33422, "B", pattern.size, pattern.astype("u1").tobytes(), True)]
    kind = 34892 if pattern is None else 32803
    tifffile.imwrite(path, stored, photometric=kind, extratags=tags, metadata=None, software=None)
    return path


def colored(shape=(40, 48)):
    """Photographs (k, h, w, 3)."""
    return scene_intensities(shape)[..., None] * SHARES


@pytest.fixture
def files(tmp_path):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    return [write_dng(tmp_path / f"{k}.dng", light) for k, light in enumerate(colored())]


def test_a_cell_is_a_pixel_and_one_white_holds_for_all_files(files):
    capture = read_capture(files)
    assert capture.shape == (3, 40, 48)
    assert capture.origin.layout == "files"
    balance = np.array([1, 0.5, 1 / 0.6 / 2]).reshape(3, 1, 1)
    expected = np.moveaxis(colored(), -1, 1) * balance
    np.testing.assert_allclose(capture.intensities, expected, atol=2e-3)


def test_a_cell_of_x_trans_is_a_pixel_and_linear_ones_stay(tmp_path):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    balance = np.array([1, 0.5, 1 / 0.6 / 2]).reshape(3, 1, 1)
    expected = np.moveaxis(colored(), -1, 1) * balance
    for settings in ({"pattern": X_TRANS, "side": 3}, {"pattern": None}):
        files = [write_dng(tmp_path / f"{k}.dng", light, **settings) for k, light in enumerate(colored())]
        capture = read_capture(files)
        assert capture.shape == (3, 40, 48)
        np.testing.assert_allclose(capture.intensities, expected, atol=2e-3)


@pytest.mark.parametrize("top", range(6))
@pytest.mark.parametrize("left", range(6))
def test_colours_of_a_cell_of_x_trans_share_its_middle_wherever_the_sensor_begins(top, left):
    seen = np.roll(X_TRANS, (-top, -left), (0, 1))
    down, across = _first_cell(seen, 3)
    assert ((top + down) % 3, (left + across) % 3) == (0, 0)
    rows, columns = np.indices((31, 28))
    # Light that grows along rows and columns has the value of the middle in every colour.
    values = 100.0 + 3 * rows + 2 * columns
    means, valid = _of_cells(values, 1e3, np.zeros(3, np.float32), np.arange(3), seen, 3)
    middle = 100 + 3 * (down + 1) + 2 * (across + 1) + 9 * np.arange(len(means))[:, None] + 6 * np.arange(len(means[0]))
    np.testing.assert_allclose(1e3 * means, np.repeat(middle[..., None], 3, axis=-1), rtol=1e-5)
    assert valid.all()
    assert means.shape == ((31 - down) // 3, (28 - across) // 3, 3)


def test_a_pattern_of_more_colours_is_refused_in_one_line(tmp_path):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    wide = np.kron(COLORS, np.ones((2, 2), int))
    with pytest.raises(InputError, match=r"a\.dng: its sensor's pattern is not known; develop it to linear TIFF"):
        read_capture(write_dng(tmp_path / "a.dng", colored()[0], pattern=wide, side=4))


def test_exposures_are_divided_out_and_told(tmp_path, capsys):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    from polaropt.cli.app import main

    seconds, light = (0.01, 0.02, 0.01, 0.01), colored()
    files = [
        write_dng(tmp_path / f"{k}.dng", (s / 0.02) * image, s)
        for k, (s, image) in enumerate(zip(seconds, light, strict=True))
    ]
    capture = read_capture(files)
    assert capture.origin.exposures == pytest.approx(seconds)
    balance = np.array([1, 0.5, 1 / 0.6 / 2]).reshape(3, 1, 1)
    np.testing.assert_allclose(capture.intensities, np.moveaxis(light, -1, 1) / 2 * balance, atol=2e-3)
    assert main(["inspect", *map(str, files)]) == 0
    assert "exposed differently (0.01, 0.02, 0.01, 0.01 s at ISO 100)" in capsys.readouterr().out


def test_a_file_balanced_otherwise_makes_no_polarization(tmp_path, files):
    write_dng(files[2], colored()[2], balance=(0.7, 1.0, 0.4))
    capture = read_capture(files)
    balance = np.array([1, 0.5, 1 / 0.6 / 2]).reshape(3, 1, 1)
    np.testing.assert_allclose(capture.intensities, np.moveaxis(colored(), -1, 1) * balance, atol=2e-3)


def test_what_is_clipped_on_the_sensor_is_not_trusted(tmp_path):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    light = 1.5 * colored()
    capture = read_capture([write_dng(tmp_path / f"{k}.dng", image) for k, image in enumerate(light)])
    np.testing.assert_array_equal(capture.valid, np.moveaxis(np.round(light * (WHITE - BLACK)) < WHITE - BLACK, -1, 1))


def test_one_file_alone_is_no_mosaic_of_a_polarization_camera(files):
    with pytest.raises(InputError, match="one colour picture holds one polarizer angle"):
        read_capture(files[0])


def test_a_missing_package_names_the_extra(tmp_path, monkeypatch):
    (tmp_path / "a.dng").write_bytes(b"II*\0")
    monkeypatch.setitem(sys.modules, "rawpy", None)
    with pytest.raises(InputError, match=r"pip install 'polaropt\[raw\]'"):
        read_capture(tmp_path / "a.dng")


def test_damaged_files_are_one_line(tmp_path):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    write_png(tmp_path / "a.png", np.zeros((40, 40), np.uint8))
    (tmp_path / "a.png").rename(tmp_path / "a.nef")
    with pytest.raises(InputError, match=r"a\.nef: cannot be read as an image"):
        read_capture(tmp_path / "a.nef")
