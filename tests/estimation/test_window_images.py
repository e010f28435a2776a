"""Images of windows, and the lags between them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from polaropt.estimation.flat.windows.images import Kind, kind_lags
from polaropt.optics import SceneParameters, orders_of_windows, window_orders


@pytest.mark.parametrize("n_panes", [1, 2, 3])
def test_many_windows_at_once_have_the_images_of_each(n_panes: int) -> None:
    incidences, absorptions = np.array([12.0, 45.0, 84.0]), np.array([0.0, 0.7, 0.2])
    found = orders_of_windows(incidences, absorptions, n_panes, 1.52, 20)
    for k, (incidence, absorption) in enumerate(zip(incidences.tolist(), absorptions.tolist(), strict=True)):
        scene = SceneParameters(incidence, 0.0, 1.0, 1.52, n_panes=n_panes, gap_shift=1.0, absorption=absorption)
        np.testing.assert_allclose(found[..., k], window_orders(scene, incidence, 20)[..., :2], atol=1e-12)


def test_kinds_come_out_the_same_alone_and_beside_others() -> None:
    kinds = [
        Kind(angle, n, dark, index) for angle, n, dark, index in product((33.333, 71.0), (1, 2), (0.0, 0.3), (1.4, 1.7))
    ]
    together = kind_lags(kinds)
    for kind, beside in zip(kinds, together, strict=True):
        near = kind._replace(incidence_deg=kind.incidence_deg + 1e-12)
        (alone,) = kind_lags([near])
        np.testing.assert_array_equal(alone.orders, beside.orders)
        np.testing.assert_allclose(alone.weights, beside.weights, atol=1e-6)
