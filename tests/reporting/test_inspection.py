"""An inspection sees what a capture is, and the usual mistakes."""

import json
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage import data

from polaropt import Capture, SceneParameters, read_capture, simulate
from polaropt.capture import EncodingHint
from polaropt.capture.checks import fit_gamma, swapped_photographs
from polaropt.capture.files.write import encode_srgb, write_png
from polaropt.numerics import turn_between
from polaropt.reporting.inspection import inspect_capture
from polaropt.reporting.pictures import aolp_colors, inspection_picture
from polaropt.reporting.words import inspection_sentences
from tests.captured import ANGLES, color_mosaic, mono_mosaic, photographed, scene_intensities

REAL = Path(__file__).parents[3] / "shared" / "data" / "real_polar"
needs_real = pytest.mark.skipif(not REAL.is_dir(), reason="the shared real captures are not here")


def scene(seed=0, noise=0.003):
    return photographed((128, 128), noise=noise, seed=seed)


def test_a_plain_capture_is_described():
    it = inspect_capture(scene())
    assert (it.width, it.height, it.channels) == (128, 128, 1)
    assert it.noise == pytest.approx(0.003, rel=0.05)
    assert it.pair_gain == pytest.approx(1, abs=2e-3)
    assert it.saturated_share == 0
    assert it.looks_encoded is False
    assert it.swapped_deg == ()
    assert it.aolp_deg == pytest.approx(20, abs=3)
    assert 0.1 < it.dolp_median < it.dolp_95 <= 1
    assert not any("ATTENTION" in sentence for sentence in inspection_sentences(it))


def test_the_report_is_plain_json():
    values = json.loads(json.dumps(inspect_capture(scene()).as_dict(), allow_nan=False))
    assert values["angles_deg"] == list(ANGLES)
    assert values["layout"] == "memory"


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("encode", "exponent"), [(encode_srgb, 2.2), (lambda v: v**2, 0.5), (lambda v: v, 1)])
def test_gamma_encoding_is_measured(seed, encode, exponent):
    images = np.clip(scene(seed).intensities, 0, 1)
    fit = fit_gamma(Capture(encode(images)))
    assert fit.certain
    # Data made darker than linear are no common mistake: measured, but not accused on one picture's evidence.
    assert fit.encoded == (exponent > 1) or exponent < 1
    assert fit.exponent == pytest.approx(exponent, rel=0.2)


def test_values_darker_than_linear_are_not_called_linear():
    images = np.clip(scene(seed=2).intensities, 0, 1) ** 1.6
    images += 0.01 * np.random.default_rng(0).standard_normal(images.shape).astype(np.float32)
    it = inspect_capture(Capture(images))
    assert it.gamma_exponent < 0.75
    assert it.looks_encoded is None
    (sentence,) = (sentence for sentence in inspection_sentences(it) if "exponent" in sentence)
    assert "cannot be told" in sentence


def test_a_gain_is_not_taken_for_gamma():
    images = scene().intensities * np.array([1, 1.03, 0.99, 1.02], dtype=np.float32).reshape(4, 1, 1)
    assert not fit_gamma(Capture(images)).encoded


def test_noise_that_sums_and_contrasts_share_looks_like_no_encoding():
    """Where both pairs are as strongly polarized nothing else makes them differ."""
    angles = np.radians([0, 45, 90, 135])[:, None, None]
    exponents = []
    for seed in range(8):
        random = np.random.default_rng(seed)
        light, contrast = (block.repeat(8, 0).repeat(8, 1) for block in random.uniform(0.1, 0.6, (2, 32, 32)))
        polarized = 1 + (0.25 + 0.1 * contrast) * np.cos(2 * angles - np.pi / 4)
        seen = light / 2 * polarized + random.normal(0, 0.01, (4, 256, 256))
        exponents.append(fit_gamma(Capture(seen.astype(np.float32))).exponent)
    assert np.mean(exponents) == pytest.approx(1, abs=0.25)


def test_noise_that_neighbours_share_is_told():
    light = np.array([0.42, 0.4, 0.38, 0.4])[:, None, None]
    white = 0.01 * np.random.default_rng(0).standard_normal((4, 128, 128))
    interpolated = sum(np.roll(white, (down, right), (-2, -1)) for down in (0, 1) for right in (0, 1)) / 2
    for noise, shared in ((white, False), (interpolated, True)):
        inspection = inspect_capture(Capture(light + noise))
        assert inspection.noise == pytest.approx(0.01, rel=0.05)
        assert inspection.slow_noise == pytest.approx(2.0 if shared else 1.0, rel=0.15)
        assert ("in common" in " ".join(inspection_sentences(inspection))) is shared


def test_unpolarized_light_tells_no_gamma():
    flat = np.repeat(scene_intensities((128, 128))[:1], 4, axis=0)
    images = flat + 0.005 * np.random.default_rng(0).standard_normal(flat.shape)
    it = inspect_capture(Capture(images))
    assert it.looks_encoded is None
    assert it.swapped_deg == ()
    assert any("cannot be told" in sentence for sentence in inspection_sentences(it))


@pytest.mark.parametrize("order", list(permutations(range(4))))
def test_swapped_photographs_are_seen_where_the_pairs_change(order):
    capture = Capture(scene().intensities[list(order)])
    found = swapped_photographs(capture)
    assert bool(found) == ({order[0], order[2]} not in ({0, 2}, {1, 3}))
    if order == (0, 2, 1, 3):
        assert (1, 2) in found
        assert any("45 and 90" in sentence for sentence in inspection_sentences(inspect_capture(capture)))


@pytest.mark.parametrize(("which", "gain"), [(0, 0.5), (2, 0.5), (1, 0.5), (3, 2.0)])
def test_a_photograph_exposed_unlike_the_others_is_not_taken_for_a_swap(which, gain):
    images = scene().intensities.copy() / 4
    images[which] *= gain
    capture = Capture(images)
    assert swapped_photographs(capture) == ()
    angle, found = min(inspect_capture(capture).uneven_gains, key=lambda told: abs(told[1] - gain))
    assert (angle, found) == (45.0 * which, pytest.approx(gain, abs=0.02))


def test_where_a_swap_and_a_gain_explain_the_same_both_are_named():
    pane = SceneParameters(62.0, 20.0, 5.0)
    images = simulate(data.astronaut()[:256, 128:384], data.coffee()[:256, :256], pane, seed=1).intensities.copy()
    images[0] *= 0.7
    sentences = inspection_sentences(inspect_capture(Capture.of_planes(images)))
    assert any("look swapped" in sentence for sentence in sentences)
    assert any("or one was exposed unlike the others" in sentence and "0.7" in sentence for sentence in sentences)


def test_with_five_angles_a_swap_is_seen():
    images = photographed((128, 128), (0, 36, 72, 108, 144), noise=0.003).intensities
    swapped = images[[0, 1, 4, 3, 2]]
    assert swapped_photographs(Capture(images, (0, 36, 72, 108, 144))) == ()
    # The other exchange that serves leaves the angles in reversed order, a mirrored scene.
    assert swapped_photographs(Capture(swapped, (0, 36, 72, 108, 144))) == ((0, 1), (2, 4))


def test_three_angles_are_described_too():
    it = inspect_capture(photographed((64, 64), (0, 60, 120)))
    assert it.pair_gain is None
    assert it.looks_encoded is None
    assert any("three angles" in sentence for sentence in inspection_sentences(it))


def test_saturation_is_counted_at_any_angle():
    capture = photographed((64, 64), exposure=1.4)
    it = inspect_capture(capture)
    assert it.saturated_share == np.mean(~capture.valid.all(axis=0)) > 0.05
    assert any("saturated" in sentence and "shorter exposure" in sentence for sentence in inspection_sentences(it))


def test_what_the_file_tells_is_told(tmp_path):
    images = scene_intensities((256, 256)) * np.array([1, 1.02, 1, 1.02]).reshape(4, 1, 1)
    write_png(tmp_path / "a.png", np.round(255 * np.clip(mono_mosaic(images), 0, 1)).astype(np.uint8))
    it = inspect_capture(read_capture(tmp_path / "a.png"))
    assert (it.layout, it.sample_type, it.grey_levels) == ("mono mosaic", "uint8", 256)
    assert it.pair_gain == pytest.approx(1.02, abs=3e-3)
    assert it.pair_gain_removed == pytest.approx(1.02, abs=3e-3)


@pytest.mark.parametrize(
    ("hint", "encoded"), [("SRGB_PNG", True), ("JPEG", True), ("SHALLOW_PNG", None), ("NONE", None)]
)
def test_the_format_decides_where_the_photographs_do_not_tell(hint, encoded):
    flat = np.repeat(scene_intensities((128, 128))[:1], 4, axis=0)
    images = flat + 0.005 * np.random.default_rng(0).standard_normal(flat.shape)
    capture = Capture(images).with_origin(encoding_hint=EncodingHint[hint])
    assert inspect_capture(capture).looks_encoded is encoded
    assert inspect_capture(capture.with_origin(gamma="srgb")).looks_encoded is None


def test_what_a_hint_decides_does_not_depend_on_its_words():
    deciding = {EncodingHint.SRGB_PNG, EncodingHint.JPEG, EncodingHint.HEIF, EncodingHint.PROFILE}
    assert {hint for hint in EncodingHint if hint.decides} == deciding
    values = inspect_capture(scene().with_origin(encoding_hint=EncodingHint.JPEG)).as_dict()
    assert json.loads(json.dumps(values))["encoding_hint"] == "JPEG files nearly always are"


@pytest.mark.parametrize(("bits", "kind"), [(8, np.uint8), (12, np.uint16), (16, np.uint16)])
def test_the_grey_levels_of_a_colour_mosaic_are_those_of_its_file(tmp_path, bits, kind):
    white = 2**bits - 1
    raw = color_mosaic(np.clip(photographed((3, 512, 512), noise=0.01).intensities, 0, 1))
    write_png(tmp_path / "a.png", np.round(white * raw).astype(kind))
    capture = read_capture(tmp_path / "a.png", white_level=white, sensor="color")
    assert inspect_capture(capture).grey_levels == white + 1


def test_a_dark_capture_asks_for_the_white_level(tmp_path):
    files = [tmp_path / f"{k}.png" for k in range(4)]
    for path, image in zip(files, scene_intensities(), strict=True):
        write_png(path, np.round(4000 * image).astype(np.uint16))
    assert any("white level" in sentence for sentence in inspection_sentences(inspect_capture(read_capture(files))))


@pytest.mark.parametrize("shape", [(16, 17), (3, 40, 50), (2, 40, 50), (40, 1300)])
def test_the_picture_fits_any_capture(shape):
    picture = inspection_picture(photographed(shape))
    assert picture.dtype == np.uint8
    assert picture.shape[2] == 3
    assert picture.shape[0] >= min(shape[-2], 16)
    assert picture.shape[1] <= 3 * 640 + 4 * 12 + 3


def test_no_text_of_the_picture_is_cut_off():
    """Titles, notes and numbers of its keys end before their panel does."""
    picture = inspection_picture(photographed((3, 40, 50)))
    panel = (picture.shape[1] - 4 * 12) // 3
    for k in range(3):
        right = (k + 1) * (panel + 12) - 1
        assert (picture[:, right : right + 2] == 255).all()


def test_angles_half_a_turn_apart_have_one_colour():
    angles = np.arange(0.0, 180.0, 5)
    np.testing.assert_array_equal(aolp_colors(angles, np.ones(36)), aolp_colors(angles + 180, np.ones(36)))
    colors = aolp_colors(angles, np.ones(36)).astype(int)
    steps = np.abs(np.diff(colors, axis=0, append=colors[:1])).sum(axis=1)
    assert steps.max() < 3 * np.median(steps)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(3, 5),
    st.sampled_from([(16, 16), (17, 40), (3, 16, 31), (1, 20, 20)]),
    st.sampled_from([0.0, 0.001, 0.3, 3.0, 300.0]),
    st.sampled_from([2, 3, 255, 4095]),
    st.integers(0, 9),
)
def test_every_capture_can_be_inspected(count, shape, exposure, levels, seed):
    images = exposure * np.random.default_rng(seed).random((count, *shape)) ** 4
    images = np.round(np.clip(images, 0, 1) * levels) / levels
    images[:, ..., 3, 3], images[:, ..., 3, 4] = 0, 0.5
    it = inspect_capture(Capture.of_planes(images, [180 * k / count for k in range(count)]))
    json.dumps(it.as_dict(), allow_nan=False)
    assert all(sentence.endswith(".") for sentence in inspection_sentences(it))
    assert it.noise > 0


@needs_real
@pytest.mark.parametrize(
    ("name", "size", "gain", "noise", "saturated", "encoded", "aolp", "dolp"),
    [
        ("lei2020_IMG_0287_mosaic16.png", (1280, 1200), 1.024, 0.0061, 0.0, False, 54, 0.13),
        ("maeda_carps_mosaic8.png", (2448, 2048), 1.020, 0.0061, 0.11, False, -13, 0.53),
        # As stored its linear polarizers reach only DoLP 0.4; with exponent 2.2 they reach 0.9, and the gain is 1.023.
        ("maeda_polarizers_mosaic8.png", (2448, 2048), 1.011, 0.0107, 0.16, True, 92, 0.05),
    ],
)
def test_real_mosaics(name, size, gain, noise, saturated, encoded, aolp, dolp):
    it = inspect_capture(read_capture(REAL / name))
    assert (it.layout, it.width, it.height) == ("mono mosaic", *size)
    assert it.pair_gain_removed == pytest.approx(gain, abs=2e-3)
    assert it.noise == pytest.approx(noise, rel=0.05)
    assert it.saturated_share == pytest.approx(saturated, abs=0.015)
    assert it.looks_encoded is encoded
    assert it.swapped_deg == ()
    assert abs(turn_between(it.aolp_deg, aolp)) < 3
    assert it.dolp_median == pytest.approx(dolp, abs=0.02)


@needs_real
def test_real_files_and_their_swap():
    files = [REAL / f"lapray_glass_nir_{angle:03d}.png" for angle in (0, 45, 90, 135)]
    it = inspect_capture(read_capture(files))
    assert it.swapped_deg == ()
    assert it.looks_encoded is False
    # Numbers of the photographs at 45 and at 90 degrees.
    assert (1, 2) in swapped_photographs(read_capture([files[0], files[2], files[1], files[3]]))
