"""One interface: Fresnel's formulas as physical facts."""

from __future__ import annotations

import cmath
import math

import pytest

from polaropt.optics.fresnel import amplitudes, brewster_angle_deg, interface, refraction_angle

ANGLES = (0.0, 10.0, 35.0, 56.0, 60.0, 75.0, 85.0, 89.9)
INDICES = (1.0, 1.33, 1.5, 2.4)


def textbook_amplitudes(incidence: float, before: float, after: float) -> tuple[float, float]:
    """r_p and r_s between two media, from Snell's law, sines and cosines."""
    refracted = cmath.asin(before * math.sin(incidence) / after)
    cos_i, cos_t = math.cos(incidence), cmath.cos(refracted)
    r_s = (before * cos_i - after * cos_t) / (before * cos_i + after * cos_t)
    r_p = (after * cos_i - before * cos_t) / (after * cos_i + before * cos_t)
    return r_p.real, r_s.real


@pytest.mark.parametrize("incidence_deg", ANGLES)
@pytest.mark.parametrize("index", INDICES)
def test_amplitudes_follow_the_textbook(incidence_deg: float, index: float) -> None:
    expected = textbook_amplitudes(math.radians(incidence_deg), 1.0, index)
    assert amplitudes(incidence_deg, index) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("incidence_deg", ANGLES)
@pytest.mark.parametrize("index", INDICES)
def test_reflection_from_inside_equals_that_from_outside(incidence_deg: float, index: float) -> None:
    inside = refraction_angle(incidence_deg, index)
    r_p, r_s = textbook_amplitudes(inside, index, 1.0)
    assert (r_p**2, r_s**2, r_p * r_s) == pytest.approx(interface(incidence_deg, index).reflection, abs=1e-10)


@pytest.mark.parametrize("index", INDICES[1:])
def test_brewster_angle_extinguishes_the_parallel_reflection(index: float) -> None:
    brewster = brewster_angle_deg(index)
    assert interface(brewster, index).reflection[0] == pytest.approx(0, abs=1e-30)
    # There the reflected and the refracted ray are at right angles.
    assert brewster + math.degrees(refraction_angle(brewster, index)) == pytest.approx(90)


def test_third_entry_changes_sign_at_brewster() -> None:
    brewster = brewster_angle_deg(1.5)
    assert interface(brewster - 1, 1.5).reflection[2] < 0 < interface(brewster + 1, 1.5).reflection[2]


@pytest.mark.parametrize("incidence_deg", ANGLES)
@pytest.mark.parametrize("index", INDICES)
def test_an_interface_loses_no_light(incidence_deg: float, index: float) -> None:
    reflection, transmission = interface(incidence_deg, index)
    for entry in (0, 1):
        assert reflection[entry] + transmission[entry] == pytest.approx(1, abs=1e-13)
    assert transmission[2] == pytest.approx(math.sqrt(transmission[0] * transmission[1]))


def test_normal_incidence_reflects_four_percent_of_both() -> None:
    reflection, _ = interface(0, 1.5)
    assert reflection == pytest.approx((0.04, 0.04, -0.04))


@pytest.mark.parametrize("incidence_deg", [0.0, 45.0, 89.9, 89.9999999, 89.99999999999999])
def test_index_one_is_no_interface(incidence_deg: float) -> None:
    reflection, transmission = interface(incidence_deg, 1.0)
    assert reflection == pytest.approx((0, 0, 0), abs=1e-30)
    assert transmission == pytest.approx((1, 1, 1))


def test_grazing_incidence_reflects_everything_without_dividing_by_zero() -> None:
    reflection, transmission = interface(89.99999999999999, 1.5)
    assert reflection[:2] == pytest.approx((1, 1))
    assert all(0 < entry < 1e-14 for entry in transmission)
