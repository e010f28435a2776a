"""Closed forms where the pane varies over the frame."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.capture.capture import Capture
from polaropt.inversion.canvas import canvas_for
from polaropt.inversion.varying_closed_form import ghost_layers, varying_layers
from polaropt.optics.engine import VaryingPSE
from polaropt.optics.scene import SceneParameters

ANGLES = (0.0, 45.0, 90.0, 135.0)


@pytest.mark.parametrize(("form", "shift"), [(varying_layers, 0.0), (ghost_layers, 3.0)])
@pytest.mark.parametrize("brightness", [1.0, 20.0])
def test_a_bright_sky_in_water_keeps_its_level(form, shift, brightness):
    # Water mirrors some hundredths of the light: the sky in it is far brighter than all that is seen.
    noise = 0.005
    scene = SceneParameters(52, 100, shift, 1.33, single_surface=not shift, focal_px=90.0)
    pse = VaryingPSE(scene, ANGLES)
    random = np.random.default_rng(3)
    layers = np.stack([0.2 + 0.2 * random.random((1, 64, 72)), brightness * (0.5 + 0.2 * random.random((1, 64, 72)))])
    photographs = pse.forward(layers.astype(np.float32))
    photographs += noise * random.standard_normal(photographs.shape, dtype=np.float32)
    canvas = canvas_for(pse, 64, 72)
    capture = Capture.of_planes(photographs, ANGLES, np.ones(photographs.shape, dtype=bool))
    found = canvas.crop(form(capture, pse, canvas, noise).layers)
    np.testing.assert_allclose(found.mean(axis=(-1, -2)), layers.mean(axis=(-1, -2)), rtol=0.03)
