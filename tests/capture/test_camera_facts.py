"""What a camera tells beside the pixels: how it was held and exposed, its colours; and what results carry on."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms
from PIL.TiffImagePlugin import IFDRational
from skimage import data

from polaropt.capture.capture import Capture, EncodingHint
from polaropt.capture.files.exif import facts_of_picture, upright
from polaropt.capture.files.jpeg import jpeg_facts, jpeg_traces
from polaropt.capture.files.write import LINEAR_LIGHT, encode_srgb, made_by, write_capture, write_png
from polaropt.capture.noise import noise_level
from polaropt.capture.read import read_capture
from polaropt.cli.app import main
from polaropt.errors import InputError
from polaropt.optics.scene import SceneParameters
from polaropt.reporting.inspection import inspect_capture
from polaropt.reporting.words import capture_findings, inspection_sentences
from polaropt.simulation.simulator import simulate
from tests.command_line import QUICK

Pixels = NDArray[np.uint8]
PANE = SceneParameters(60.0, 20.0, 3.0)
ANGLES = ("000", "045", "090", "135")
# The pane as photographs that are turned upright show it.
KNOWN = ["--incidence", "60", "--azimuth", "110", "--shift", "3"]


def photographs(width: int = 96, height: int = 64) -> Pixels:
    """Four photographs (4, h, w, 3) of 8 bits, linear, none of them clipped."""
    taken = simulate(
        data.coffee()[150 : 150 + height, 200 : 200 + width],
        data.astronaut()[30 : 30 + height, 160 : 160 + width],
        PANE,
        noise=0.003,
    )
    return np.round(200 * np.clip(np.moveaxis(taken.intensities, 1, -1), 0, 1)).astype(np.uint8)


def exif_of(**tags: object) -> Image.Exif:
    """EXIF of a camera with these tags."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0132] = "Maker", "Model 1", "2024:05:06 07:08:09"
    exif[0x0112] = tags.get("orientation", 1)
    directory = exif.get_ifd(0x8769)
    for tag, name in ((0x829A, "seconds"), (0x829D, "aperture"), (0x8827, "speed")):
        if name in tags:
            value = tags[name]
            directory[tag] = value if name == "speed" else IFDRational(Fraction(str(value)))
    return exif


def written(
    folder: Path, images: Pixels, suffix: str = "png", each: list[dict[str, object]] | None = None, **settings: object
) -> list[str]:
    """Files of photographs with EXIF."""
    names = []
    for i, (angle, image) in enumerate(zip(ANGLES, images, strict=True)):
        names.append(str(folder / f"glass_{angle}.{suffix}"))
        Image.fromarray(image).save(names[-1], exif=exif_of(**(each[i] if each else {})), **settings)
    return names


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pictures_are_turned_as_libraries_turn_them(orientation: int, tmp_path: Path) -> None:
    from PIL import ImageOps

    path = tmp_path / "photograph.png"
    Image.fromarray(data.coffee()[:40, :60]).save(path, exif=exif_of(orientation=orientation))
    facts = facts_of_picture(path.read_bytes())
    assert facts.orientation == orientation
    with Image.open(path) as picture:
        expected = np.asarray(ImageOps.exif_transpose(picture))
    np.testing.assert_array_equal(upright(data.coffee()[:40, :60], orientation), expected)


@pytest.mark.parametrize("suffix", ["png", "tiff"])
def test_portrait_photographs_stand_upright(suffix: str, tmp_path: Path) -> None:
    images = photographs()
    capture = read_capture(written(tmp_path, images, suffix, [{"orientation": 6}] * 4))
    assert capture.shape == (3, 96, 64)
    np.testing.assert_allclose(capture.intensities[0], np.moveaxis(np.rot90(images[0], 3), -1, 0) / 255, atol=1e-6)
    assert any("turned upright" in said for said in inspection_sentences(inspect_capture(capture)))


def test_a_mosaic_stays_as_the_sensor_has_it(tmp_path: Path) -> None:
    path = tmp_path / "raw.png"
    raw = photographs(96, 64)[0, ..., 1]
    Image.fromarray(raw).save(path, exif=exif_of(orientation=6))
    assert read_capture(path).shape[-2:] == (64, 96)


def test_exposures_that_the_files_tell_are_divided_out(tmp_path: Path) -> None:
    images = photographs()
    half = images.copy()
    half[1] = images[1] // 2
    told: list[dict[str, object]] = [{"seconds": 0.02, "speed": 200, "aperture": 8} for _ in ANGLES]
    told[1] = {"seconds": 0.02, "speed": 200, "aperture": 8 * 2**0.5}
    capture = read_capture(written(tmp_path, half, each=told))
    assert capture.origin is not None
    assert capture.origin.exposures == pytest.approx((0.04, 0.02, 0.04, 0.04), rel=1e-3)
    assert capture.intensities[1] == pytest.approx(images[1].transpose(2, 0, 1) / 510, abs=0.003)
    assert capture.intensities[0] == pytest.approx(images[0].transpose(2, 0, 1) / 510, abs=0.003)
    assert "exposed differently" in inspection_sentences(inspect_capture(capture))[0]


def test_jpegs_that_were_exposed_differently_are_said_to_be_encoded_and_nothing_else(tmp_path: Path) -> None:
    """What is divided out of encoded values makes pairs that add up to nothing, and an exponent near 1."""
    exposed = np.array([1, 1, 2, 1], np.float32).reshape(-1, 1, 1, 1)
    shown = encode_srgb(np.minimum(0.5 * exposed * photographs(192, 128) / 255, 1))
    each: list[dict[str, object]] = [{"seconds": 0.02 if angle == "090" else 0.01} for angle in ANGLES]
    files = written(tmp_path, np.round(255 * shown).astype(np.uint8), "jpg", each, quality=95)
    told = inspect_capture(read_capture(files))
    assert told.looks_encoded
    assert told.gamma_exponent is None
    assert not told.uneven_gains
    (said,) = [line for line in inspection_sentences(told) if "gamma" in line]
    assert "as exposures can be divided out of linear values alone" in said


def test_exposures_can_be_given(tmp_path: Path) -> None:
    images = photographs()
    half = images.copy()
    half[2] = images[2] // 2
    files = written(tmp_path, half)
    capture = read_capture(files, exposures=(2, 2, 1, 2))
    assert capture.intensities[2] == pytest.approx(images[2].transpose(2, 0, 1) / 510, abs=0.003)
    assert capture.intensities[0] == pytest.approx(images[0].transpose(2, 0, 1) / 510, abs=0.003)
    with pytest.raises(InputError, match="3 exposures are given for 4 photographs"):
        read_capture(files, exposures=(1, 1, 1))
    with pytest.raises(InputError, match="an exposure is 0"):
        read_capture(files, exposures=(1, 1, 1, 0))


@pytest.mark.parametrize(("photograph", "gain"), [(2, 0.8), (1, 1.1)])
def test_a_photograph_that_was_exposed_differently_is_named(photograph: int, gain: float) -> None:
    taken = simulate(data.coffee()[100:292, 100:292], data.astronaut()[30:222, 160:352], PANE, noise=0.003)
    assert not inspect_capture(taken).uneven_gains
    gains = np.ones(4, np.float32)
    gains[photograph] = gain
    found = inspect_capture(Capture(np.moveaxis(taken.intensities * gains[:, None, None, None], 1, -1)))
    assert dict(found.uneven_gains)[taken.angles_deg[photograph]] == pytest.approx(gain, abs=0.01)
    assert len(found.uneven_gains) <= 2
    (said,) = (each.attention for each in capture_findings(found) if each.subject == "exposure")
    assert f"at {taken.angles_deg[photograph]:g} degrees" in said
    assert "--exposures" in said


@pytest.mark.parametrize(("quality", "halved"), [(75, True), (92, False)])
def test_jpeg_is_named_and_makes_results_less_certain(quality: int, halved: bool, tmp_path: Path) -> None:
    images = photographs(160, 128)
    files = written(tmp_path, images, "jpg", quality=quality, subsampling=2 if halved else 0)
    facts = jpeg_facts(Path(files[0]).read_bytes())
    assert facts is not None
    assert (facts.quality, facts.halved_colors) == (quality, halved)
    capture = read_capture(files)
    error = capture.intensities - np.moveaxis(images, -1, 1) / 255
    assert noise_level(capture) > 0.5 * float(np.sqrt(np.mean(np.square(error))))
    (said,) = (each.attention for each in capture_findings(inspect_capture(capture)) if each.subject == "jpeg")
    assert f"quality about {quality}" in said
    assert ("half the resolution" in said) == halved


def test_colours_of_another_profile_are_named(tmp_path: Path) -> None:
    images = photographs()
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    other = inspect_capture(read_capture(written(tmp_path, images, icc_profile=lab)))
    assert other.profile
    assert other.profile in inspection_sentences(other)[0]
    assert not inspect_capture(read_capture(written(tmp_path, images, icc_profile=srgb))).profile


@pytest.mark.parametrize(("quality", "suffix", "settings"), [
    (60, "png", {}), (80, "tif", {"compression": "tiff_lzw"}), (92, "png", {}),
])  # fmt: skip
def test_a_jpeg_that_was_saved_again_is_known_by_its_pixels(
    quality: int, suffix: str, settings: dict[str, object], tmp_path: Path
) -> None:
    images = photographs(160, 128)
    files = written(tmp_path, images, "jpg", quality=quality, subsampling=0)
    of_file = jpeg_facts(Path(files[0]).read_bytes())
    again = written(tmp_path, np.stack([np.asarray(Image.open(name)) for name in files]), suffix, **settings)
    capture = read_capture(again)
    facts = capture.origin.jpeg
    assert facts.saved_again
    assert abs(facts.quality - quality) <= 2
    assert not facts.halved_colors
    assert facts.step == pytest.approx(of_file.step, rel=0.1)
    assert noise_level(capture) == pytest.approx(noise_level(read_capture(files)), rel=0.1)
    looked_at = inspect_capture(capture)
    assert "were JPEG files" in " ".join(inspection_sentences(looked_at))
    assert looked_at.encoding_hint is EncodingHint.JPEG


def test_colours_of_half_the_resolution_show_in_pixels(tmp_path: Path) -> None:
    files = written(tmp_path, photographs(160, 128), "jpg", quality=85, subsampling=2)
    pixels = np.asarray(Image.open(files[0]))
    assert jpeg_traces(pixels).halved_colors
    # Of 16 bits, as many programs save 8.
    assert jpeg_traces(pixels.astype(np.uint16) * 257) == jpeg_traces(pixels)
    assert jpeg_traces(pixels[3:, 5:]) is not None


@pytest.mark.parametrize(
    "pixels",
    [
        data.coffee(),
        data.astronaut(),
        data.camera(),
        np.zeros((64, 64), np.uint8),
        np.random.default_rng(0).integers(0, 256, (256, 256), dtype=np.uint8),
        np.random.default_rng(0).integers(0, 65536, (64, 64), dtype=np.uint16),
        np.random.default_rng(0).random((64, 64), dtype=np.float32),
        np.tile(np.arange(64, dtype=np.uint8) * 4, (64, 1)),
        np.zeros((8, 8), np.uint8),
        np.zeros((64, 64, 5), np.uint8),
        np.zeros((0, 0, 3), np.uint8),
    ],
)
def test_what_was_no_jpeg_is_not_taken_for_one(pixels: NDArray[np.generic]) -> None:
    assert jpeg_traces(pixels) is None


def test_results_carry_on_what_the_camera_tells(tmp_path: Path) -> None:
    files = written(tmp_path, photographs(), each=[{"seconds": 0.02, "speed": 200, "orientation": 6}] * 4)
    out = tmp_path / "out"
    assert main(["separate", *files, *KNOWN, "-o", str(out), *QUICK]) == 0
    with Image.open(out / "transmission.png") as picture:
        assert picture.size == (64, 96)
        assert "srgb" in picture.info
        assert picture.info["Software"].startswith("polaropt ")
        assert picture.info["Description"] == "transmission, model ghosts, solver lbfgs, start closed-form"
        exif = picture.getexif()
        assert (exif[0x010F], exif[0x0112]) == ("Maker", 1)
        assert float(exif.get_ifd(0x8769)[0x829A]) == pytest.approx(0.02)
    with tifffile.TiffFile(out / "reflection.tiff") as tiff:
        tags = tiff.pages.first.tags
        assert tags["Software"].value.startswith("polaropt ")
        assert tags["ImageDescription"].value.startswith("reflection, model ghosts, solver lbfgs, start closed-form; ")
        assert (tags["Make"].value, tags["Model"].value, tags["DateTime"].value) == (
            "Maker",
            "Model 1",
            "2024:05:06 07:08:09",
        )
    for file in out.glob("*.png"):
        with Image.open(file) as picture:
            assert "srgb" in picture.info


def test_every_picture_of_a_result_says_what_it_is_and_what_made_it(tmp_path: Path) -> None:
    # In a part two orthogonal photographs are exchanged: all add up, and no pane explains it.
    pixels = photographs()
    pixels[[1, 3], 20:40, 20:60] = pixels[[3, 1], 20:40, 20:60]
    files = written(tmp_path, pixels)
    out = tmp_path / "out"
    assert main(["separate", *files, *KNOWN, "--model", "ghosts", "-o", str(out), *QUICK]) == 0
    made = "model ghosts, solver lbfgs, start closed-form"
    names = {file.name for file in out.glob("*.png")} | {file.name for file in out.glob("*.tiff")}
    assert {"uncertainty.png", "misfit.png", "misfit.tiff", "reflection_known.tiff"} <= names
    for file in out.glob("*.png"):
        with Image.open(file) as picture:
            assert picture.info["Software"].startswith("polaropt ")
            assert picture.info["Description"] == f"{file.stem}, {made}"
    units = {"reflection_known": "share of the reflection's detail that is told, 0 to 1"}
    units["misfit"] = "standard deviations of the noise"
    for file in out.glob("*.tiff"):
        with tifffile.TiffFile(file) as tiff:
            tags = tiff.pages.first.tags
        assert tags["Software"].value.startswith("polaropt ")
        unit = units.get(file.stem, LINEAR_LIGHT)
        assert tags["ImageDescription"].value == f"{file.stem}, {made}; {unit}"


@pytest.mark.parametrize("suffix", ["png", "tiff"])
def test_a_simulated_capture_says_what_made_it(tmp_path: Path, suffix: str) -> None:
    taken = simulate(data.coffee()[:64, :64], data.astronaut()[:64, :64], PANE)
    (file, *_) = write_capture(taken, tmp_path / f"glass.{suffix}")
    if suffix == "png":
        with Image.open(file) as picture:
            said = picture.info["Software"]
    else:
        with tifffile.TiffFile(file) as tiff:
            said = tiff.pages.first.tags["Software"].value
    assert said == made_by()


def test_linear_values_do_not_say_that_they_are_in_srgb(tmp_path: Path) -> None:
    write_png(tmp_path / "linear.png", np.zeros((4, 4), np.uint16))
    assert b"sRGB" not in (tmp_path / "linear.png").read_bytes()
