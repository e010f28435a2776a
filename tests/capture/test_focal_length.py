"""Focal lengths come from the field of view or from EXIF, in the capture's own pixels."""

from __future__ import annotations

import io
import math
import struct
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from polaropt import Capture, InputError, SceneParameters, read_capture
from polaropt.capture.files.focal_length import exif_of_picture, focal_from_exif, focal_from_view
from polaropt.capture.files.formats.tiff import decode_tiff
from polaropt.cli.app import main
from polaropt.estimation.ladder import find_scene
from polaropt.reporting.report import scene_report
from tests.blends import blend
from tests.captured import mono_mosaic, scene_intensities
from tests.optics.test_varying import seen_wide

FILM, LENS, PLANE, UNIT, WIDTH, HEIGHT = 0xA405, 0x920A, 0xA20E, 0xA210, 0xA002, 0xA003


def picture(pixels: np.ndarray, tags: dict[int, object], kind: str) -> bytes:
    """A file whose camera wrote EXIF tags into it."""
    exif = Image.Exif()
    exif[0x010F] = "a camera"
    exif.get_ifd(0x8769).update(tags)
    exif.load(exif.tobytes())
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, kind, exif=exif)
    return buffer.getvalue()


@given(st.floats(1, 170), st.integers(16, 8000))
def test_the_field_of_view_is_what_the_lens_sees(view: float, side: int) -> None:
    focal = focal_from_view(view, side)
    assert 2 * math.degrees(math.atan(side / 2 / focal)) == pytest.approx(view)


@given(st.integers(8, 600), st.sampled_from([(6000, 4000), (4000, 3000), (3000, 4000), (2448, 2048)]))
def test_the_equivalent_for_film_keeps_the_diagonal_view(film: int, size: tuple[int, int]) -> None:
    focal = focal_from_exif({FILM: film}, size)
    assert focal is not None
    assert math.hypot(*size) / focal == pytest.approx(math.hypot(36, 24) / film)


def test_a_full_frame_camera_tells_the_same_both_ways() -> None:
    plane = {LENS: 50.0, PLANE: 6000 / 3.6, UNIT: 3}
    assert focal_from_exif(plane, (6000, 4000)) == pytest.approx(50 / 36 * 6000)
    assert focal_from_exif({FILM: 50, **plane}, (6000, 4000)) == pytest.approx(50 / 36 * 6000)
    assert focal_from_exif({LENS: 50.0, PLANE: 6000 / 36 * 25.4}, (6000, 4000)) == pytest.approx(50 / 36 * 6000)


def test_where_the_two_contradict_the_equivalent_counts() -> None:
    tags = {FILM: 75, LENS: 50.0, PLANE: 72.0, UNIT: 2}
    assert focal_from_exif(tags, (6000, 4000)) == focal_from_exif({FILM: 75}, (6000, 4000))


def test_smaller_and_turned_pictures_are_scaled_and_cropped_ones_refused() -> None:
    tags = {FILM: 50, WIDTH: 6000, HEIGHT: 4000}
    whole = focal_from_exif(tags, (6000, 4000))
    assert whole is not None
    assert focal_from_exif(tags, (1500, 1000)) == pytest.approx(whole / 4)
    assert focal_from_exif(tags, (1000, 1500)) == pytest.approx(whole / 4)
    assert focal_from_exif(tags, (4000, 4000)) is None


@pytest.mark.parametrize(
    "tags", [{}, {FILM: 0}, {FILM: "none"}, {LENS: 50.0}, {LENS: (50, 0), PLANE: 9.0, UNIT: 3}, {LENS: math.inf}]
)
def test_what_is_missing_or_damaged_tells_nothing(tags: dict[int, object]) -> None:
    assert focal_from_exif(tags, (6000, 4000)) is None


@pytest.mark.parametrize(("kind", "suffix"), [("PNG", "png"), ("JPEG", "jpg"), ("TIFF", "tif")])
def test_files_of_all_kinds_tell(tmp_path: Path, kind: str, suffix: str) -> None:
    pixels = np.round(255 * scene_intensities((24, 36))).astype(np.uint8)
    tags = {FILM: 28, WIDTH: 36, HEIGHT: 24}
    files = [tmp_path / f"{k}.{suffix}" for k in range(4)]
    for path, image in zip(files, pixels, strict=True):
        path.write_bytes(picture(image, tags, kind))
    capture = read_capture(files)
    assert capture.focal_px == pytest.approx(28)
    assert read_capture(files, field_of_view_deg=90).focal_px == pytest.approx(18)
    files[2].write_bytes(picture(pixels[2], {**tags, FILM: 40}, kind))
    assert read_capture(files).focal_px is None


def test_damaged_exif_is_no_reason_to_refuse_a_picture() -> None:
    data = picture(np.zeros((20, 20), np.uint8), {FILM: 28}, "JPEG")
    start = data.index(b"Exif\0\0")
    assert exif_of_picture(data) != {}
    assert exif_of_picture(data[: start + 8] + b"\xff" * 60 + data[start + 68 :]) == {}


def test_without_exif_nobody_told(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", scene_intensities((20, 24)).astype(np.float32), photometric="minisblack")
    assert read_capture(tmp_path / "a.tif").focal_px is None
    assert Capture(scene_intensities((20, 24))).focal_px is None


def test_a_cell_of_a_mosaic_is_one_pixel(tmp_path: Path) -> None:
    raw = np.round(255 * mono_mosaic(scene_intensities((48, 72)))).astype(np.uint8)
    path = tmp_path / "raw.png"
    path.write_bytes(picture(raw, {FILM: 36, WIDTH: 72, HEIGHT: 48}, "PNG"))
    capture = read_capture(path, resolution="cell")
    assert capture.shape == (24, 36)
    assert capture.focal_px == pytest.approx(36)
    at_sensor = read_capture(path)
    assert at_sensor.focal_px == pytest.approx(72)
    assert at_sensor.registered.focal_px == pytest.approx(36)


@pytest.mark.parametrize("view", [0.0, -5.0, 180.0, math.nan, "wide"])
def test_no_such_view(tmp_path: Path, view: object) -> None:
    np.savez(tmp_path / "a.npz", intensities=scene_intensities((20, 24)))
    with pytest.raises(InputError, match="field of view"):
        read_capture(tmp_path / "a.npz", field_of_view_deg=view)


def test_two_focal_lengths_are_one_too_many(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "a.npz", intensities=scene_intensities((20, 24)))
    both = ["--focal-px", "100", "--field-of-view-deg", "60"]
    assert main(["estimate", str(tmp_path / "a.npz"), *both]) == 2
    assert "give one of them" in capsys.readouterr().err


def test_a_wide_lens_uses_what_the_camera_told_and_says_so() -> None:
    capture, _, scene = seen_wide(128, focal_px=150.0)
    found = find_scene(capture.with_origin(focal_px=150.0), SceneParameters(None, None, None), 0.005).scene
    assert found.focal_px == 150.0
    assert found.incidence_deg == pytest.approx(scene.incidence_deg, abs=1.0)
    assert "focal_px" not in scene_report(found, SceneParameters(None, None, None), found.focal_px)["estimated"]


def test_a_wrong_one_is_not_believed() -> None:
    capture, _, _ = seen_wide(128, focal_px=150.0)
    found = find_scene(capture.with_origin(focal_px=450.0), SceneParameters(None, None, None), 0.005)
    assert found.scene.focal_px == pytest.approx(150, rel=0.2)
    assert any("does not fit" in tried.reason for tried in found.tried)


def test_a_lens_that_sees_little_stays_on_the_lower_rung() -> None:
    example = blend(60, 96)
    found = find_scene(example.capture.with_origin(focal_px=3000.0), SceneParameters(None, None, None), 0.005).scene
    assert found.focal_px is None


def test_a_directory_of_tags_that_claims_too_much_is_not_read() -> None:
    data = bytearray(picture(np.zeros((24, 36), np.uint8), {FILM: 28, WIDTH: 36, HEIGHT: 24}, "TIFF"))
    assert decode_tiff(bytes(data)).focal_px == pytest.approx(28)
    with tifffile.TiffFile(io.BytesIO(data)) as tiff:
        directory = tiff.pages.first.tags[0x8769].valueoffset
    # The count of its first tag, behind the number of tags, and its code and type.
    data[directory + 6 : directory + 10] = struct.pack("<I", 2**31)
    assert decode_tiff(bytes(data)).focal_px is None
