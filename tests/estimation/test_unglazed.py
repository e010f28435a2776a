"""Places that show no glass are found, left out and told; without them nothing is."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter

from polaropt import Capture, SceneParameters, estimate, separate
from polaropt.capture import ANGLES_DEG, measured_noise
from polaropt.capture.files.write import write_capture
from polaropt.cli.app import main
from polaropt.estimation import estimate_scene, surely_unglazed, unglazed_pixels
from polaropt.numerics import turn_between
from polaropt.separation import scene_case
from polaropt.simulation import psnr_db, simulated_mosaic
from studies.camera import photograph
from studies.photographs import pairs_of
from studies.scenes import Taking
from tests.captured import mono_mosaic

SIDE_PX, NOISE, FRAME_PX = 192, 0.004, 32
# Of one clear pane.
BLIND = SceneParameters(None, None, None)


@dataclass(frozen=True)
class Framed:
    """A capture of a pane in a frame that is no glass, its layers, and where the frame is."""

    capture: Capture
    scene: SceneParameters
    layers: NDArray[np.float32]
    frame: NDArray[np.bool_]

    @property
    def glass(self) -> NDArray[np.bool_]:
        """Away from the frame."""
        return np.asarray(binary_erosion(~self.frame, iterations=6, border_value=1))

    def found(self) -> NDArray[np.bool_] | None:
        return unglazed_pixels(self.capture, *measured_noise(self.capture))


@cache
def framed(
    incidence_deg: float = 60.0, shift_px: float = 0.0, frame_px: int = FRAME_PX, degree: float = 0.0, pair: int = 0
) -> Framed:
    """Photographs that ship, and on three sides what is beside the pane, polarized by a degree along 20 degrees."""
    scene = SceneParameters(incidence_deg, 70.0, shift_px)
    sample = photograph(pairs_of(None, SIDE_PX)[pair], scene, Taking(noise=0.0, bits=16, below_white=True))
    random = np.random.default_rng(3)
    wall = np.flip(sample.layers[0], axis=-1) / 2
    frame = np.ones((SIDE_PX, SIDE_PX), dtype=np.bool_)
    frame[frame_px:, frame_px : SIDE_PX - frame_px] = frame_px == 0
    frame &= frame_px > 0
    polarized = 1 + degree * np.cos(2 * np.radians(np.subtract(ANGLES_DEG, 20.0)))
    photographs = sample.capture.intensities.astype(np.float64)
    photographs[..., frame] = np.multiply.outer(polarized, wall[:, frame])
    photographs += NOISE * random.standard_normal(photographs.shape)
    capture = Capture.of_planes(photographs.astype(np.float32), ANGLES_DEG)
    return Framed(capture, scene, np.asarray(sample.layers, dtype=np.float32), frame)


@pytest.mark.parametrize("incidence_deg", [40.0, 60.0, 75.0])
@pytest.mark.parametrize("degree", [0.0, 0.008])
def test_a_frame_is_found_as_far_as_it_reaches(incidence_deg: float, degree: float) -> None:
    made = framed(incidence_deg, degree=degree)
    found = made.found()
    assert found is not None
    assert np.mean(found[made.frame]) > 0.9
    assert np.mean(found[made.glass]) < 0.02


@pytest.mark.parametrize("incidence_deg", [10.0, 20.0, 30.0, 45.0, 60.0, 80.0])
@pytest.mark.parametrize("pair", [0, 1])
def test_glass_is_not_taken_for_none(incidence_deg: float, pair: int) -> None:
    assert framed(incidence_deg, frame_px=0, pair=pair).found() is None


def test_a_thing_of_a_few_pixels_tells_nothing() -> None:
    made = framed(frame_px=0)
    photographs = made.capture.intensities.copy()
    photographs[..., 80:92, 80:92] = 0.2
    capture = made.capture.replace(intensities=photographs)
    assert unglazed_pixels(capture, *measured_noise(capture)) is None
    small = capture.part(slice(0, 16), slice(0, 16))
    assert unglazed_pixels(small, NOISE, measured_noise(capture)[1]) is None


@pytest.mark.parametrize("shift_px", [0.0, 5.0])
def test_the_pane_is_found_in_its_frame(shift_px: float) -> None:
    """Which pulled the incidence to that of a pane that mirrors less, or exchanged both layers, in silence."""
    made = framed(60.0, shift_px)
    found, whole = estimate(made.capture, BLIND).scene, estimate_scene(made.capture, BLIND, noise=NOISE).scene
    assert found.incidence_deg == pytest.approx(60, abs=1)
    assert abs(turn_between(found.values()[1], 70.0)) < 1
    assert abs(found.ghost_shift or 0.0) == pytest.approx(shift_px, abs=0.5)
    assert abs(whole.values()[0] - 60) > 3


def test_what_is_seen_beside_the_pane_is_seen_directly() -> None:
    made = framed()
    result = separate(made.capture, made.scene.replace(incidence_deg=None))
    unglazed = result.unglazed
    assert unglazed is not None
    light = made.capture.stokes[0]
    np.testing.assert_array_equal(result.layers[0][:, unglazed], light[:, unglazed])
    assert not result.layers[1][:, unglazed].any()
    behind, mirrored = result.components
    assert not mirrored[..., unglazed].any()
    np.testing.assert_array_equal(behind[..., unglazed], made.capture.intensities[..., unglazed])
    assert not result.uncertainty[1][:, unglazed].any()
    assert result.uncertainty[0][:, unglazed] == pytest.approx(NOISE, rel=0.1)
    assert (result.reflection_known[unglazed] == 1).all()
    told = separate(made.capture, made.scene, leave_out_unglazed=False)
    for layer, lost_db in enumerate((1, 3)):
        blind, known = (
            psnr_db(np.where(made.glass, of.layers[layer], 0), made.glass * made.layers[layer]) for of in (result, told)
        )
        assert blind > known - lost_db


def test_close_to_normal_incidence_glass_and_none_hardly_differ() -> None:
    where = np.zeros((40, 40), dtype=np.bool_)
    where[:, :10] = True
    flat = SceneParameters(15.0, 0.0, 0.0)
    assert surely_unglazed(where, flat) is None
    assert surely_unglazed(where, flat.replace(signal=False, incidence_deg=60.0)) is None
    np.testing.assert_array_equal(surely_unglazed(where, flat.replace(incidence_deg=60.0)), where)
    large = np.kron(where, np.ones((32, 32), dtype=np.bool_))
    np.testing.assert_array_equal(surely_unglazed(large, flat.replace(incidence_deg=60.0)), large)
    # Before a wide lens one side of the frame is seen steeply, the other frontally.
    where[:, -10:] = True
    wide = surely_unglazed(where, SceneParameters(30.0, 0.0, 0.0, focal_px=25.0))
    assert wide is not None
    assert wide.any(axis=0).sum() == 10


@pytest.mark.parametrize(("resolution", "each"), [("sensor", 1), ("cell", 2)])
def test_a_frame_is_found_by_the_cells_of_a_mosaic(resolution: str, each: int) -> None:
    made = framed(65.0)
    raw = mono_mosaic(gaussian_filter(made.capture.intensities.mean(axis=1), (0, 0.7, 0.7)))
    capture = simulated_mosaic(raw.astype(np.float32), color=False, resolution=resolution)
    case = scene_case(capture, made.scene.replace(incidence_deg=None))
    assert case.unglazed is not None
    assert case.unglazed.shape == (SIDE_PX // each, SIDE_PX // each)
    assert np.mean(case.unglazed[made.frame[::each, ::each]]) > 0.8
    assert case.found.scene.incidence_deg == pytest.approx(65, abs=1.5)


def test_of_a_mosaic_samples_and_cells_are_left_out_alike() -> None:
    raw = np.random.default_rng(0).uniform(0.2, 0.8, (32, 32)).astype(np.float32)
    where = np.zeros((32, 32), dtype=np.bool_)
    where[8:20, 8:21] = True
    capture = simulated_mosaic(raw, color=False).left_out(where)
    assert capture.samples is not None
    assert capture.cells is not None
    assert not capture.samples.valid[where].any()
    assert capture.samples.valid[~where].all()
    assert not capture.valid[..., where].any()
    assert not capture.registered.valid[:, 4:10, 4:11].any()
    np.testing.assert_array_equal(capture.cells.samples.valid, capture.samples.valid)


@pytest.mark.parametrize(("color", "each"), [(False, 2), (True, 4)])
def test_all_samples_of_a_cell_that_is_left_out_are(color: bool, each: int) -> None:
    raw = np.random.default_rng(0).uniform(0.2, 0.8, (64, 64)).astype(np.float32)
    capture = simulated_mosaic(raw, color, resolution="cell")
    where = np.zeros(capture.shape[-2:], dtype=np.bool_)
    where[3:7, 4:9] = True
    left = capture.left_out(where)
    assert left.cells is not None
    np.testing.assert_array_equal(~left.cells.samples.valid, np.kron(where, np.ones((each, each), np.bool_)))
    assert not left.registered.valid[..., where].any()


def test_the_command_says_so_and_can_be_told_not_to(tmp_path, capsys) -> None:
    made = framed()
    files = [str(path) for path in write_capture(made.capture, tmp_path / "framed.png")]
    # Told: what is left out hangs on no search.
    pane = ["--incidence", "60", "--azimuth", "70", "--shift", "0"]
    assert main(["estimate", *files, *pane, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unglazed_share"] == pytest.approx(made.frame.mean(), abs=0.05)
    assert main(["inspect", *files, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["unglazed_share"] == pytest.approx(made.frame.mean(), abs=0.05)
    assert any("look as if they showed no glass" in sentence for sentence in facts["sentences"])
    files += pane
    assert main(["estimate", *files, "--no-unglazed"]) == 0
    assert "show no glass" not in capsys.readouterr().out
    folder = tmp_path / "layers"
    assert main(["separate", *files, "-o", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "show no glass, and were left out" in said
    assert "unglazed.png" in said
    assert (folder / "unglazed.png").exists()
    assert "What shows no glass" in (folder / "report.html").read_text(encoding="utf-8")
    assert json.loads((folder / "report.json").read_text(encoding="utf-8"))["unglazed_share"] > 0.3
