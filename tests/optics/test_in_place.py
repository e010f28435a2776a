"""A pane whose images all lie in place, and distances beyond the frame."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.optics.plate import in_place_correction
from polaropt.optics.shift import _split


@pytest.mark.parametrize("incidence_deg", [20.0, 45.0, 80.0])
def test_what_polarized_light_tells_of_a_surface_is_what_it_mirrors(incidence_deg: float) -> None:
    """Its s1 is the reflection times half the difference of Fresnel's reflectances, its intensity half their sum."""
    incidence, refracted = np.radians(incidence_deg), np.arcsin(np.sin(np.radians(incidence_deg)) / 1.5)
    perp = (np.sin(incidence - refracted) / np.sin(incidence + refracted)) ** 2
    par = (np.tan(incidence - refracted) / np.tan(incidence + refracted)) ** 2
    assert in_place_correction(incidence_deg, 1.5, True) == pytest.approx((perp + par) / (perp - par))


@pytest.mark.parametrize(("distance", "parts"), [
    (2.25, (2, 0.25)), (-2.25, (-3, 0.75)), (9.0, (9, 0.0)), (9.5, (9, 0.0)), (1e9, (9, 0.0)), (-1e9, (-9, 0.0)),
])  # fmt: skip
def test_from_the_frame_s_end_on_every_pixel_shows_its_edge(distance: float, parts: tuple[int, float]) -> None:
    assert _split(distance, 10) == parts
