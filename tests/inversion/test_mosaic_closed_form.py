"""What the samples of a mosaic tell of both layers."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import SceneParameters
from polaropt.inversion.canvas import Canvas
from polaropt.inversion.mosaic_closed_form import _Mixture
from polaropt.numerics import opponent_basis
from polaropt.optics import PSE
from polaropt.simulation import Camera, photograph_mosaic, simulated_mosaic
from studies.photographs import pairs_of

NOISE = 0.003


@pytest.mark.parametrize("decades", [3, 20])
def test_what_samples_tell_is_finite_however_far_powers_of_the_layers_lie_apart(decades: int) -> None:
    """Single precision has six digits, and rounding leaves nothing of the smaller ones."""
    scene, photographs = SceneParameters(60.0, 25.0, 4.0), pairs_of(None, 64)[0]
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, scene, Camera(noise=NOISE), False)
    capture = simulated_mosaic(raw, False)
    canvas = Canvas(*capture.shape, top=0, bottom=0, left=0, right=0)
    mixture = _Mixture(capture.cells.samples, PSE(scene, capture.angles_deg), canvas, NOISE, opponent_basis(1))
    members, _ = mixture.groups.sample(256)
    transfer = members.of(mixture.transfer)
    samples = np.zeros(transfer.shape[-2:], np.complex64)
    prior = 10 ** np.random.default_rng(0).uniform(-decades / 2, decades / 2, (2, 1, samples.size)).astype(np.float32)
    for noise_power in (NOISE**2, NOISE**2 / 9):
        told, cross = mixture._information(transfer, samples, prior, noise_power)
        assert np.all((told >= 0) & np.isfinite(told))
        assert np.all((cross >= 0) & (cross <= told[0] * told[1] * (1 + 1e-5)))
        assert told.max() > 1e-3 / noise_power
