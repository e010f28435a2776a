"""What the samples of a mosaic tell of both layers."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import SceneParameters
from polaropt.inversion.canvas import Canvas
from polaropt.inversion.mosaic_closed_form import _Mixture
from polaropt.inversion.variance import Knowledge
from polaropt.numerics import opponent_basis
from polaropt.optics import PSE
from polaropt.simulation import Camera, photograph_mosaic, simulated_mosaic
from studies.photographs import pairs_of

NOISE = 0.003


@pytest.fixture(scope="module")
def mixture() -> _Mixture:
    scene, photographs = SceneParameters(60.0, 25.0, 4.0), pairs_of(None, 64)[0]
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, scene, Camera(noise=NOISE), False)
    capture = simulated_mosaic(raw, False)
    canvas = Canvas(*capture.shape, top=0, bottom=0, left=0, right=0)
    return _Mixture(capture.cells.samples, PSE(scene, capture.angles_deg), canvas, NOISE, opponent_basis(1))


def knowledge(mixture: _Mixture, prior: np.ndarray, noise_power: float) -> Knowledge:
    """Of layers with this power (2, alias, group)."""
    members, _ = mixture.groups.sample(prior.shape[-1])
    samples = np.zeros(prior.shape[1:], np.complex64)
    power = prior.astype(np.float32).reshape(2, 1, -1)
    told = mixture._information(members.of(mixture.transfer), samples, power, noise_power)
    return Knowledge(*told, power, np.ones(samples.size), np.ones(samples.size), np.eye(1))


@pytest.mark.parametrize("decades", [3, 20])
@pytest.mark.parametrize("noise_power", [NOISE**2, NOISE**2 / 9])
def test_what_samples_tell_is_finite_however_far_powers_of_the_layers_lie_apart(
    mixture: _Mixture, decades: int, noise_power: float
) -> None:
    """Single precision has six digits, and rounding leaves nothing of the smaller ones."""
    powers = 10 ** np.random.default_rng(0).uniform(-decades / 2, decades / 2, (2, 4, 256))
    known = knowledge(mixture, powers, noise_power)
    assert np.all((known.told >= 0) & np.isfinite(known.told))
    assert np.all((known.cross >= 0) & (known.cross <= known.told[0] * known.told[1] * (1 + 1e-5)))
    assert known.told.max() > 1e-3 / noise_power


@pytest.mark.parametrize("noise_power", [NOISE**2, NOISE**2 / 9])
def test_what_is_far_stronger_than_its_aliases_and_the_noise_is_told(mixture: _Mixture, noise_power: float) -> None:
    powers = np.full((2, 4, 256), 1e-4)
    powers[:, 0] = 50.0
    known = knowledge(mixture, powers, noise_power)
    left = (known.uncertainty() / known.prior).reshape(powers.shape)
    assert left[:, 0].max() < 0.01
    assert left[:, 1:].max() > 0.99
