"""Polarizers and frames."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.errors import InputError
from polaropt.optics.stokes import analyzer_matrix, dolp_aolp, frame_matrix, stokes_from_intensities, stokes_vector

RANDOM = np.random.default_rng(0)


def test_malus() -> None:
    angles = np.arange(0, 180, 7.5)
    behind = analyzer_matrix(angles) @ stokes_vector(1, 30)
    np.testing.assert_allclose(behind, np.cos(np.radians(angles - 30)) ** 2, atol=1e-15)


def test_half_of_unpolarized_light_passes() -> None:
    np.testing.assert_allclose(analyzer_matrix([0, 17, 90]) @ stokes_vector(0, 0), 0.5)


def test_orthogonal_pairs_hold_all_light() -> None:
    i0, i45, i90, i135 = analyzer_matrix([0, 45, 90, 135]) @ [0.8, 0.2, -0.3]
    assert i0 + i90 == pytest.approx(0.8)
    assert i45 + i135 == pytest.approx(0.8)


@pytest.mark.parametrize("azimuth_deg", [-20.0, 0.0, 33.0, 90.0, 200.0])
def test_frame_takes_out_what_polarizers_along_it_would_see(azimuth_deg: float) -> None:
    stokes = np.array([0.8, 0.2, -0.3])
    par, perp, _ = frame_matrix(azimuth_deg) @ stokes
    np.testing.assert_allclose([par, perp], analyzer_matrix([azimuth_deg, azimuth_deg + 90]) @ stokes, atol=1e-15)


@pytest.mark.parametrize("azimuth_deg", [0.0, 33.0, 90.0])
def test_frame_is_the_rotation_of_the_paper(azimuth_deg: float) -> None:
    double = np.radians(2 * azimuth_deg)
    local_to_camera = np.array([[1, 0, 0], [0, np.cos(double), -np.sin(double)], [0, np.sin(double), np.cos(double)]])
    local = np.array([[1, 1, 0], [1, -1, 0], [0, 0, 1]]) @ frame_matrix(azimuth_deg)
    np.testing.assert_allclose(local, local_to_camera.T, atol=1e-15)


@pytest.mark.parametrize("angles_deg", [(0, 45, 90, 135), (0, 60, 120), (3, 50, 71, 100, 170)])
def test_stokes_survive_the_photographs(angles_deg: tuple[float, ...]) -> None:
    stokes = RANDOM.random((3, 2, 5, 4))
    photographs = np.tensordot(analyzer_matrix(angles_deg), stokes, axes=1)
    np.testing.assert_allclose(stokes_from_intensities(photographs, angles_deg), stokes, atol=1e-13)


def test_four_angles_average_the_noise_as_expected() -> None:
    noise = RANDOM.standard_normal((4, 200_000))
    np.testing.assert_allclose(stokes_from_intensities(noise, (0, 45, 90, 135)).var(axis=1), [1, 2, 2], rtol=0.02)


def test_dtypes_are_kept_and_whole_numbers_become_float32() -> None:
    whole = RANDOM.integers(0, 255, (4, 6, 5), dtype=np.uint8)
    angles = (0, 45, 90, 135)
    assert stokes_from_intensities(whole.astype(np.float32), angles).dtype == np.float32
    stokes = stokes_from_intensities(whole, angles)
    assert stokes.dtype == np.float32
    np.testing.assert_allclose(stokes, stokes_from_intensities(whole.astype(np.float64), angles), atol=1e-4)


@pytest.mark.parametrize("angles_deg", [(0, 90), (0, 90, 180), (10, 55, 190)])
def test_two_different_angles_do_not_tell_the_polarization(angles_deg: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="3 different"):
        stokes_from_intensities(np.ones((len(angles_deg), 4, 4)), angles_deg)


@pytest.mark.parametrize("aolp_deg", [0.0, 20.0, 90.0, 179.0])
def test_dolp_and_aolp_are_read_back(aolp_deg: float) -> None:
    dolp, aolp = dolp_aolp(0.7 * stokes_vector(0.4, aolp_deg)[:, None])
    assert dolp[0] == pytest.approx(0.4)
    assert aolp[0] == pytest.approx(aolp_deg)


def test_dolp_and_aolp_of_darkness_and_noise() -> None:
    stokes = np.array([[0, 0, -0.01, 1e-30, 1], [0, 0.5, 0.01, 100, 1], [0, 0, 0, 0, -1e-12]], dtype=np.float32)
    dolp, aolp = dolp_aolp(stokes)
    np.testing.assert_array_equal(dolp, [0, 1, 1, 1, 1])
    assert np.all((aolp >= 0) & (aolp < 180))


def test_torch_tensors_come_back_as_tensors() -> None:
    torch = pytest.importorskip("torch")
    photographs = RANDOM.random((3, 4, 5))
    stokes = stokes_from_intensities(torch.asarray(photographs), (0, 60, 120))
    assert isinstance(stokes, torch.Tensor)
    for ours, theirs in zip(dolp_aolp(stokes), dolp_aolp(stokes.numpy()), strict=True):
        np.testing.assert_allclose(ours.numpy(), theirs, atol=1e-12)
