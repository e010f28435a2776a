"""An unknown black level: what it does to the layers, and why the photographs do not tell it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt import PSE, Capture, InputError, SceneParameters, align, read_capture, separate
from polaropt.capture.files.write import write_png
from polaropt.cli.app import main
from polaropt.estimation.ladder import find_scene
from polaropt.reporting.inspection import inspect_capture
from tests.blends import blend
from tests.captured import scene_intensities

PEDESTAL = 0.02


def above(capture: Capture, black: float) -> Capture:
    """The capture of a camera that adds a black level nobody knows of."""
    return Capture.of_planes(capture.intensities + np.float32(black), capture.angles_deg, capture.valid)


@given(
    st.floats(0, 89),
    st.floats(0, 360),
    st.floats(-9, 9),
    st.floats(1.0, 2.5),
    st.booleans(),
    st.floats(0, 0.1),
)
@settings(max_examples=40, deadline=None)
def test_a_lossless_pane_takes_a_black_level_for_light_in_both_layers(
    incidence: float, azimuth: float, shift: float, index: float, single: bool, black: float
) -> None:
    scene = SceneParameters(incidence, azimuth, shift, index, single_surface=single)
    layers = np.random.default_rng(0).random((2, 20, 24))
    engine = PSE(scene, (0, 45, 90, 135))
    np.testing.assert_allclose(engine.forward(layers + 2 * black), engine.forward(layers) + black, atol=1e-6)


@pytest.mark.parametrize("incidence", [40, 70])
def test_both_layers_come_out_brighter_by_twice_it(incidence: float) -> None:
    example = blend(incidence, 96)
    found, raised = (
        separate(capture, example.scene) for capture in (example.capture, above(example.capture, PEDESTAL))
    )
    added = raised.layers - found.layers
    # Nonnegative layers: where one of them was held at black its neighbours are not the same.
    assert np.median(added[0]) == pytest.approx(2 * PEDESTAL, rel=0.03)
    assert np.median(added[1]) == pytest.approx(2 * PEDESTAL, rel=0.15)


def test_the_scene_stays_the_same() -> None:
    example = blend(60, 144)
    captures = (example.capture, above(example.capture, PEDESTAL))
    found = [find_scene(capture, SceneParameters(None, None, None), 0.005).scene.values() for capture in captures]
    np.testing.assert_allclose(found[0], found[1], atol=0.15)


def dark_photographs(
    noise: float,
    shape: tuple[int, ...] = (96, 128),
    black: float = 0.0,
    angles_deg: tuple[float, ...] = (0, 45, 90, 135),
    dark_side: float = 0.4,
    bits: int | None = None,
    shot: float = 0.0,
) -> np.ndarray:
    """Photographs (k, ..., h, w) of a scene with a black corner; `black` is taken off as if it were the black level."""
    light = scene_intensities(shape, angles_deg)
    light[..., : int(dark_side * shape[-2]), : int(dark_side * shape[-1])] = 0
    spread = np.sqrt(noise**2 + shot * light)
    seen = light - black + spread * np.random.default_rng(1).standard_normal(light.shape)
    if bits is not None:
        seen = np.round(seen * (2**bits - 1)) / (2**bits - 1)
    return np.minimum(seen, 1)


@pytest.mark.parametrize("noise", [0.003, 0.005, 0.01, 0.02, 0.05])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"shape": (20, 24)},
        {"shape": (3, 256, 192)},
        {"angles_deg": (0, 60, 120)},
        {"angles_deg": (0, 36, 72, 108, 144)},
        {"dark_side": 0.15},
        {"bits": 8},
        {"bits": 6},
        {"shot": 0.001},
    ],
    ids=str,
)
def test_noise_below_black_is_noise(noise: float, options: dict) -> None:
    images = dark_photographs(noise, **options)
    capture = Capture.of_planes(images, options.get("angles_deg", (0, 45, 90, 135)))
    np.testing.assert_allclose(capture.intensities.min(), images.min(), rtol=1e-5)


@pytest.mark.parametrize(("noise", "black"), [(0.0, 0.015), (0.001, 0.1), (0.005, 0.03), (0.01, 0.015)])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"shape": (3, 256, 192)},
        {"angles_deg": (0, 60, 120)},
        {"dark_side": 0.15},
        {"bits": 8},
        {"shot": 0.001},
        {"shot": 0.01, "shape": (3, 256, 192)},
    ],
    ids=str,
)
def test_a_black_level_that_is_too_high_is_no_noise(noise: float, black: float, options: dict) -> None:
    images = dark_photographs(noise, black=black, **options)
    with pytest.raises(InputError, match=r"below -0\.0.* it is no noise: correct the black level"):
        Capture.of_planes(images, options.get("angles_deg", (0, 45, 90, 135)))


def test_dark_photographs_are_separated_and_aligned() -> None:
    example = blend(60, 128, noise=0.0)
    light = example.capture.intensities.astype(np.float64)
    light[..., :40, :40] = 0
    seen = np.minimum(light + 0.005 * np.random.default_rng(0).standard_normal(light.shape), 1)
    capture = Capture.of_planes(seen, example.capture.angles_deg)
    assert capture.intensities.min() < -0.015
    assert np.isfinite(separate(capture, example.scene).layers).all()
    moved = np.stack([np.roll(seen[k], 2 * (k == 1), axis=-1) for k in range(4)])
    assert align(Capture.of_planes(moved)).intensities.min() < -0.015


@pytest.mark.parametrize(("black", "given", "hinted"), [(0.1, 0, True), (0.1, 300, False), (0.0, 0, False)])
def test_inspect_tells_how_high_it_can_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], black: float, given: int, hinted: bool
) -> None:
    images = scene_intensities((64, 64))
    images = black + (images - images.min()) / (1 + black)
    files = [str(tmp_path / f"{k}.png") for k in range(4)]
    for path, image in zip(files, images, strict=True):
        write_png(path, np.round(np.clip(image, 0, 1) * 65535).astype(np.uint16))
    assert main(["inspect", *files, "--black-level", str(given)]) == 0
    said = capsys.readouterr().out.replace("\n", " ")
    assert ("own black level" in said) == hinted
    darkest = inspect_capture(read_capture(files, black_level=given)).darkest
    assert darkest == pytest.approx(65535 * black, abs=900)


def test_encoded_values_have_no_black_level_to_tell(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", intensities=0.2 + 0.7 * scene_intensities((32, 32)))
    assert inspect_capture(read_capture(tmp_path / "a.npz", gamma="srgb")).darkest is None
