"""The pane in the Fourier domain is the engine on periodic images."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import PSE, SceneParameters
from polaropt.inversion.transfer import bilinear_transfer, ghost_transfer_at, plate_transfer
from polaropt.numerics.spectrum import frequencies

SCENES = [
    SceneParameters(60, 33, 2.3),
    SceneParameters(40, 200, -3.0, n_bounces=2),
    SceneParameters(75, 90, 1.5, n_bounces=4, reflection_polarization=(0.4, 20)),
    SceneParameters(53, 10, 5.0, 1.33, single_surface=True),
    SceneParameters(60, 10, 0.0),
    SceneParameters(75, 33, 2.3, n_bounces=3, transmission_ghost_shift=-1.2),
    SceneParameters(70, 33, 0.0, n_bounces=3, transmission_ghost_shift=1.7, transmission_polarization=(0.4, 20)),
]


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(("height", "width"), [(8, 10), (9, 7)])
def test_transfer_equals_the_engine_on_periodic_content(scene: SceneParameters, height: int, width: int) -> None:
    layers = np.random.default_rng(0).random((2, height, width))
    pse = PSE(scene, (0, 45, 90, 135))
    transfer = plate_transfer(pse, height, width)
    assert transfer.dtype == np.complex64
    assert transfer.shape == (pse.taps.shape[2], 2, height, width // 2 + 1)
    filtered = np.fft.irfft2((transfer * np.fft.rfft2(layers)).sum(axis=1), (height, width))
    # The middle one of several periods does not see where the frame ends.
    periodic = pse.entries(np.tile(layers, (1, 9, 9)))
    middle = periodic[:, 4 * height : 5 * height, 4 * width : 5 * width]
    np.testing.assert_allclose(filtered, middle, atol=1e-5)


@pytest.mark.parametrize("scene", SCENES)
def test_a_sample_of_the_frequencies_is_transferred_alike(scene: SceneParameters) -> None:
    pse = PSE(scene, (0, 45, 90, 135))
    sample = np.array([0, 3, 17, 40])
    transfer = plate_transfer(pse, 9, 10)
    at = ghost_transfer_at(pse.taps, pse.displacements, (9, 10), sample)
    np.testing.assert_allclose(at, transfer.reshape(*transfer.shape[:2], -1)[..., sample], atol=1e-6)


def test_a_constant_passes_with_the_energy_of_the_pane() -> None:
    transfer = plate_transfer(PSE(SceneParameters(65, 20, 3.3), (0, 60, 120)), 16, 16)
    np.testing.assert_allclose(transfer[:, :, 0, 0].sum(axis=1), 0.5, atol=1e-6)


def test_a_whole_shift_is_a_phase() -> None:
    _, columns = frequencies(4, 12)
    np.testing.assert_allclose(np.abs(bilinear_transfer(-3.0, columns)), 1)
    assert np.abs(bilinear_transfer(2.5, columns)).min() == pytest.approx(0, abs=1e-12)
