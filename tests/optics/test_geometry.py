"""Incidence and azimuth at a pixel are those of the ray and the normal there, as vectors have them."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.optics.geometry import (
    bent_normal,
    incidence_trace,
    largest_turn,
    pixel_grid,
    plane_normal,
    viewing_angles,
)

FOCAL_PX = 300.0
NORMALS = [plane_normal(incidence, azimuth) for incidence in (5.0, 40.0, 75.0) for azimuth in (-70.0, 20.0, 130.0)]
PIXELS = [(0.0, 0.0), (120.0, -80.0), (-250.0, 40.0)]


@pytest.mark.parametrize("normal", NORMALS)
@pytest.mark.parametrize("pixel", PIXELS)
@pytest.mark.parametrize("vergence", [0.0, 1 / FOCAL_PX])
def test_angles_are_those_of_vectors(normal, pixel, vergence):
    x, y = pixel
    ray = np.array([x * vergence, y * vergence, 1.0])
    ray /= np.linalg.norm(ray)
    of_length = 1.7 * np.array(normal)
    cosine, cos_twice, sin_twice = viewing_angles(tuple(of_length), vergence, x, y)
    assert cosine == pytest.approx(abs(np.array(normal) @ ray), abs=1e-12)
    across = of_length - (of_length @ ray) * ray
    azimuth = np.arctan2(across[1], across[0])
    assert (cos_twice, sin_twice) == pytest.approx((np.cos(2 * azimuth), np.sin(2 * azimuth)), abs=1e-6)
    assert incidence_trace(tuple(of_length), vergence, x, y) == pytest.approx(across[:2], abs=1e-12)


def test_the_middle_s_normal_has_its_incidence_and_azimuth():
    assert plane_normal(60.0, 90.0) == pytest.approx((0, np.sqrt(3) / 2, 0.5))
    assert plane_normal(30.0, 180.0) == pytest.approx((-0.5, 0, np.sqrt(3) / 2))


def test_a_bend_is_the_gradient_of_the_surface_s_inverse_depth():
    bend, normal, vergence = (2e-4, -3e-4, 5e-4), NORMALS[4], 1 / FOCAL_PX

    def inverse_depth(x: float, y: float) -> float:
        bulge = bend[0] * x**2 + 2 * bend[1] * x * y + bend[2] * y**2
        return normal[2] + (normal[0] * x + normal[1] * y + bulge / 2) * vergence

    x, y, step = 90.0, -60.0, 1e-3
    along = [
        inverse_depth(x + step, y) - inverse_depth(x - step, y),
        inverse_depth(x, y + step) - inverse_depth(x, y - step),
    ]
    slope = np.array(along) / (2 * step) / vergence
    bent = np.array(bent_normal(normal, bend, vergence, x, y))
    np.testing.assert_allclose(bent[:2], slope, rtol=1e-6)
    # The plane that touches the surface there has its depth there.
    assert bent[2] + (bent[0] * x + bent[1] * y) * vergence == pytest.approx(inverse_depth(x, y))


def test_the_largest_turn_is_that_of_the_direction_that_turns_most():
    bend = (2e-4, -3e-4, 5e-4)
    directions = np.radians(np.arange(0, 180, 0.1))
    across, up = np.cos(directions), np.sin(directions)
    turns = np.hypot(bend[0] * across + bend[1] * up, bend[1] * across + bend[2] * up)
    assert largest_turn(bend) == pytest.approx(turns.max(), rel=1e-4)


def test_pixels_count_from_the_principal_point_right_and_up():
    x, y = pixel_grid(3, 4, (1.0, 2.0))
    assert x.tolist() == [[-1, 0, 1, 2]]
    assert y.tolist() == [[2], [1], [0]]
