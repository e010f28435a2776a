"""``polaropt calibrate`` makes what ``--analyzer`` takes: a capture by a real sensor becomes that of an ideal one."""

import json

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from polaropt import read_capture
from polaropt.capture.files.write import write_png
from polaropt.capture.mosaic import sampling_of
from polaropt.cli.app import main
from polaropt.optics import Analyzer, analyzer_matrix
from tests.captured import scene_intensities

ANGLES = (0.0, 45.0, 90.0, 135.0)
TRUE = Analyzer(ANGLES, (1.01, 0.97, 1.03, 0.99), (0.95, 0.96, 0.94, 0.955), (0.4, 44.7, 90.3, 134.6))


def photographed(stokes, analyzer=TRUE):
    """Raw mosaic of Stokes images (3, h, w) by a mono sensor."""
    light = np.tensordot(np.array(analyzer.gains)[:, None] * analyzer.matrix, stokes, axes=1)
    return sampling_of(False)[0].sample(light[:, None])


def saved(path, raw):
    write_png(path, np.round(65535 * raw).astype(np.uint16))
    return str(path)


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flats")
    files = []
    for turn in (0, 40, 85, 130, 155):
        double = 2 * np.radians(turn)
        even = 0.8 * np.array([1, np.cos(double), np.sin(double)]).reshape(3, 1, 1) * np.ones((3, 80, 96))
        files.append(saved(folder / f"flat_{turn}.png", photographed(even)))
    assert main(["calibrate", *files, "-o", str(folder / "analyzer.json"), "--sensor", "mono"]) == 0
    return folder / "analyzer.json"


def test_the_file_tells_what_was_measured(calibration):
    document = json.loads(calibration.read_text())
    assert document["contrast_and_angles_measured"] is True
    assert document["polarizer_turns"] == 5
    np.testing.assert_allclose(document["contrasts"], TRUE.contrasts, atol=1e-3)
    np.testing.assert_allclose(document["gains"], TRUE.gains, atol=1e-4)


def test_a_calibrated_capture_is_that_of_an_ideal_sensor(tmp_path, calibration):
    images = gaussian_filter(scene_intensities((128, 128)), (0, 2, 2))
    stokes = np.tensordot(np.linalg.pinv(analyzer_matrix(ANGLES)), images, axes=1)
    real = saved(tmp_path / "real.png", photographed(stokes))
    ideal = photographed(stokes, Analyzer(ANGLES, (1,) * 4, (1,) * 4, ANGLES))
    perfect = read_capture(saved(tmp_path / "ideal.png", ideal), pair_gain=1, sensor="mono")
    errors = {}
    for name, analyzer in (("without", None), ("with", calibration)):
        capture = read_capture(real, analyzer=analyzer, pair_gain=1, sensor="mono")
        errors[name] = float(np.abs(capture.samples.values - perfect.samples.values).max())
        errors[f"{name}, cells"] = float(np.abs(capture.registered.intensities - perfect.registered.intensities).max())
    assert errors["with"] < 0.1 * errors["without"]
    assert errors["with, cells"] < 0.1 * errors["without, cells"]


def test_a_field_may_lack_a_header(tmp_path):
    even = 0.6 * np.array([1, 0, 0]).reshape(3, 1, 1) * np.ones((3, 80, 96))
    values = np.round(65535 * photographed(even)).astype(np.uint16)
    (tmp_path / "flat.raw").write_bytes(values.tobytes())
    written = tmp_path / "a.json"
    options = ["--shape", "80,96", "--pixel-format", "Mono16"]
    assert main(["calibrate", str(tmp_path / "flat.raw"), "-o", str(written), *options]) == 0
    gains = np.array(TRUE.gains) / np.mean(TRUE.gains)
    np.testing.assert_allclose(json.loads(written.read_text())["gains"], gains, atol=1e-4)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--shape", "80"], "give height and width"),
        (["--shape", "81,96"], "flat.raw"),
        (["--pixel-format", "Mono16"], "give its shape too"),
    ],
)
def test_a_field_without_a_header_that_cannot_be_read_is_one_line(tmp_path, capsys, options, words):
    (tmp_path / "flat.raw").write_bytes(bytes(80 * 96 * 2))
    assert main(["calibrate", str(tmp_path / "flat.raw"), "-o", str(tmp_path / "a.json"), *options]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert words in line


def test_gains_alone_are_told_as_such(tmp_path, capsys):
    even = 0.6 * np.array([1, 0, 0]).reshape(3, 1, 1) * np.ones((3, 80, 96))
    file = saved(tmp_path / "flat.png", photographed(even))
    assert main(["calibrate", file, "-o", str(tmp_path / "a.json")]) == 0
    assert "Only the gains are told" in capsys.readouterr().out


def test_the_picture_of_a_scene_is_no_evenly_lit_field(tmp_path, capsys):
    images = scene_intensities((128, 128))
    stokes = np.tensordot(np.linalg.pinv(analyzer_matrix(ANGLES)), images, axes=1)
    assert main(["calibrate", saved(tmp_path / "scene.png", photographed(stokes)), "-o", str(tmp_path / "a.json")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "scene.png: is no evenly lit field" in line
    assert not (tmp_path / "a.json").exists()


def test_a_field_may_fall_off_towards_its_corners_and_one_side(tmp_path):
    y, x = np.mgrid[-1:1:160j, -1:1:192j]
    light = 0.8 * (1 + 0.2 * x) / (1 + 0.3 * (x**2 + y**2)) ** 2
    file = saved(tmp_path / "flat.png", photographed(light * np.array([1, 0, 0]).reshape(3, 1, 1)))
    assert main(["calibrate", file, "-o", str(tmp_path / "a.json"), "--sensor", "mono"]) == 0
    gains = np.array(TRUE.gains) / np.mean(TRUE.gains)
    np.testing.assert_allclose(json.loads((tmp_path / "a.json").read_text())["gains"], gains, atol=3e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "is no calibration"),
        ("no json", "is no calibration"),
        (None, "no such file"),
        ("[" * 9999, "is no calibration"),
    ],
)
def test_a_file_that_is_no_calibration_is_one_line(tmp_path, capsys, text, words):
    raw = saved(tmp_path / "a.png", photographed(0.5 * np.ones((3, 64, 64)) * np.array([1, 0, 0]).reshape(3, 1, 1)))
    if text is not None:
        (tmp_path / "a.json").write_text(text)
    assert main(["inspect", raw, "--analyzer", str(tmp_path / "a.json")]) == 2
    assert words in capsys.readouterr().err


def test_a_field_that_is_clipped_or_dark_is_one_line_and_nothing_is_written(tmp_path, capsys):
    file = saved(tmp_path / "flat.png", np.ones((80, 96)))
    assert main(["calibrate", file, "-o", str(tmp_path / "a.json")]) == 2
    assert "is clipped" in capsys.readouterr().err
    assert not (tmp_path / "a.json").exists()
