"""Exposures that photographs differ in: found as they do not add up, divided out, and told."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt import Capture, SceneParameters, Separation, SeparationWarning, separate, simulate
from polaropt.capture import Mistakes, find_mistakes
from polaropt.estimation import uneven_exposures
from polaropt.estimation.exposures import _seen
from polaropt.reporting import matching_report, matching_sentences
from polaropt.simulation.metrics import psnr_db

ANGLES = (0.0, 45.0, 90.0, 135.0)
EXPOSURES = (1.025, 1.0, 0.985, 0.992)
NOISE = 0.004
PANE = SceneParameters(40.0, 25.0, 5.0)
BLIND = SceneParameters(None, None, None)


@cache
def pictures() -> tuple[np.ndarray, np.ndarray]:
    from skimage import data

    return data.coffee()[60:316, 140:396] / 255, data.astronaut()[:256, 100:356] / 255


@cache
def taken(
    exposures: tuple[float, ...] = EXPOSURES, scene: SceneParameters = PANE, angles: tuple[float, ...] = ANGLES
) -> Capture:
    """Photographs with noise, behind a filter at some angles; up to four are told to be the usual ones."""
    clean = simulate(*pictures(), scene, angles_deg=angles, bits=None, noise=0.0)
    seen = 0.8 * np.array(exposures, np.float32)[:, None, None, None] * clean.intensities
    noise = np.random.default_rng(3).normal(0, NOISE, seen.shape)
    told = ANGLES[: len(angles)] if len(angles) <= len(ANGLES) else angles
    return Capture.of_planes((seen + noise).astype(np.float32), told)


@cache
def separated(exposures: tuple[float, ...], match: bool = True) -> Separation:
    return separate(taken(exposures), match_photographs=match)


WHITE_BALANCES = np.array([[1.03, 1.0, 0.98], [0.99, 1.0, 1.015], [1.01, 1.0, 0.985], [0.98, 1.0, 1.01]])


@cache
def balanced_anew(strength: float = 1.0) -> Capture:
    """Photographs of unlike exposures whose colours are in proportions of their own."""
    alike = taken((1.0,) * 4, SceneParameters(55.0, 25.0, 5.0))
    return Capture.of_planes(balanced(strength)[:, :, None, None] * alike.intensities, ANGLES)


def balanced(strength: float) -> np.ndarray:
    """Factors of photographs and colours."""
    return np.asarray((np.array(EXPOSURES)[:, None] * WHITE_BALANCES) ** strength, np.float32)


def relative(exposures: tuple[float, ...]) -> np.ndarray:
    logarithms = np.log(exposures)
    return np.exp(logarithms - logarithms.mean())


def quality(result: Separation) -> list[float]:
    """Of both layers, which an exposure of all leaves open."""
    truth = 0.8 * np.exp(np.log(EXPOSURES).mean()) * np.stack([np.moveaxis(picture, -1, 0) for picture in pictures()])
    return [psnr_db(layer, of, 16) for layer, of in zip(result.layers, truth, strict=True)]


def test_they_are_found_divided_out_and_told() -> None:
    result = separated(EXPOSURES)
    assert result.matching is not None
    np.testing.assert_allclose(result.matching.exposures, relative(EXPOSURES), atol=3e-3)
    (sentence,) = matching_sentences(matching_report(result.matching))
    assert sentence.startswith("The photographs were brought to one exposure, of which they had 1, 0.9")
    assert sentence.endswith(" times the first one's.")


def test_layers_and_pane_gain_by_it() -> None:
    uneven, left = separated(EXPOSURES), separated(EXPOSURES, match=False)
    (transmission, reflection), before = quality(uneven), quality(left)
    assert transmission > before[0] + 3
    assert reflection > before[1] + 3
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN in left.diagnostics.warnings
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN not in uneven.diagnostics.warnings
    assert abs(uneven.scene.incidence_deg - 40) < 2 * uneven.errors.incidence_deg
    # What cannot be known of exposures makes the incidence less certain than that of photographs that were alike.
    assert uneven.errors.incidence_deg > separated((1.0,) * 4).errors.incidence_deg


@pytest.mark.parametrize(
    "capture",
    [
        lambda: taken((1.0,) * 4),
        lambda: taken((1.0,) * 4, angles=(0.0, 46.0, 88.5, 136.0)),
        lambda: taken((1.0,) * 4, PANE.replace(transmission_polarization=(0.4, 70.0))),
        lambda: taken((1.0,) * 4, PANE.replace(focal_px=300.0)),
        lambda: taken((1.02, 0.985, 0.995), angles=(0.0, 60.0, 120.0)),
        lambda: taken().with_origin(exposures=(1.0,) * 4, exposures_given=True),
    ],
    ids=["alike", "angles off", "polarized", "wide lens", "three angles", "told"],
)
def test_none_are_found_where_photographs_add_up_or_cannot_tell(capture) -> None:
    assert uneven_exposures(capture(), BLIND, NOISE) is None


@pytest.mark.parametrize(
    ("angles", "asked", "within"),
    [
        ((0.0, 36.0, 72.0, 108.0, 144.0), PANE, 1e-3),
        ((0.0, 20.0, 45.0, 75.0, 100.0, 125.0, 160.0), PANE, 1e-3),
        (tuple(range(0, 180, 15)), PANE, 1e-3),
        (tuple(range(0, 180, 30)), BLIND, 6e-3),
    ],
    ids=["five", "seven, unevenly", "twelve", "six, blind"],
)
def test_those_of_more_photographs_are_found(angles: tuple[float, ...], asked: SceneParameters, within: float) -> None:
    """Each tells one ratio more, by what does not add up; the one that no pixel tells stays one."""
    exposures = tuple(np.random.default_rng(len(angles)).uniform(0.98, 1.02, len(angles)).tolist())
    found = uneven_exposures(taken(exposures, angles=angles), asked, NOISE)
    assert found is not None
    left = np.log(found.relative[:, 0] / relative(exposures))
    along = np.cos(2 * np.radians(np.array(angles) - PANE.values()[1]))
    share = left @ along / (along @ along)
    assert abs(share) < within
    np.testing.assert_allclose(left - share * along, 0, atol=1e-3)


def test_of_angles_that_lie_close_together_none_are_found() -> None:
    angles = (0.0, 20.0, 40.0, 60.0, 80.0, 100.0)
    assert uneven_exposures(taken((1.02, 1.0, 0.99, 1.0, 1.01, 0.98), angles=angles), BLIND, NOISE) is None


def test_a_scene_that_is_told_whole_tells_them_best_and_stays_as_it_is_told() -> None:
    result, left = separate(taken(), PANE), separate(taken(), PANE, match_photographs=False)
    assert result.scene == PANE
    assert result.matching is not None
    np.testing.assert_allclose(result.matching.exposures, relative(EXPOSURES), atol=1e-3)
    (transmission, reflection), before = quality(result), quality(left)
    assert transmission > before[0]
    assert reflection > before[1] + 5


@pytest.mark.parametrize(("apart", "across"), [(8e-4, 0.006), (0.01, -0.04)])
def test_light_across_is_sooner_of_exposures_where_the_scene_is_told_whole(apart: float, across: float) -> None:
    exposures = exposed_across(apart, across)
    found = uneven_exposures(taken(exposures), PANE, NOISE)
    assert found is not None
    np.testing.assert_allclose(found.relative, relative(exposures)[:, None], atol=2e-3)


@pytest.mark.parametrize("lit", [(0.0, 0.0), (0.4, 70.0)], ids=["alike", "told as unpolarized"])
def test_none_are_found_beside_a_scene_that_is_told_whole_where_photographs_add_up(lit) -> None:
    assert uneven_exposures(taken((1.0,) * 4, PANE.replace(transmission_polarization=lit)), PANE, NOISE) is None


def test_an_incidence_that_is_told_tells_them_the_better() -> None:
    found = uneven_exposures(taken(), SceneParameters(40.0, None, None), NOISE)
    assert found is not None
    np.testing.assert_allclose(found.relative, relative(EXPOSURES)[:, None], atol=1.5e-3)


def test_an_incidence_that_is_told_wrongly_is_no_exposure() -> None:
    found, right = (uneven_exposures(taken(), SceneParameters(told, None, None), NOISE) for told in (10.0, 40.0))
    assert found is not None
    assert right is not None
    # What does not add up stays.
    apart = np.array([1, -1, 1, -1])
    assert (apart @ np.log(found.relative)).item() == pytest.approx((apart @ np.log(right.relative)).item(), abs=1e-4)
    assert np.std(np.log(found.relative)) < 0.02


def exposed_across(apart: float, across: float) -> tuple[float, ...]:
    """Exposures by which photographs do not add up, and leave light polarized across, by shares of the light."""
    twice = 2 * np.radians(np.array(ANGLES) - 25.0)
    return tuple(np.exp(0.5 * apart * np.array([1, -1, 1, -1]) + across * np.sin(twice)).tolist())


def test_little_light_across_is_of_exposures_where_photographs_do_not_add_up() -> None:
    exposures = exposed_across(8e-4, 0.004)
    found = uneven_exposures(taken(exposures), BLIND, NOISE)
    assert found is not None
    np.testing.assert_allclose(found.relative, relative(exposures)[:, None], atol=3e-3)
    assert SeparationWarning.POLARIZED_SOURCE not in separated(exposures).diagnostics.warnings


@pytest.mark.parametrize(("apart", "across"), [(0.0, 0.004), (8e-4, 0.008)])
def test_light_across_that_they_hardly_explain_is_left_to_its_rung(apart: float, across: float) -> None:
    assert uneven_exposures(taken(exposed_across(apart, across)), BLIND, NOISE) is None


def test_light_that_is_polarized_beside_them_is_left_to_its_rung() -> None:
    lit = PANE.replace(reflection_polarization=(0.6, 10.0))
    assert uneven_exposures(taken(EXPOSURES, lit), BLIND, NOISE) is None


def test_white_balances_that_differ_are_found_divided_out_and_told() -> None:
    found = uneven_exposures(balanced_anew(), BLIND, NOISE)
    assert found is not None
    logarithms = np.log(balanced(1.0))
    left = np.log(found.relative) - (logarithms - logarithms.mean(axis=0))
    np.testing.assert_allclose(left, 0, atol=0.01)
    # What does not add up of each colour is seen exactly, and by how much colours differ nearly so.
    np.testing.assert_allclose(np.array([1, -1, 1, -1]) @ left, 0, atol=2e-3)
    np.testing.assert_allclose(left - left.mean(axis=1, keepdims=True), 0, atol=4e-3)


def test_layers_gain_where_white_balances_are_divided_out() -> None:
    result, left = separate(balanced_anew()), separate(balanced_anew(), match_photographs=False)
    for gained, before in zip(quality(result), quality(left), strict=True):
        assert gained > before + 2
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN in left.diagnostics.warnings
    assert not result.diagnostics.warnings
    assert result.matching is not None
    told = matching_report(result.matching)
    beside_green = WHITE_BALANCES[:, [0, 2]] / WHITE_BALANCES[:, [1]]
    np.testing.assert_allclose(told["white_balances"], beside_green / beside_green[0], atol=2e-3)
    (sentence,) = matching_sentences(told)
    assert sentence.endswith("brought to one white balance, by up to 4.8 % of red or blue beside green.")


def test_colours_that_were_exposed_alike_have_one_white_balance() -> None:
    result = separated(EXPOSURES)
    assert result.matching is not None
    assert result.matching.white_balances == ()
    assert matching_report(result.matching)["white_balances"] is None


def test_white_balances_that_pass_for_another_mistake_are_found_all_the_same() -> None:
    capture = balanced_anew(2.0)
    assert find_mistakes(capture) != Mistakes()
    result = separate(capture)
    assert result.matching is not None
    assert result.matching.white_balances
    assert not {SeparationWarning.ANGLES_SWAPPED, SeparationWarning.GAMMA_ENCODED} & set(result.diagnostics.warnings)
    assert abs(result.scene.incidence_deg - 55) < 2 * result.errors.incidence_deg


@settings(max_examples=25, deadline=None)
@given(st.floats(0, 180), st.tuples(*[st.floats(-0.03, 0.03)] * 3))
def test_two_ratios_are_seen_whatever_the_azimuth(azimuth_deg: float, ratios: tuple[float, float, float]) -> None:
    apart, along, across = ratios
    twice = 2 * np.radians(np.array(ANGLES) - azimuth_deg)
    logarithms = 0.5 * apart * np.array([1, -1, 1, -1]) + along * np.cos(twice) + across * np.sin(twice)
    light, polarized = np.random.default_rng(0).uniform(0.2, 0.8, (2, 96, 96))
    seen = (light + 0.2 * (polarized - 0.5) * np.cos(twice)[:, None, None]) / 2
    capture = Capture.of_planes(seen * np.exp(logarithms)[:, None, None], ANGLES)
    found = _seen(capture, told=False)
    if abs(apart) < 2e-3 or abs(across) > 2.8 * abs(apart):
        return
    assert found is not None
    left = np.log(found.relative[:, 0]) - logarithms
    axes = np.array([[1, -1, 1, -1], 2 * np.sin(twice)]) / 2
    np.testing.assert_allclose(axes @ left / 2, 0, atol=1e-3)
