"""Raw files of photographers' cameras: nothing interpolated, one white level and balance, exposures divided out."""

import sys

import numpy as np
import pytest
import tifffile

from polaropt import InputError, read_capture
from polaropt.capture.files.write import write_png
from tests.captured import scene_intensities

BLACK, WHITE = 64, 4095
COLORS = np.array([[0, 1], [1, 2]])
SHARES = np.array([0.5, 0.9, 0.6])


def write_dng(path, light, seconds=0.01, balance=(0.5, 1.0, 0.6)):
    """A small DNG of light (h, w, 3), white = 1, behind a Bayer pattern R G / G B of cells twice as many a side."""
    raw = np.empty((2 * light.shape[0], 2 * light.shape[1]), np.uint16)
    for i, j in np.ndindex(2, 2):
        raw[i::2, j::2] = np.round(BLACK + np.clip(light[..., COLORS[i, j]], 0, 1) * (WHITE - BLACK))

    def rationals(values):
        return [part for value in values for part in (round(10000 * value), 10000)]

    tags = [
        (33421, "H", 2, (2, 2), True),  # size of the pattern, and its colours
        (33422, "B", 4, bytes([0, 1, 1, 2]), True),
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),  # version
        (50707, "B", 4, bytes([1, 1, 0, 0]), True),
        (50708, "s", 0, "Test Camera", True),
        (50714, "H", 1, BLACK, True),
        (50717, "H", 1, WHITE, True),
        (50721, "2i", 9, rationals(np.eye(3).ravel()), True),
        (50728, "2I", 3, rationals(balance), True),
        (50778, "H", 1, 21, True),
        (33434, "2I", 1, (round(seconds * 10000), 10000), True),
    ]
    tifffile.imwrite(path, raw, photometric=32803, extratags=tags, metadata=None, software=None)
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
