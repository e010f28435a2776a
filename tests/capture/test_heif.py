"""HEIC files: decoded in a process of their own, told as compressed, those for bright screens made linear."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from polaropt import InputError, read_capture
from polaropt.capture import EncodingHint, linearize
from polaropt.capture.files.decode import decode
from polaropt.capture.files.formats.heif import HEIF
from polaropt.reporting import inspect_capture, inspection_sentences
from tests.captured import scene_intensities

SIZE = (64, 80)
HLG, PQ, DISPLAY_P3 = 18, 16, 12


@pytest.fixture
def pillow_heif():
    return pytest.importorskip("pillow_heif", reason="pillow-heif is not installed")


def light() -> np.ndarray:
    """Photographs (k, h, w, 3) without fine detail, linear."""
    return np.repeat(scene_intensities(SIZE)[..., None], 3, axis=-1) * [0.9, 0.7, 0.5]


def shown(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def written(library, folder: Path, encoded: np.ndarray, *, deep: bool = False, **settings) -> list[Path]:
    """Files of photographs (k, h, w, 3), white = 1."""
    files = [folder / f"{k}.heic" for k in range(len(encoded))]
    mode, white, kind = ("RGB;16", 65535, np.uint16) if deep else ("RGB", 255, np.uint8)
    for file, image in zip(files, np.round(encoded * white).astype(kind), strict=True):
        made = library.from_bytes(mode=mode, size=image.shape[1::-1], data=image.tobytes())
        made.save(file, quality=-1, chroma=444, **settings)
    return files


def test_they_are_taken_for_encoded_and_told_as_compressed(pillow_heif, tmp_path: Path) -> None:
    capture = read_capture(written(pillow_heif, tmp_path, shown(light())), gamma="srgb")
    expected = np.moveaxis(light(), -1, 1)
    np.testing.assert_allclose(capture.intensities, expected, atol=0.02)
    assert capture.origin.jpeg.quality is None
    said = " ".join(inspection_sentences(inspect_capture(capture)))
    assert "the photographs are HEIC files: double images and fine detail may be lost" in said


def test_colours_of_half_the_resolution_are_told(pillow_heif, tmp_path: Path) -> None:
    files = written(pillow_heif, tmp_path, shown(light()))
    for file in files:
        pillow_heif.open_heif(file).save(file, quality=90, chroma=420)
    looked_at = inspect_capture(read_capture(files))
    assert looked_at.encoding_hint is EncodingHint.HEIF
    assert "are HEIC files (colours at half the resolution)" in " ".join(inspection_sentences(looked_at))


def hlg(linear: np.ndarray) -> np.ndarray:
    """ITU-R BT.2100."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(linear <= 1 / 12, np.sqrt(3 * linear), a * np.log(np.maximum(12 * linear - b, 1e-9)) + c)


def pq(linear: np.ndarray) -> np.ndarray:
    """ITU-R BT.2100."""
    power = linear ** (2610 / 16384)
    return ((3424 / 4096 + 2413 / 128 * power) / (1 + 2392 / 128 * power)) ** (2523 / 32)


@pytest.mark.parametrize(("transfer", "encode"), [(HLG, hlg), (PQ, pq)])
def test_values_for_bright_screens_become_linear(pillow_heif, tmp_path: Path, transfer, encode) -> None:
    colors = {"color_primaries": 1, "transfer_characteristics": transfer, "matrix_coefficients": 0}
    files = written(pillow_heif, tmp_path, encode(light()), deep=True, bit_depth=10, **colors)
    capture = read_capture(files)
    assert capture.origin.encoding_hint is EncodingHint.NONE
    np.testing.assert_allclose(capture.intensities, np.moveaxis(light(), -1, 1), rtol=0.03, atol=0.01)


def test_primaries_that_the_header_tells_are_kept(pillow_heif, tmp_path: Path) -> None:
    colors = {"color_primaries": DISPLAY_P3, "transfer_characteristics": 13, "matrix_coefficients": 0}
    capture = read_capture(written(pillow_heif, tmp_path, shown(light()), **colors))
    profile = capture.origin.camera.colors
    assert profile.name == "Display P3"
    # As in SMPTE EG 432-1 to IEC 61966-2-1, both of white D65.
    expected = [[1.2249, -0.2249, 0], [-0.0420, 1.0420, 0], [-0.0197, -0.0786, 1.0983]]
    np.testing.assert_allclose(np.reshape(profile.to_srgb, (3, 3)), expected, atol=2e-3)


def test_exposures_are_divided_out_and_a_picture_is_upright_already(pillow_heif, tmp_path: Path) -> None:
    files = written(pillow_heif, tmp_path, shown(light()) / 2)
    for file, seconds in zip(files, (0.01, 0.02, 0.01, 0.01), strict=True):
        tags = Image.Exif()
        tags.update({0x0110: "Telephone", 0x0112: 6})
        tags.get_ifd(0x8769).update({0x829A: seconds, 0xA405: 28})
        opened = pillow_heif.open_heif(file)
        opened.info["exif"] = tags.tobytes()
        opened.save(file, quality=-1, chroma=444)
    capture = read_capture(files)
    assert capture.origin.camera.model == "Telephone"
    assert capture.origin.exposures == pytest.approx((0.01, 0.02, 0.01, 0.01))
    height, width = capture.shape[1:]
    assert capture.origin.focal_px == pytest.approx(28 * np.hypot(height, width) / np.hypot(36, 24), rel=0.01)
    # The decoder turns them itself: tall where the tag of a JPEG would ask for it.
    assert (height, width) in (SIZE, SIZE[::-1])
    assert b"Telephone" in capture.origin.camera.exif


def test_a_missing_package_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for suffix in HEIF:
        (tmp_path / f"a{suffix}").write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic")
        monkeypatch.setitem(sys.modules, "pillow_heif", None)
        with pytest.raises(InputError, match=r"pip install 'polaropt\[heif\]'"):
            read_capture(tmp_path / f"a{suffix}")


def test_a_file_that_asks_for_too_much_is_refused_before_it_is_decoded() -> None:
    extent = b"ispe\0\0\0\0" + (60000).to_bytes(4, "big") + (50000).to_bytes(4, "big")
    with pytest.raises(InputError, match="holds 3,000 million pixels"):
        decode(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + extent)


def test_damaged_files_are_one_line(pillow_heif, tmp_path: Path) -> None:
    (file, *_) = written(pillow_heif, tmp_path, shown(light()))
    whole = file.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:40], whole[:200] + bytes(len(whole) - 200)):
        file.write_bytes(damaged)
        with pytest.raises(InputError, match=r"0\.heic: ") as raised:
            read_capture(file)
        assert "\n" not in str(raised.value)


def test_other_files_of_boxes_are_none() -> None:
    with pytest.raises(InputError, match="not a PNG, TIFF, JPEG, HEIC, npz or npy file"):
        decode(b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom")


def test_linear_values_are_those_of_the_encoding() -> None:
    np.testing.assert_allclose(linearize(shown(light()).astype(np.float32), "srgb"), light(), atol=1e-5)
