"""Colours of files as their ICC profiles tell them: primaries, encoding, and what is shown and written."""

from __future__ import annotations

import io
import json
import re
import subprocess
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms

from polaropt.capture.capture import EncodingHint
from polaropt.capture.files.colors import color_profile, linear_profile
from polaropt.capture.files.write import encode_srgb
from polaropt.capture.read import read_capture
from polaropt.optics.scene import SceneParameters
from polaropt.reporting.files import write_separation
from polaropt.reporting.inspection import inspect_capture
from polaropt.reporting.notebook import result_html
from polaropt.reporting.pictures import inspection_picture
from polaropt.reporting.words import inspection_sentences
from polaropt.separation import separate
from polaropt.sequence.files import _video
from tests.capture.test_camera_facts import photographs, written

ADOBE_RGB = bytes(imagecodecs.cms_profile("adobergb"))
# Of a profile of linear values in the primaries of ITU-R BT.2020, and what takes them to those of sRGB (BT.2087).
WIDE = bytes(
    imagecodecs.cms_profile(
        "rgb", whitepoint=[0.3127, 0.3290, 1], primaries=[0.708, 0.292, 1, 0.17, 0.797, 1, 0.131, 0.046, 1], gamma=1.0
    )
)
WIDE_TO_SRGB = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])


def test_a_profile_tells_its_primaries_and_its_encoding() -> None:
    wide = color_profile(WIDE)
    np.testing.assert_allclose(np.reshape(wide.to_srgb, (3, 3)), WIDE_TO_SRGB, atol=2e-3)
    assert wide.exponent == pytest.approx(1, abs=1e-3)
    assert color_profile(ADOBE_RGB).exponent == pytest.approx(2.2, abs=0.01)
    srgb = color_profile(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    assert (srgb.name, srgb.to_srgb) == ("", None)


def test_the_layers_profile_has_the_photographs_primaries() -> None:
    wide = color_profile(WIDE)
    again = color_profile(linear_profile(wide.to_srgb))
    np.testing.assert_allclose(again.to_srgb, wide.to_srgb, atol=1e-3)
    assert color_profile(linear_profile(None)).to_srgb is None


@pytest.mark.parametrize("damaged", [b"no profile", WIDE[:200], ADOBE_RGB[:-100]])
def test_a_damaged_profile_is_no_reason_to_refuse(damaged: bytes) -> None:
    assert color_profile(damaged).to_srgb is None


def test_pictures_of_another_profile_are_shown_in_srgb(tmp_path: Path) -> None:
    images = photographs(64, 64)
    capture = read_capture(written(tmp_path, images, icc_profile=WIDE))
    looked_at = inspect_capture(capture)
    assert (looked_at.shown_in_srgb, looked_at.encoding_hint.decides) == (True, False)
    assert "pictures show them in sRGB" in inspection_sentences(looked_at)[0]
    write_separation(tmp_path, separate(capture, SceneParameters(60.0, 20.0, 3.0)), capture, uncertainty=False)
    with tifffile.TiffFile(tmp_path / "transmission.tiff") as tiff:
        np.testing.assert_allclose(
            color_profile(tiff.pages[0].iccprofile).to_srgb, color_profile(WIDE).to_srgb, atol=1e-3
        )
        layer = tiff.asarray()
    exposure = json.loads((tmp_path / "report.json").read_text())["view"]["exposure"]["transmission"]
    shown = imagecodecs.png_decode((tmp_path / "transmission.png").read_bytes())
    np.testing.assert_allclose(shown / 255, encode_srgb(exposure * layer @ WIDE_TO_SRGB.T), atol=0.01)


def test_a_profile_that_encodes_is_a_sign_of_encoded_values(tmp_path: Path) -> None:
    looked_at = inspect_capture(read_capture(written(tmp_path, photographs(48, 48), icc_profile=ADOBE_RGB)))
    assert looked_at.encoding_hint is EncodingHint.PROFILE
    assert looked_at.profile_exponent == pytest.approx(2.2, abs=0.01)


def test_inspections_notebooks_and_films_are_in_srgb_too(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    flat = np.broadcast_to(np.array([200, 100, 10], dtype=np.uint8), (4, 48, 48, 3))
    capture = read_capture(written(tmp_path, flat, icc_profile=WIDE))
    result = separate(read_capture(written(tmp_path, photographs(48, 48))), SceneParameters(60.0, 20.0, 3.0))
    result = replace(result, layers=np.stack(2 * [capture.intensities[0]]))
    with _video(tmp_path / "film.mp4", 1) as show:
        show(result, capture)
    subprocess.run([ffmpeg, "-v", "quiet", "-i", "film.mp4", "film.png"], cwd=tmp_path, check=True)
    (in_page, _) = re.findall(r"base64,([^\"]+)", result_html(result, capture))
    shown = {
        "inspection": inspection_picture(capture)[40, 30],
        "notebook": np.asarray(Image.open(io.BytesIO(b64decode(in_page))))[24, 24],
        "film": imagecodecs.png_decode((tmp_path / "film.png").read_bytes())[24, 24],
    }
    # White is what is brightest, here the red.
    expected = 255 * encode_srgb(np.array([1, 0.5, 0.05]) @ WIDE_TO_SRGB.T)
    assert np.abs(expected - 255 * encode_srgb(np.array([1, 0.5, 0.05]))).max() > 50
    for name, color in shown.items():
        np.testing.assert_allclose(color, expected, atol=6, err_msg=name)
