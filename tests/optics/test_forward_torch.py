"""The engine on torch tensors: the same values, exact derivatives, on their own device."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import PSE, SceneParameters
from tests.bounces import SCENES

torch = pytest.importorskip("torch")

ANGLES = (0.0, 45.0, 90.0, 135.0)
RANDOM = np.random.default_rng(1)
TORCH_SCENES = [scene for scene, _ in SCENES]


@pytest.mark.parametrize("scene", TORCH_SCENES)
def test_torch_tensors_give_what_arrays_give(scene: SceneParameters) -> None:
    pse = PSE(scene, ANGLES)
    layers, light, photographs = RANDOM.random((2, 3, 8, 9)), RANDOM.random((2, 3, 8, 9)), RANDOM.random((4, 8, 9))
    for function, x in ((pse.forward, layers), (pse.forward_stokes, light), (pse.adjoint, photographs)):
        found = function(torch.asarray(x))
        assert found.dtype == torch.float64
        np.testing.assert_allclose(found.numpy(), function(x), atol=1e-13)
        assert function(torch.asarray(x, dtype=torch.float32)).dtype == torch.float32


@pytest.mark.parametrize("scene", TORCH_SCENES)
def test_torch_differentiates_the_engine(scene: SceneParameters) -> None:
    pse = PSE(scene, ANGLES)
    layers = torch.rand((2, 5, 6), dtype=torch.float64, requires_grad=True)
    photographs = torch.rand((4, 5, 6), dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(pse.forward(layers), layers, photographs)
    torch.testing.assert_close(gradient, pse.adjoint(photographs))
    (gradient,) = torch.autograd.grad(pse.adjoint(photographs), photographs, layers)
    torch.testing.assert_close(gradient, pse.forward(layers))
    light = torch.rand((2, 3, 3, 2), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(pse.forward_stokes, (light,))


def test_torch_tensors_stay_on_their_device() -> None:
    pse = PSE(SceneParameters(60, 33, 1.7, reflection_polarization=(0.2, 10)), ANGLES)
    # Tensors on "meta" hold nothing, and refuse to meet those of any other device.
    for function, shape in ((pse.forward, (2, 3, 8, 9)), (pse.forward_stokes, (2, 3, 8, 9)), (pse.adjoint, (4, 8, 9))):
        assert function(torch.empty(shape, device="meta")).device.type == "meta"
