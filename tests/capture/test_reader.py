"""Files become captures: sizes, angles, levels, masks, gain; and what cannot is one line."""

import imagecodecs
import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter

from polaropt import InputError, read_capture
from polaropt.capture.files.write import encode_srgb, write_png, write_tiff
from polaropt.capture.noise import measured_noise, noise_level
from tests.captured import ANGLES, color_mosaic, mono_mosaic, photographed, scene_intensities


def sixteen(values):
    return np.round(np.clip(values, 0, 1) * 65535).astype(np.uint16)


def written(folder, images, name="photo"):
    """Single-image PNG files, (k, [channel,] h, w) or (k, h, w)."""
    paths = []
    for k, image in enumerate(images):
        paths.append(folder / f"{name}_{k}.png")
        write_png(paths[-1], np.moveaxis(image, 0, -1) if image.ndim == 3 else image)
    return paths


@pytest.mark.parametrize("shape", [(20, 24), (3, 20, 24)])
def test_one_file_per_angle(tmp_path, shape):
    images = scene_intensities(shape)
    capture = read_capture(written(tmp_path, sixteen(images)))
    assert capture.angles_deg == ANGLES
    np.testing.assert_allclose(capture.intensities, images, atol=1e-5)
    assert capture.valid.all()
    assert capture.origin.layout == "files"
    assert capture.origin.sample_type == "uint16"
    assert capture.origin.pair_gain == 1


def test_a_stack_of_colour_pages_and_other_angles(tmp_path):
    images = scene_intensities((3, 20, 24), (0, 60, 120))
    tifffile.imwrite(tmp_path / "a.tif", np.moveaxis(sixteen(images), 1, -1), photometric="rgb")
    capture = read_capture(tmp_path / "a.tif", (0, 60, 120))
    assert capture.shape == (3, 20, 24)
    assert capture.angles_deg == (0, 60, 120)


def test_gray_stored_as_rgb_stays_colour(tmp_path):
    images = sixteen(np.repeat(scene_intensities((20, 24))[:, None], 3, axis=1))
    assert read_capture(written(tmp_path, images)).shape == (3, 20, 24)


def test_channels_last_in_npz(tmp_path):
    images = scene_intensities((3, 20, 24)).astype(np.float32)
    np.savez(tmp_path / "a.npz", intensities=np.moveaxis(images, 1, -1))
    np.testing.assert_array_equal(read_capture(tmp_path / "a.npz").intensities, images)


@pytest.mark.parametrize("gain", [1.0, 1.022])
def test_a_mono_mosaic_has_the_sensors_size_and_its_gain_divided_out(tmp_path, gain):
    images = scene_intensities((128, 161))
    skewed = images * np.array([1, gain, 1, gain]).reshape(4, 1, 1)
    write_png(tmp_path / "a.png", sixteen(mono_mosaic(skewed)))
    capture = read_capture(str(tmp_path / "a.png"))
    assert capture.shape == (128, 160)
    assert capture.origin.layout == "mono mosaic"
    assert capture.origin.left_out_px == (0, 1)
    assert capture.origin.pair_gain == pytest.approx(gain, abs=2e-3)
    np.testing.assert_allclose(capture.samples.values[::2, ::2], images[2, ::2, :160:2], atol=3e-3)
    np.testing.assert_allclose(capture.samples.values[::2, 1::2], images[1, ::2, 1:160:2], atol=3e-3)
    cells = read_capture(tmp_path / "a.png", resolution="cell")
    assert (cells.shape, cells.samples) == ((64, 80), None)
    assert cells.registered.shape == capture.registered.shape == (64, 80)
    forced = read_capture(tmp_path / "a.png", pair_gain=1.05)
    assert forced.origin.pair_gain == 1.05
    ratio = forced.samples.values[::2, 1::2] / capture.samples.values[::2, 1::2]
    np.testing.assert_allclose(ratio, capture.origin.pair_gain / 1.05, rtol=1e-5)


def test_an_implausible_gain_is_left_alone(tmp_path):
    images = scene_intensities((128, 128)) * np.array([1, 0.7, 1, 0.7]).reshape(4, 1, 1)
    write_png(tmp_path / "a.png", sixteen(mono_mosaic(images)))
    assert read_capture(tmp_path / "a.png").origin.pair_gain == 1


def test_a_colour_mosaic_has_the_sensors_size_or_a_quarter(tmp_path):
    gray = scene_intensities((128, 160))
    images = np.stack([0.5 * gray, gray, 0.7 * gray], axis=1)
    write_png(tmp_path / "a.png", sixteen(color_mosaic(images)))
    capture = read_capture(tmp_path / "a.png")
    assert capture.origin.layout == "color mosaic"
    assert capture.shape == (3, 128, 160)
    np.testing.assert_allclose(capture.samples.values[::4, ::4], images[2, 0, ::4, ::4], atol=5e-3)
    assert read_capture(tmp_path / "a.png", resolution="cell").shape == (3, 32, 40)
    assert read_capture(tmp_path / "a.png", sensor="mono").shape == (128, 160)


def test_clipping_is_decided_on_raw_values(tmp_path):
    images = 1.3 * scene_intensities((128, 128))
    raw = sixteen(mono_mosaic(images))
    write_png(tmp_path / "a.png", raw)
    capture = read_capture(tmp_path / "a.png")
    np.testing.assert_array_equal(capture.samples.valid, raw < 65535)
    np.testing.assert_array_equal(capture.observed.valid[2, ::2, ::2], raw[::2, ::2] < 65535)
    assert not capture.observed.valid[2, 1::2].any()


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("resolution", ["sensor", "cell"])
def test_the_noise_of_a_mosaic_is_that_of_its_samples(tmp_path, color, resolution):
    gray = gaussian_filter(scene_intensities((256, 256)) * 0.9, (0, 1, 1))
    images = np.stack([0.5 * gray, gray, 0.7 * gray], axis=1) if color else gray
    raw = color_mosaic(images) if color else mono_mosaic(images)
    raw = 0.05 + raw + 0.01 * np.random.default_rng(0).standard_normal(raw.shape)
    write_png(tmp_path / "a.png", sixteen(raw))
    capture = read_capture(tmp_path / "a.png", resolution=resolution)
    level, model = measured_noise(capture)
    assert level == noise_level(capture) == pytest.approx(0.01, rel=0.2)
    assert model.read == pytest.approx(level)


@pytest.mark.parametrize(("top", "expected"), [(4095, 4095), (4095 * 16, 4095 * 16), (3506, 3506)])
def test_white_is_where_pixels_pile_up(tmp_path, top, expected):
    images = 1.4 * photographed((128, 128), noise=0.01).intensities
    files = written(tmp_path, np.round(np.clip(images, 0, 1) * top).astype(np.uint16))
    capture = read_capture(files)
    assert capture.origin.white_level == expected
    assert capture.intensities.max() == 1
    np.testing.assert_array_equal(capture.valid, images < 1 - 0.5 / top)


def test_an_unclipped_maximum_is_not_white(tmp_path):
    files = written(tmp_path, np.round(scene_intensities() * 4095).astype(np.uint16))
    assert read_capture(files).origin.white_level == 65535
    capture = read_capture(files, white_level=4095, black_level=15)
    np.testing.assert_allclose(capture.intensities, (scene_intensities() * 4095 - 15) / 4080, atol=2e-4)


def test_encoded_files_are_linearized_when_told(tmp_path):
    images = scene_intensities((3, 20, 24))
    files = written(tmp_path, sixteen(encode_srgb(images)))
    np.testing.assert_allclose(read_capture(files, gamma="srgb").intensities, images, atol=1e-4)
    assert read_capture(files).intensities.mean() > images.mean() + 0.1


def test_jpeg_files(tmp_path):
    files = []
    for k, image in enumerate(scene_intensities((32, 40))):
        files.append(tmp_path / f"{k}.jpg")
        files[-1].write_bytes(imagecodecs.jpeg8_encode(np.round(255 * image).astype(np.uint8), level=95))
    capture = read_capture(files)
    assert "JPEG" in capture.origin.encoding_hint
    np.testing.assert_allclose(capture.intensities, scene_intensities((32, 40)), atol=0.04)


GOOD = sixteen(scene_intensities((20, 24)))


def stack(folder, images):
    np.savez(folder / "a.npz", intensities=images)
    return folder / "a.npz"


@pytest.mark.parametrize(
    ("make", "options", "words"),
    [
        (lambda folder: [], {}, "no file given"),
        (lambda folder: folder, {}, "is a folder"),
        (lambda folder: 7, {}, "no list of files"),
        (lambda folder: folder / "none.png", {}, r"none\.png: no such file"),
        (lambda folder: written(folder, GOOD)[:2], {}, "2 polarizer angles"),
        (lambda folder: written(folder, GOOD)[:3], {}, "3 photographs but 4 polarizer angles"),
        (lambda folder: [*written(folder, GOOD)[:3], *written(folder, GOOD)[:1]], {}, "given twice"),
        (lambda folder: written(folder, GOOD), {"angles_deg": (0, 45, 0, 90)}, "equal"),
        (lambda folder: written(folder, GOOD), {"angles_deg": (0, 45, "x", 90)}, "give a number"),
        (lambda folder: written(folder, GOOD), {"angles_deg": 5}, "4 photographs but 1|at least 3"),
        (lambda folder: written(folder, GOOD), {"sensor": "mono"}, "for one raw mosaic"),
        (lambda folder: written(folder, GOOD), {"sensor": "foveon"}, "choose one of auto, mono, color"),
        (lambda folder: written(folder, GOOD), {"resolution": "cell"}, "for one raw mosaic"),
        (lambda folder: written(folder, GOOD), {"resolution": "full"}, "choose one of sensor, cell"),
        (lambda folder: stack(folder, GOOD[0]), {}, "at least 32 px a side"),
        (lambda folder: written(folder, GOOD), {"black_level": 9, "white_level": 3}, "not above the black level"),
        (lambda folder: written(folder, GOOD), {"black_level": 20000}, "black level"),
        (lambda folder: written(folder, GOOD), {"pair_gain": 0}, "pair gain"),
        (lambda folder: written(folder, GOOD), {"gamma": "film"}, "gamma"),
        (lambda folder: written(folder, GOOD), {"white_level": 1e-320}, "hardly above the black level"),
        (lambda folder: written(folder, GOOD), {"white_level": 100}, "saturated"),
        (lambda folder: written(folder, GOOD[:3]), {"angles_deg": (0, 60, 120), "pair_gain": 1.02}, "pair gain needs"),
        (lambda folder: written(folder, 0 * GOOD), {}, "all black"),
        (lambda folder: written(folder, 0 * GOOD + 9), {}, "constant"),
        (lambda folder: written(folder, 0 * GOOD + 65535), {}, "saturated"),
        (lambda folder: written(folder, GOOD[:, :12]), {}, "at least 16x16"),
        (lambda folder: written(folder, GOOD[:1]), {}, "at least 32 px a side"),
        (lambda folder: written(folder, GOOD)[:3] + written(folder, GOOD[:, 2:], "b")[:1], {}, "same size"),
        (lambda folder: written(folder, GOOD)[:3] + written(folder, GOOD.astype(np.uint8), "b")[:1], {}, "same depth"),
        (lambda folder: written(folder, np.stack([GOOD[:3]])), {}, "one colour picture"),
        (lambda folder: stack(folder, GOOD[:2]), {}, r"2 photograph\(s\)"),
        (lambda folder: stack(folder, np.where(GOOD < 20000, np.nan, 0.5)), {}, r"a\.npz: holds NaN"),
        (lambda folder: stack(folder, GOOD.astype(float)), {}, "give the white level"),
        (lambda folder: stack(folder, GOOD * 1j), {}, "complex"),
        (lambda folder: stack(folder, GOOD[0]), {"cell_order": (0, 45, 90, 90)}, "four different angles"),
        (lambda folder: stack(folder, GOOD[0]), {"angles_deg": (0, 60, 120)}, "cell order"),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path, make, options, words):
    with pytest.raises(InputError, match=words) as caught:
        read_capture(make(tmp_path), **options)
    assert "\n" not in str(caught.value)


def test_one_defect_below_black_counts(tmp_path):
    images = scene_intensities((20, 24)).astype(np.float32)
    images[2, 7, 7] = -0.02
    files = [tmp_path / f"{k}.tiff" for k in range(4)]
    for path, image in zip(files, images, strict=True):
        write_tiff(path, image)
    with pytest.raises(InputError, match="black level"):
        read_capture(files)


def test_angles_counted_clockwise_are_negated(tmp_path):
    images = scene_intensities((3, 20, 24), (0, 30, 60, 120))
    files = written(tmp_path, sixteen(images))
    capture = read_capture(files, (0, 30, 60, 120), angle_sense="cw")
    assert capture.angles_deg == (0, 150, 120, 60)
    assert capture.origin.angle_sense == "cw"
    seen, meant = capture.stokes, read_capture(files, (0, 30, 60, 120)).stokes
    np.testing.assert_allclose(seen, meant * np.array([1, 1, -1]).reshape(3, 1, 1, 1), atol=1e-5)


def test_a_mosaic_and_a_stored_angle_follow_the_sense_too(tmp_path):
    write_png(tmp_path / "a.png", sixteen(mono_mosaic(scene_intensities((128, 128)))))
    assert read_capture(tmp_path / "a.png", angle_sense="cw").angles_deg == (0, 135, 90, 45)
    np.savez(tmp_path / "a.npz", intensities=scene_intensities((20, 24), (0, 60, 100)), angles_deg=(0, 60, 100))
    assert read_capture(tmp_path / "a.npz", angle_sense="cw").angles_deg == (0, 120, 80)
    with pytest.raises(InputError, match="choose one of ccw, cw"):
        read_capture(tmp_path / "a.npz", angle_sense="left")


def packed(values, pixel_format):
    """Bytes of values as a camera packs them, spelled out bit by bit."""
    if pixel_format == "Mono12Packed":
        pairs = values.reshape(-1, 2).astype(int)
        parts = [pairs[:, 0] >> 4, (pairs[:, 1] & 15) << 4 | pairs[:, 0] & 15, pairs[:, 1] >> 4]
        return np.stack(parts, axis=1).astype(np.uint8).tobytes()
    depth, stored = {
        "Mono8": (8, 8),
        "Mono10": (10, 16),
        "Mono12": (12, 16),
        "Mono16": (16, 16),
        "Mono10p": (10, 10),
        "Mono12p": (12, 12),
    }[pixel_format]
    assert values.max() < 2**depth
    bits = (values.ravel()[:, None] >> np.arange(stored)) & 1
    return np.packbits(bits.ravel().astype(np.uint8), bitorder="little").tobytes()


@pytest.mark.parametrize(
    ("pixel_format", "depth"),
    [
        ("Mono8", 8),
        ("Mono10", 10),
        ("Mono12", 12),
        ("Mono16", 16),
        ("Mono10p", 10),
        ("Mono12p", 12),
        ("Mono12Packed", 12),
    ],
)
def test_raw_files_without_a_header_are_unpacked(tmp_path, pixel_format, depth):
    values = np.round(mono_mosaic(scene_intensities((48, 64))) * (2**depth - 1)).astype(int)
    (tmp_path / "a.raw").write_bytes(packed(values, pixel_format))
    capture = read_capture(tmp_path / "a.raw", shape=(48, 64), pixel_format=pixel_format, pair_gain=1)
    assert capture.origin.white_level == 2**depth - 1
    np.testing.assert_allclose(capture.samples.values * (2**depth - 1), values, atol=1e-2)


def test_a_raw_file_whose_size_does_not_fit_is_one_line(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(48 * 64 * 3 // 2))
    with pytest.raises(InputError, match=r"1\.5 a pixel of 64x48; correct the shape, or name the pixel format"):
        read_capture(path, shape=(48, 64))
    with pytest.raises(InputError, match="take 4800; correct the shape"):
        read_capture(path, shape=(50, 64), pixel_format="Mono12p")
    with pytest.raises(InputError, match="does not exist; choose one of Mono8"):
        read_capture(path, shape=(48, 64), pixel_format="RGB8")
    with pytest.raises(InputError, match="give height and width"):
        read_capture(path, shape=(48.5, 64))
    with pytest.raises(InputError, match="leave it out"):
        read_capture(written(tmp_path, GOOD), pixel_format="Mono8")


def test_a_photograph_in_colour_may_be_an_npy_file(tmp_path):
    intensities = scene_intensities((3, 32, 40))
    files = [tmp_path / f"n_{angle}.npy" for angle in (0, 45, 90, 135)]
    for file, image in zip(files, intensities, strict=True):
        np.save(file, np.moveaxis(image, 0, -1))
    capture = read_capture(files)
    assert capture.color
    np.testing.assert_allclose(capture.intensities, intensities, atol=1e-6)


def test_a_mosaic_in_an_npy_file(tmp_path):
    raw = mono_mosaic(scene_intensities((48, 64))).astype(np.float32)
    np.save(tmp_path / "a.npy", raw)
    capture = read_capture(tmp_path / "a.npy", pair_gain=1)
    assert capture.origin.layout == "mono mosaic"
    np.testing.assert_array_equal(capture.samples.values, raw)


@pytest.mark.parametrize(("azimuth", "shown"), [(45.0, (0, 45, 0, 135)), (20.0, (0, 45, 90, 90))])
def test_one_picture_for_two_angles_is_refused_unless_they_add_up(tmp_path, azimuth, shown):
    names = [tmp_path / f"{angle:03d}.png" for angle in (0, 45, 90, 135)]
    for name, angle in zip(names, shown, strict=True):
        degree = 0.3 * np.cos(2 * np.radians(angle - azimuth)) * np.linspace(0.2, 1, 64)
        write_png(name, np.tile(np.round(60000 * (0.5 + degree)).astype(np.uint16), (64, 1)))
    if azimuth == 45:
        assert read_capture(names).shape == (64, 64)
    else:
        with pytest.raises(InputError, match="photographs 3 and 4 are the same picture"):
            read_capture(names)
