"""Of two panes across each other the likelier is taken, or none where a mistake would cost too much."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from skimage.data import coffee, rocket

from polaropt import SceneParameters, SeparationWarning, estimate, separate, simulate
from polaropt.capture.capture import Capture
from polaropt.capture.mosaic import sampling_of
from polaropt.capture.noise import noise_level
from polaropt.capture.polarization import plate_frame, stokes_images
from polaropt.estimation.flat import azimuth
from polaropt.estimation.flat.azimuth import (
    NOTABLE_CHANCE,
    NOTABLE_CHANCE_OF_MOSAIC,
    AxisCandidate,
    AxisChoice,
    choose_axis,
    log_odds,
)
from polaropt.estimation.flat.estimate import _is_settled, estimate_scene
from polaropt.estimation.flat.search import SceneSearch, Trial, evidence
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileLikelihood
from polaropt.estimation.ladder import find_scene
from polaropt.estimation.safeguard import CheckedScene, left_alone, with_incidence_checked
from polaropt.judging.warnings import diagnose
from polaropt.optics.plate import in_place_correction, in_place_reflectance
from polaropt.simulation.metrics import psnr_db
from polaropt.simulation.simulator import simulated_mosaic
from tests.blends import blend

BLIND = SceneParameters(None, None, None)
NOISE, POLARIZED_DB = 0.005, 20.0


@pytest.mark.parametrize(("margin", "incidence_deg", "of_mosaic", "settled"), [
    (0.1, 84.0, True, False), (-0.1, 84.0, True, False), (0.1, 79.0, True, True), (0.1, 84.0, False, True),
    (0.05, 60.0, True, False), (math.inf, 84.0, True, True),
])  # fmt: skip
def test_cells_of_a_mosaic_that_like_a_grazing_pane_settle_no_axis(margin, incidence_deg, of_mosaic, settled) -> None:
    assert _is_settled(margin, Trial(incidence_deg, 0.0, -5.0), of_mosaic=of_mosaic) is settled


def panes_of(capture: Capture, azimuth_deg: float, trials: tuple[Trial, Trial]) -> tuple[AxisCandidate, AxisCandidate]:
    frame = plate_frame(stokes_images(capture, noise_level(capture)), azimuth_deg)
    seen = evidence(frame)
    windows = [Window(trial.incidence_deg, trial.ghost_shift) for trial in trials]
    first, second = (
        AxisCandidate(
            part,
            trial,
            float(SceneSearch(part, BLIND, None).shift_curve(trial)[1].min()),
            partial(TileLikelihood(at).nearest, window, BLIND.index),
        )
        for at, part, trial, window in zip((frame, frame.across()), (seen, seen.across()), trials, windows, strict=True)
    )
    return first, second


@pytest.fixture(scope="module")
def panes() -> tuple[AxisCandidate, AxisCandidate]:
    """The true pane first, then one across with the layers exchanged, all bounces in place."""
    return panes_of(blend(60, 128).capture, 25.0, (Trial(60.0, 5.3, 0.0), Trial(82.0, 0.0, 0.0)))


def test_the_true_pane_is_the_likelier_whichever_comes_first(panes: tuple[AxisCandidate, AxisCandidate]) -> None:
    assert log_odds(panes, BLIND, NOISE) > 2
    assert log_odds(panes[::-1], BLIND, NOISE) == pytest.approx(-log_odds(panes, BLIND, NOISE))
    assert choose_axis(panes, BLIND, NOISE, POLARIZED_DB).best == 0
    assert choose_axis(panes[::-1], BLIND, NOISE, POLARIZED_DB).best == 1
    assert choose_axis(panes, BLIND, NOISE, POLARIZED_DB).chance < NOTABLE_CHANCE


def test_scores_that_differ_by_more_than_the_noise_bends_them_settle_it(
    panes: tuple[AxisCandidate, AxisCandidate],
) -> None:
    better = replace(panes[1], trial=replace(panes[1].trial, score=panes[0].trial.score - 3 * NOISE))
    assert choose_axis((panes[0], better), BLIND, NOISE, POLARIZED_DB) == AxisChoice(1)
    assert choose_axis((panes[0], better), BLIND, 2 * NOISE, POLARIZED_DB).chance > 0


def test_a_score_by_a_few_levels_is_overruled_by_all_else_together(
    panes: tuple[AxisCandidate, AxisCandidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    def taken(levels: float, odds: float) -> int:
        monkeypatch.setattr("polaropt.estimation.flat.azimuth.log_odds", lambda *_, **__: odds)
        better = replace(panes[1], trial=replace(panes[1].trial, score=panes[0].trial.score - levels * NOISE))
        return choose_axis((panes[0], better), BLIND, NOISE, POLARIZED_DB).best

    assert (taken(3, 2.1), taken(3, 1.9), taken(3.9, 2.1), taken(4.1, 2.1)) == (0, 1, 0, 1)


def test_noise_that_passes_for_ghosts_of_a_grazing_pane_exchanges_no_layers() -> None:
    behind, mirrored = rocket()[214:374, 171:331], coffee()[45:205, 210:370]
    for seed in (0, 8):
        capture = simulate(behind, mirrored, SceneParameters(68.5, 155.0, 0.0), noise=0.015, seed=seed)
        found = estimate_scene(capture, BLIND, noise=0.015).scene
        assert abs(found.incidence_deg - 68.5) < 2
        assert abs(found.azimuth_deg - 155) < 1


def test_a_pane_as_good_as_itself_is_as_likely_and_worth_the_risk_where_polarized_light_is_seen(
    panes: tuple[AxisCandidate, AxisCandidate],
) -> None:
    assert log_odds((panes[0], panes[0]), BLIND, NOISE) == 0
    # Half the chance of being as far from the intensity as the light is from its noise, or twice as far off.
    for polarized_db in (0.0, 3.0, 20.0):
        same = choose_axis((panes[0], panes[0]), BLIND, NOISE, polarized_db)
        assert same == AxisChoice(0, 0.5, pytest.approx(polarized_db / 2 - 10 * math.log10(2)))


def test_a_pane_hardly_in_doubt_is_taken_even_where_noise_covers_the_polarized_light(
    panes: tuple[AxisCandidate, AxisCandidate],
) -> None:
    for order, best in ((panes, 0), (panes[::-1], 1)):
        taken = choose_axis(order, BLIND, NOISE, 0.0)
        assert (taken.best, taken.gain_db) == (best, math.inf)
        assert 0 < taken.chance < 0.1


@pytest.mark.parametrize(("incidences_deg", "chance"), [
    ((78.9, 78.4), 1 / (1 + math.exp(1))), ((78.9, 77.9), 1 / (1 + math.exp(2))), ((60.0, 82.0), 1 / (1 + math.exp(2))),
])  # fmt: skip
@pytest.mark.parametrize("aliased", [False, True])
def test_what_tells_a_pane_from_its_own_opposite_counts_half(
    incidences_deg: tuple[float, float], chance: float, aliased: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 78.9 degrees a pane of window glass mirrors along what it lets through across: layers exchange unseen."""
    assert sum(in_place_reflectance(78.85, 1.5, False)) == pytest.approx(1, abs=1e-3)
    monkeypatch.setattr(azimuth, "log_odds", lambda panes, scene, noise, aliased: 2.0)
    first, second = (
        AxisCandidate(None, Trial(incidence, 0.0, 0.0), 0.0, lambda: None)  # type: ignore[arg-type, return-value]
        for incidence in incidences_deg
    )
    taken = choose_axis((first, second), BLIND, NOISE, POLARIZED_DB, aliased=aliased)
    # A mosaic's cells tell it less surely: farther off it counts half, too.
    half = 1 / (1 + math.exp(1))
    assert (taken.best, taken.chance) == (0, pytest.approx(half if aliased and 77.9 in incidences_deg else chance))


def test_tiles_tell_where_all_else_is_alike(panes: tuple[AxisCandidate, AxisCandidate]) -> None:
    true, across = panes[0].tile_fit(), panes[1].tile_fit()
    assert true.surer_than(across) > 1
    alike = replace(panes[0], tile_fit=lambda: across)
    odds = log_odds((panes[0], alike), BLIND, NOISE)
    assert 0.3 * true.surer_than(across) < odds < true.surer_than(across)
    taken = choose_axis((alike, panes[0]), BLIND, NOISE, POLARIZED_DB)
    assert taken.best == 1
    assert taken.chance < 0.5


@pytest.mark.parametrize("sides", [(5.0, 0.0), (0.0, 5.0), (2.0, -3.0)])
def test_ghosts_that_surely_lie_on_a_side_speak_for_the_pane_of_a_mosaic_that_has_them(
    sides: tuple[float, float], panes: tuple[AxisCandidate, AxisCandidate]
) -> None:
    """What passes for ghosts lies on neither side, or on either."""
    asked = tuple(
        replace(pane, sure_of_side=lambda _, side=side: side) for pane, side in zip(panes, sides, strict=True)
    )
    first, second = (max(side, 0.0) for side in sides)
    odds, without = (log_odds(some, BLIND, NOISE, aliased=True) for some in (asked, panes))
    assert odds - without == pytest.approx(0.3 * (first - second))
    assert log_odds(asked[::-1], BLIND, NOISE, aliased=True) == pytest.approx(-odds)
    # Spectra of photographs tell it.
    assert log_odds(asked, BLIND, NOISE) == log_odds(panes, BLIND, NOISE)


@pytest.mark.parametrize("single_surface", [False, True])
@pytest.mark.parametrize("incidence", [15.0, 50.0, 80.0])
def test_the_correction_takes_each_layer_from_the_intensity(incidence: float, single_surface: bool) -> None:
    scene = SceneParameters(incidence, 25.0, 0.0, single_surface=single_surface)
    example = blend(incidence, 64, noise=0, ghost_shift=0.0, single_surface=single_surface)
    across = plate_frame(stokes_images(example.capture, 1e-4), 25.0).images
    correction = in_place_correction(incidence, scene.index, single_surface)
    np.testing.assert_allclose(across.sum(axis=0) + correction * (across[0] - across[1]), example.layers[0], atol=2e-3)


def test_an_azimuth_that_was_given_is_not_at_stake() -> None:
    capture = blend(60, 96).capture
    assert estimate_scene(capture, BLIND.replace(azimuth_deg=25.0)).axis_chance == 0


def test_in_doubt_the_intensity_is_returned_and_said_so() -> None:
    # Few pixels, grazing glass and no ghosts that would tell the two apart.
    example = blend(83, 64, noise=0.04, ghost_shift=0.0)
    result = separate(example.capture, BLIND.replace(ghost_shift=0.0))
    found = result.diagnostics.estimate
    assert found is not None
    assert found.axis_gain_db < 0
    assert result.scene.rung == "none"
    np.testing.assert_array_equal(result.layers[0], example.capture.stokes[0])
    assert SeparationWarning.AXIS_DOUBTFUL in result.diagnostics.warnings
    assert [step.rung for step in result.tried if step.taken] == ["none"]
    # Who insists gets what was asked for.
    assert estimate(example.capture, BLIND, model="pixelwise").scene.rung == "pixelwise"


def test_a_wide_lens_tells_the_two_apart() -> None:
    capture = blend(60, 64).capture
    doubtful = replace(estimate_scene(capture), axis_chance=NOTABLE_CHANCE)
    for focal_px, warned in ((None, True), (80.0, False)):
        told = diagnose(
            capture, 0.005, misfit_ratio=1.0, reflection_unknown=0.0, estimate=doubtful,
            scene=doubtful.scene.replace(focal_px=focal_px),
        )  # fmt: skip
        assert (SeparationWarning.AXIS_DOUBTFUL in told.warnings) == warned


@pytest.mark.parametrize(("chance", "warned"), [(0.99, False), (1.0, True)])
def test_of_a_mosaic_a_smaller_chance_of_the_other_pane_is_notable(chance: float, warned: bool) -> None:
    photographs = blend(60, 64, color=False)
    raw = sampling_of(color=False)[0].sample(photographs.capture.intensities.reshape(4, 1, 64, 64))
    doubtful = replace(estimate_scene(photographs.capture), axis_chance=chance * NOTABLE_CHANCE_OF_MOSAIC)
    told = diagnose(
        simulated_mosaic(raw, color=False), 0.005, misfit_ratio=1.0, reflection_unknown=0.0, estimate=doubtful,
        scene=doubtful.scene,
    )  # fmt: skip
    assert (SeparationWarning.AXIS_DOUBTFUL in told.warnings) == warned


@pytest.mark.parametrize(("told", "left"), [(80.0, True), (74.0, False), (40.0, False)])
def test_an_incidence_that_would_do_harm_is_not_used(told: float, left: bool) -> None:
    example = blend(60, 128)
    result = separate(example.capture, SceneParameters(told, None, None))
    nothing = psnr_db(example.capture.stokes[0], example.layers[0], 16)
    assert (result.scene.rung == "none") == left
    assert SeparationWarning.INCIDENCE_DOUBTFUL in result.diagnostics.warnings
    assert psnr_db(result.layers[0], example.layers[0], 16) >= nothing - 0.01
    assert result.scene.incidence_deg == told


def test_who_tells_the_whole_scene_gets_it() -> None:
    capture = blend(60, 96).capture
    scene = SceneParameters(80.0, 25.0, 0.0)
    found = find_scene(capture, scene, 0.005)
    assert left_alone(found, with_incidence_checked(capture, scene, 0.005)) is found
    assert with_incidence_checked(capture, scene, 0.005) == CheckedScene(scene)
