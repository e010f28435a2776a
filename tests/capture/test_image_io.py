"""Every file format gives back what was put in; damaged files give one line."""

import io

import imagecodecs
import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from polaropt import Capture, InputError, read_capture
from polaropt.capture.files.decode import read_file
from polaropt.capture.files.encoding import linearize, parse_gamma
from polaropt.capture.files.exif import CameraFacts
from polaropt.capture.files.write import (
    encode_srgb,
    tiff_rows,
    write_capture,
    write_png,
    write_png_view,
    write_tiff,
)
from tests.captured import photographed

RANDOM = np.random.default_rng(0)


def pixels(kind, *shape):
    return RANDOM.integers(0, np.iinfo(kind).max, shape, endpoint=True).astype(kind)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(20, 30), (20, 30, 3)])
def test_png_and_tiff_keep_integers(tmp_path, kind, shape):
    image = pixels(kind, *shape)
    write_png(tmp_path / "a.png", image)
    tifffile.imwrite(tmp_path / "a.tif", image, photometric="rgb" if len(shape) == 3 else "minisblack")
    for name in ("a.png", "a.tif"):
        content = read_file(tmp_path / name)
        assert content.pixels.dtype == kind
        assert not content.stack
        np.testing.assert_array_equal(content.pixels, image)


@pytest.mark.parametrize("channels", [2, 4])
def test_alpha_is_dropped(tmp_path, channels):
    image = pixels(np.uint8, 20, 30, channels)
    write_png(tmp_path / "a.png", image)
    expected = image[..., 0] if channels == 2 else image[..., :3]
    np.testing.assert_array_equal(read_file(tmp_path / "a.png").pixels, expected)


def test_tiffs_with_several_pages_or_planes(tmp_path):
    pages = pixels(np.uint16, 4, 20, 30)
    with tifffile.TiffWriter(tmp_path / "pages.tif") as tiff:
        for page in pages:
            tiff.write(page, photometric="minisblack", compression="zlib", contiguous=False)
    content = read_file(tmp_path / "pages.tif")
    assert content.stack
    np.testing.assert_array_equal(content.pixels, pages)
    planar = pixels(np.uint8, 3, 20, 30)
    tifffile.imwrite(tmp_path / "planar.tif", planar, photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(read_file(tmp_path / "planar.tif").pixels, np.moveaxis(planar, 0, -1))


@pytest.mark.parametrize(("shape", "kind"), [((20, 30, 3), "RGB"), ((20, 30), "MINISBLACK")])
def test_float_tiff_is_written_as_it_is(tmp_path, shape, kind):
    image = RANDOM.standard_normal(shape).astype(np.float32)
    write_tiff(tmp_path / "a.tiff", image, CameraFacts(make="Lucid", model="PHX050S"))
    np.testing.assert_array_equal(read_file(tmp_path / "a.tiff").pixels, image)
    with tifffile.TiffFile(tmp_path / "a.tiff") as tiff:
        page = tiff.pages[0]
        assert (page.photometric.name, page.tags["Make"].value, page.tags["Model"].value) == (kind, "Lucid", "PHX050S")


def test_a_coarse_tiff_is_rounded_to_the_nearest_of_ten_bits(tmp_path):
    image = RANDOM.standard_normal((20, 30)).astype(np.float32)
    with tiff_rows(tmp_path / "a.tiff", image.shape, coarse=True) as write:
        write(image)
    written = read_file(tmp_path / "a.tiff").pixels
    np.testing.assert_array_equal(written.view(np.uint32) % 2**13, 0)
    np.testing.assert_allclose(written, image, rtol=2**-11)


def test_the_view_is_srgb(tmp_path):
    write_png_view(tmp_path / "a.png", np.tile([-1.0, 0.0, 0.2158605, 1.0, 7.0], (16, 4)))
    assert read_file(tmp_path / "a.png").pixels[0, :5].tolist() == [0, 0, 128, 255, 255]


@given(st.floats(0, 1))
def test_srgb_there_and_back(value):
    encoded = encode_srgb(np.float32([value]))
    assert linearize(encoded, "srgb")[0] == pytest.approx(value, abs=1e-5)


def test_gamma_is_checked_and_keeps_noise_around_black():
    assert parse_gamma(None) is None
    assert parse_gamma("sRGB") == "srgb"
    assert parse_gamma("2.2") == 2.2
    for wrong in ("film", 0, -1, np.nan, "inf"):
        with pytest.raises(InputError, match="gamma"):
            parse_gamma(wrong)
    assert linearize(np.float32([-0.25, 0.25]), 2.0).tolist() == [-0.0625, 0.0625]


def damaged():
    image = pixels(np.uint8, 40, 50)
    png, jpeg = bytes(imagecodecs.png_encode(image)), bytes(imagecodecs.jpeg8_encode(image))
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer) as writer:
        for _ in range(4):
            writer.write(image, photometric="minisblack", contiguous=False)
    tiff = buffer.getvalue()
    archive = io.BytesIO()
    np.savez(archive, intensities=image)
    npz = archive.getvalue()
    flipped = bytearray(png)
    flipped[len(png) // 2] ^= 255
    cut = {"png": png, "jpg": jpeg, "tif": tiff, "npz": npz}
    files = {f"half.{name}": data[: len(data) // 2] for name, data in cut.items()}
    files |= {f"stub.{name}": data[:9] for name, data in cut.items()}
    files |= {f"tail.{name}": data[:-14] for name, data in cut.items()}
    return files | {"flipped.png": bytes(flipped), "empty.png": b"", "text.png": b"hello"}


@pytest.mark.parametrize(("name", "data"), damaged().items())
def test_damaged_files_are_one_line_with_the_file(tmp_path, name, data, capfd):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=name) as caught:
        read_file(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(tmp_path))
    assert capfd.readouterr() == ("", "")


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.png: no such file"):
        read_file(tmp_path / "nothing.png")
    with pytest.raises(InputError, match="is a folder"):
        read_file(tmp_path)
    with pytest.raises(InputError, match="cannot be written"):
        write_tiff(tmp_path / "no" / "a.tiff", np.zeros((20, 20)))


def test_npz_needs_intensities(tmp_path):
    np.savez(tmp_path / "a.npz", images=np.zeros((4, 20, 20)), angles=np.zeros(4))
    with pytest.raises(InputError, match=r"holds angles, images but no array 'intensities'"):
        read_file(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", intensities=np.zeros((4, 20, 20)), valid=np.ones((20, 20)))
    with pytest.raises(InputError, match="'valid' has shape"):
        read_file(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", intensities=np.array([{}], dtype=object))
    with pytest.raises(InputError, match=r"c\.npz"):
        read_file(tmp_path / "c.npz")


CAPTURES = {
    "gray": photographed((20, 24), exposure=1.3, noise=0.02),
    "color": photographed((3, 20, 24), exposure=1.3, noise=0.02),
    "three": photographed((20, 24), (10, 70, 130.5), noise=0.02),
    "wide": photographed((5, 20, 24), noise=0.02),
}


@pytest.mark.parametrize("name", CAPTURES)
def test_npz_gives_a_capture_back_exactly(tmp_path, name):
    capture = CAPTURES[name]
    valid = capture.valid.copy()
    valid[0, ..., 3, 4] = False
    capture = Capture.of_planes(capture.intensities, capture.angles_deg, valid)
    back = read_capture(write_capture(capture, tmp_path / "a.npz"))
    assert back.angles_deg == capture.angles_deg
    np.testing.assert_array_equal(back.intensities, capture.intensities)
    np.testing.assert_array_equal(back.valid, valid)


@pytest.mark.parametrize("name", ["gray", "color", "three"])
def test_tiff_gives_a_capture_back(tmp_path, name):
    capture = CAPTURES[name]
    back = read_capture(write_capture(capture, tmp_path / "a.tiff"))
    assert back.angles_deg == capture.angles_deg
    np.testing.assert_array_equal(back.intensities, capture.intensities)
    np.testing.assert_array_equal(back.valid, capture.valid)


@pytest.mark.parametrize("name", ["gray", "color", "three"])
def test_pngs_give_a_capture_back_to_16_bits(tmp_path, name):
    capture = CAPTURES[name]
    files = write_capture(capture, tmp_path / "a.png")
    assert len(files) == len(capture.angles_deg)
    back = read_capture(files, capture.angles_deg)
    np.testing.assert_allclose(back.intensities, np.maximum(capture.intensities, 0), atol=1.6e-5)
    np.testing.assert_array_equal(back.valid, capture.valid)


def test_formats_that_cannot_hold_a_capture_are_named(tmp_path):
    with pytest.raises(InputError, match=r"write \.npz"):
        write_capture(CAPTURES["wide"], tmp_path / "a.png")
    with pytest.raises(InputError, match="suffix"):
        write_capture(CAPTURES["gray"], tmp_path / "a.jpg")


@pytest.mark.parametrize(
    ("kind", "channels", "what"),
    [("separated", 4, "inks"), ("cielab", 3, "colours"), ("ycbcr", 3, "luma"), ("miniswhite", 1, "white down")],
)
def test_a_tiff_of_anything_but_light_is_refused(tmp_path, kind, channels, what):
    tifffile.imwrite(tmp_path / "a.tif", pixels(np.uint8, 32, 32, channels).squeeze(), photometric=kind)
    with pytest.raises(InputError, match=f"{what}.*save it again"):
        read_file(tmp_path / "a.tif")


def test_a_tiff_whose_decoder_makes_light_of_it_is_read(tmp_path):
    luma_and_differences = np.full((32, 32, 3), (150, 100, 160), np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", luma_and_differences, photometric="ycbcr", compression="jpeg")
    # By the matrix of JFIF.
    light = 150 + 1.402 * 32, 150 + 0.344 * 28 - 0.714 * 32, 150 - 1.772 * 28
    assert np.abs(read_file(tmp_path / "a.tif").pixels - np.array(light)).max() < 3
