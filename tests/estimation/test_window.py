"""Windows of several panes, found."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polaropt import InputError, SceneParameters, separate
from polaropt.capture import Capture, noise_level, plate_frame, stokes_images
from polaropt.estimation import estimate_scene, find_scene, still_photographs
from polaropt.estimation.flat.ghosts import ShiftLikelihood, cross_spectra
from polaropt.estimation.flat.pane_by_tiles import with_ghosts_by_tiles
from polaropt.estimation.flat.window import (
    _is_contradicted,
    _likelier,
    _may_be_one,
    _may_be_several,
    _shows_across,
    _tinted_or,
    _with_panes,
    with_window,
)
from polaropt.estimation.flat.windows.axis import Evidence, Scan, tells_of_tint
from polaropt.estimation.flat.windows.gaps import GapMap
from polaropt.estimation.flat.windows.likelihood import Window, WindowLikelihood, images_of, lags_of
from polaropt.estimation.flat.windows.search import (
    LikelyWindow,
    WindowSearch,
    equivalent_incidences,
    equivalent_single,
)
from polaropt.estimation.flat.windows.tiles import MOST_ABSORPTION, TileFit
from polaropt.estimation.safeguard import with_incidence_checked
from polaropt.numerics import jackknife_error, turn_between
from polaropt.optics import in_place_reflectance
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of
from studies.random_windows.windows import window_of

NOISE = 0.005
OPEN = SceneParameters(None, None, None, n_panes=None, gap_shift=None, absorption=None)
TWO = SceneParameters(60.0, 25.0, 2.0, n_panes=2, gap_shift=9.0)


def taken(scene: SceneParameters, pair: int = 0, size: int = 192, noise: float = NOISE) -> Capture:
    photographs = pairs_of(None, size)[pair]
    frames = (photographs.transmission, photographs.reflection)
    return photograph_pair(*frames, scene, Camera(noise=noise), margin=photographs.margin)


def found_at_random(number: int, **told: object) -> SceneParameters:
    """What is found of a random scene to fit on, by the searches for flat windows alone."""
    sample = window_of(number, 192).sample(None, 192)
    # Of what moves nothing is told, as before every estimation.
    capture, noise = still_photographs(sample.capture).capture, noise_level(sample.capture)
    stokes, pane = stokes_images(capture, noise), sample.hint.plainest
    found = with_ghosts_by_tiles(estimate_scene(capture, pane, noise=noise), stokes, pane, is_flat=True)
    return with_window(found, stokes, sample.hint.replace(**told)).scene


def likelihood(capture: Capture) -> WindowLikelihood:
    return WindowLikelihood(cross_spectra(plate_frame(stokes_images(capture, NOISE), 25.0)), 1.5)


def test_a_start_beyond_what_is_searched_stays_there() -> None:
    capture = Capture.of_planes(np.random.default_rng(0).uniform(0.2, 0.8, (4, 1, 64, 64)), (0.0, 45.0, 90.0, 135.0))
    beyond = Window(60.0, -6.0, 27.0, n_panes=2)
    gaps = GapMap(cross_spectra(plate_frame(stokes_images(capture, NOISE), 25.0)), 1.5, 20.0)
    assert WindowSearch(likelihood(capture), gaps, 20.0, 1.5, {}).refined(beyond, 1).window.gap_along == 27.0


def test_the_true_window_is_likeliest() -> None:
    true = Window(60.0, 2.0, 9.0, n_panes=2)
    others = [
        replace(true, **changes)
        for changes in (
            {"incidence_deg": 57.0},
            {"incidence_deg": 63.0},
            {"pane_shift": 3.0},
            {"gap_along": -9.0},
            {"gap_across": 2.0},
            {"n_panes": 1},
            {"n_panes": 3},
            {"absorption": 0.3},
        )
    ]
    misfit = likelihood(taken(TWO)).misfit([true, *others])
    assert misfit[0] < misfit[1:].min() - 2e-3


def test_a_single_pane_is_as_likely_as_the_line_of_its_ghosts_says() -> None:
    spectra = cross_spectra(plate_frame(stokes_images(taken(TWO), NOISE), 25.0))
    shifts = np.array([-3.0, 0.0, 2.0, 11.0])
    lines = ShiftLikelihood(spectra, OPEN.plainest, (5, 4)).misfit(70.0, shifts, rounds=30)
    found = WindowLikelihood(spectra, 1.5).misfit([Window(70.0, float(shift)) for shift in shifts], rounds=40)
    np.testing.assert_allclose(found, lines, atol=2e-3)


@pytest.mark.parametrize("incidence_deg", [45.0, 72.0])
def test_two_panes_that_look_like_one_lie_between_the_incidences_of_equal_reflectance(incidence_deg: float) -> None:
    angles = equivalent_incidences(incidence_deg, 2, 1.5)
    assert angles == sorted(angles)
    wanted = in_place_reflectance(incidence_deg, 1.5, False)[1]
    assert min(abs(in_place_reflectance(angle, 1.5, False, 2)[1] - wanted) for angle in angles) < 0.02


@given(st.floats(20.0, 70.0), st.floats(1.35, 1.9))
def test_one_pane_that_polarizes_as_two_do_is_steeper_but_no_mirror(incidence_deg: float, index: float) -> None:
    single = equivalent_single(incidence_deg, 2, index)
    (par, perp), (pars, perps) = (
        in_place_reflectance(angle, index, False, n) for angle, n in ((incidence_deg, 2), (single, 1))
    )
    # The more light is mirrored, the less is left to be polarized: such a pane is on the other side.
    most = max((np.diff(in_place_reflectance(angle, index, False))[0], angle) for angle in range(20, 90))
    assert incidence_deg < single < most[1] + 1
    assert perps - pars == pytest.approx(min(perp - par, most[0]), abs=0.015)


def test_two_panes_are_found_blind() -> None:
    found = find_scene(taken(TWO), OPEN, NOISE)
    scene = found.scene
    assert scene.n_panes == 2
    assert scene.rung == "ghosts"
    assert scene.incidence_deg == pytest.approx(60, abs=0.7)
    assert (scene.ghost_shift, scene.gap_shift) == pytest.approx((2, 9), abs=0.5)
    assert 0 < (found.errors.gap_shift or 0) < 1


@pytest.mark.parametrize(
    "window",
    [SceneParameters(40.0, 25.0, 0.5, n_panes=2, gap_shift=1.5), SceneParameters(51.0, 25.0, 2.0)],
)
def test_two_close_panes_and_the_single_one_that_looks_like_them_are_told_apart(window: SceneParameters) -> None:
    found = find_scene(taken(window, size=256), OPEN, NOISE).scene
    assert found.n_panes == window.n_panes
    assert (found.gap_shift == 0) == (window.n_panes == 1)
    assert found.incidence_deg == pytest.approx(window.incidence_deg, abs=0.7)


@pytest.mark.parametrize("gap", [(9.0, 0.0), (-12.0, 5.0)])
def test_a_map_of_gaps_holds_the_true_one(gap: tuple[float, float]) -> None:
    """Though it is made a few degrees off, and no scan along the azimuth would meet the second."""
    turned = float(np.degrees(np.arctan2(gap[1], gap[0])))
    capture = taken(TWO.replace(gap_shift=float(np.hypot(*gap)), gap_azimuth_deg=25.0 - turned))
    gaps = GapMap(cross_spectra(plate_frame(stokes_images(capture, NOISE), 25.0)), 1.5, 24.0)
    likely = gaps.likely(Window(64.0, 2.0, n_panes=2), 4)
    assert min(np.hypot(along - gap[0], across - gap[1]) for along, across in likely) <= 1


@given(
    incidence_deg=st.floats(0, 85),
    n_panes=st.integers(1, 3),
    absorption=st.floats(0, 1.5),
    phases=st.tuples(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi)),
)
def test_lags_make_the_spectra_that_their_images_make(
    incidence_deg: float, n_panes: int, absorption: float, phases: tuple[float, float]
) -> None:
    """Each image turns a frequency by its shifts; what two have in common goes by the difference of these."""
    window = Window(incidence_deg, 1.0, 1.0, n_panes=n_panes, absorption=absorption)
    places, images = images_of(window, 1.5)
    # Of either polarization the faintest images count only where they are seen.
    images = np.where(np.abs(images) > 2e-3, images, 0)
    par, perp = np.moveaxis(images, -1, 0) @ np.exp(-1j * (places @ phases))
    cross = par * perp.conj()
    orders, weights = lags_of(window, 1.5)
    cosines, sines = np.cos(orders @ phases), np.sin(orders @ phases)
    expected = np.abs(par) ** 2, np.abs(perp) ** 2, cross.real, -cross.imag
    for k, (values, waves) in enumerate(zip(expected, (cosines, cosines, cosines, sines), strict=True)):
        np.testing.assert_allclose(weights[..., k] @ waves, values, atol=1e-3)


@pytest.mark.parametrize(("number", "n_panes"), [(184, 3), (216, 2), (664, 2), (408, 3)])
def test_panes_are_counted(number: int, n_panes: int) -> None:
    """Three that no two resemble, two that a likelier wrong window hides, two whose gap shifts to the side.

    Three in place whose images all lie 18 degrees beside the azimuth.
    """
    scene = found_at_random(number, absorption=0.0)
    assert scene.n_panes == n_panes
    if n_panes > 1:
        # A gap's sign is told as a pane's is: along the azimuth, not against it.
        turned = ((scene.gap_azimuth_deg or 0.0) - scene.values()[1] + 180) % 360 - 180
        assert abs(turned) <= 90


def test_a_pane_that_lies_across_is_no_window_of_several() -> None:
    scene = found_at_random(164)
    azimuth = window_of(164, 192).scene.azimuth_deg or 0.0
    assert scene.n_panes == 1
    assert abs(turn_between(scene.values()[1], azimuth)) < 1


def test_a_pane_whose_ghost_was_missed_is_no_window_of_two_thin_ones() -> None:
    scene, true = found_at_random(514), window_of(514, 192).scene
    assert scene.n_panes == 1
    assert scene.values()[0] == pytest.approx(true.values()[0], abs=0.5)
    assert scene.values()[2] == pytest.approx(true.values()[2], abs=0.5)


@pytest.mark.parametrize(
    ("absorption", "ghost_px", "told"),
    [
        (0.16, 6.0, True),
        (0.14, 6.0, False),
        (MOST_ABSORPTION - 0.06, 6.0, True),
        (MOST_ABSORPTION - 0.04, 6.0, False),
        (0.5, -1.3, True),
        (0.5, 1.2, False),
    ],
)
def test_a_ghost_that_lies_close_or_is_hardly_dimmer_or_all_but_gone_tells_of_no_tint(
    absorption: float, ghost_px: float, told: bool
) -> None:
    assert tells_of_tint(Window(60.0, ghost_px, absorption=absorption)) is told


@pytest.mark.parametrize(("tiles", "spectra", "edges", "turned", "found"), [
    (2.1, 4.0, 0.0, False, "tinted"), (1.9, 7.0, 4.0, False, "plain"), (2.1, 3.6, 0.0, False, "plain"),
    (2.5, 2.0, 2.1, False, "tinted"), (2.5, 2.0, 1.9, False, "plain"), (9.0, 8.0, 4.0, True, "clear"),
])  # fmt: skip
def test_clear_glass_is_not_tinted(tiles: float, spectra: float, edges: float, turned: bool, found: str) -> None:
    """Tiles tell it beside mean spectra and edges, and no clear pane whose angles start elsewhere suits them better."""
    fit = SimpleNamespace(window=Window(60.0, 6.0, absorption=0.4), misfit=0.0, believed_over=lambda other: tiles)

    def judged(window: Window) -> SimpleNamespace:
        return SimpleNamespace(window=window, surer_than=lambda other: (spectra, edges))

    axis = SimpleNamespace(
        tinted_near=lambda starts, clear: fit,
        nearest_by_tiles=lambda window, names: SimpleNamespace(window=window),
        tiles_under=lambda window: fit,
        judged=judged,
        is_clear_and_turned=lambda tinted: turned,
    )
    windows = {"plain": Window(57.0, 2.0), "clear": Window(60.0, 6.0), "tinted": fit.window}
    assert _tinted_or(axis, [], judged(windows["plain"])).window == windows[found]  # type: ignore[arg-type]


@pytest.mark.parametrize(("lacks", "taken"), [(0.02, True), (0.04, False)])
def test_a_single_pane_across_is_looked_for_where_several_are_no_likelier(lacks: float, taken: bool) -> None:
    """A steep pane with double images far apart stayed across, both layers exchanged, where no more was asked."""

    def pane(window: Window, misfit: float) -> LikelyWindow:
        return LikelyWindow(window, misfit, misfit, (np.zeros(3), np.zeros(3)))

    def axis(misfit: float, **more: object) -> SimpleNamespace:
        scanned = [pane(Window(60.0, 0.0, 5.0, n_panes=2), misfit)]
        search = SimpleNamespace(single=lambda angles: [pane(Window(80.0, 15.0), 0.1)], panes=lambda angles: [])
        return SimpleNamespace(search=search, scan=lambda n_panes, *begun: Scan(n_panes, scanned, 0.0), **more)

    plain, single = pane(Window(75.0, 0.0), 0.0), pane(Window(82.0, 19.0), -0.1)
    first = axis(0.0, glimpses=lambda windows, window: False)
    across = axis(lacks, best=lambda panes: single, evidence=lambda *windows: Evidence(5.0, 0.0))
    axes = [(first, (75.0,)), (across, (80.0,))]
    at, found, rival = _with_panes(axes, plain, plain)  # type: ignore[arg-type]
    assert (at, found, rival) == ((across, single, None) if taken else (first, plain, None))


FAR, CLOSE = Window(45.0, -0.3, -6.0, n_panes=2), Window(45.0, 0.5, 1.5, n_panes=2)
THIN, THIN_AND_CLOSE = Window(45.0, -0.2, -6.0, n_panes=2), Window(45.0, 0.1, 1.5, n_panes=2)


def judged_as(window: Window, spectra: float, edges: float) -> LikelyWindow:
    """A window that mean spectra and edges tell by so many standard errors, beside one with none."""
    # So small that the score is no worse for it.
    scattered = 1e-4 * np.array([0.0, 1.0, 2.0])
    error = jackknife_error(scattered)
    parts = (-spectra * scattered, -edges * scattered)
    gains = error * spectra * abs(spectra), error * edges * abs(edges)
    return LikelyWindow(window, -sum(gains), -gains[0], parts)


@pytest.mark.parametrize(("window", "shown", "across", "errors", "likelier"), [
    (FAR, True, False, (3.0, 1.9, 0.0), False), (FAR, True, False, (3.0, 2.1, 0.0), True),
    (FAR, True, False, (3.4, -2.0, -2.0), False), (FAR, True, False, (3.6, -2.0, -2.0), True),
    (FAR, True, False, (2.0, 2.0, 3.9), False), (FAR, True, False, (2.0, 2.5, 3.9), True),
    (FAR, False, False, (6.0, 1.9, 0.0), False), (FAR, False, False, (6.0, 2.1, 0.0), True),
    (FAR, True, True, (6.0, 1.9, 0.0), False), (FAR, True, True, (6.0, 2.1, 0.0), True),
    (FAR, True, False, (6.0, -3.1, 0.0), False), (FAR, True, False, (6.0, -2.9, 0.0), True),
    (CLOSE, True, False, (0.1, 0.7, 0.7), False), (CLOSE, True, False, (0.1, 0.8, 0.8), True),
    (CLOSE, True, False, (-0.1, 2.0, 2.0), False),
    (THIN, True, False, (6.0, 1.9, 0.0), False), (THIN, True, False, (6.0, 2.1, 0.0), True),
    (THIN_AND_CLOSE, True, False, (-5.0, 2.0, 1.0), False),
])  # fmt: skip
def test_the_limits_of_what_tells_several_panes(window, shown, across, errors, likelier) -> None:
    """Standard errors of tiles count once, of mean spectra by half, of edges by a quarter; many of tiles do alone.

    Two panes without thickness, one behind the other, look like one.
    """
    tiles, spectra, edges = errors
    axis = SimpleNamespace(
        shows=lambda window: shown, evidence=lambda window, other, beside: Evidence(tiles, *window.surer_than(other))
    )
    single = LikelyWindow(Window(57.0, -1.0 if window is CLOSE else -6.0), 0.0, 0.0, (np.zeros(3), np.zeros(3)))
    beside = SimpleNamespace() if across else axis
    found = judged_as(window, spectra, edges)
    assert found.surer_than(single) == pytest.approx((spectra, edges))
    assert _likelier(axis, found, beside, single) is likelier  # type: ignore[arg-type]


@pytest.mark.parametrize(("panes", "edges", "doubted"), [(2, -3.8, True), (2, -3.7, False), (1, -3.8, False)])
def test_edges_that_surely_overlap_more_contradict_several_panes(panes: int, edges: float, doubted: bool) -> None:
    single = LikelyWindow(Window(57.0, -6.0), 0.0, 0.0, (np.zeros(3), np.zeros(3)))
    assert _is_contradicted(judged_as(replace(FAR, n_panes=panes), 8.0, edges), single) is doubted


@pytest.mark.parametrize(
    ("window", "evidence", "several"),
    [
        (FAR, Evidence(2.6, 0.0), True),
        (FAR, Evidence(2.4, 0.0), False),
        # As of a single pane whose mean spectra alone look so.
        (FAR, Evidence(0.6, 6.0, 3.0), False),
        (replace(FAR, gap_along=1.0, pane_shift=1.0), Evidence(2.6, 0.0), False),
    ],
)
def test_what_is_not_told_surely_may_be_several_panes(window: Window, evidence: Evidence, several: bool) -> None:
    axis = SimpleNamespace(shows=lambda window: True, evidence=lambda window, other, beside: evidence)
    found, single = (LikelyWindow(one, 0.0, 0.0, (np.zeros(3), np.zeros(3))) for one in (window, Window(57.0, -6.0)))
    assert _may_be_several(axis, found, single) is several  # type: ignore[arg-type]


@pytest.mark.parametrize(("tiles", "turned"), [(-3.3, False), (-1.9, True), (3.0, True)])
def test_edges_in_noise_turn_no_pane_against_its_tiles(tiles: float, turned: bool) -> None:
    axis = SimpleNamespace(evidence=lambda window, other, beside: Evidence(tiles, 3.0, 4.0))
    plain = LikelyWindow(Window(32.0, 0.0), 0.0, 0.0, (np.zeros(3), np.zeros(3)))
    across = judged_as(Window(34.0, -16.0), 3.0, 4.0)
    across = replace(across, score=-0.02)
    assert _shows_across(axis, across, axis, plain) is turned  # type: ignore[arg-type]


@pytest.mark.parametrize(("lost", "likelier"), [(0.029, True), (0.031, False)])
def test_tiles_are_not_believed_against_a_score_that_is_much_worse(lost: float, likelier: bool) -> None:
    axis = SimpleNamespace(shows=lambda window: True, evidence=lambda window, other, beside: Evidence(9.0, 0.0))
    single = LikelyWindow(Window(57.0, -6.0), 0.0, 0.0, (np.zeros(3), np.zeros(3)))
    found = replace(single, window=FAR, score=lost)
    assert _likelier(axis, found, axis, single) is likelier  # type: ignore[arg-type]


@pytest.mark.parametrize(("panes", "shown", "n_tiles", "may_be"), [
    (2, False, 147, False), (2, False, 148, True), (3, False, 300, True), (2, True, 300, False), (1, False, 300, False),
])  # fmt: skip
def test_what_is_told_in_noise_of_a_large_frame_may_be_one_pane(panes, shown, n_tiles, may_be) -> None:
    axis = SimpleNamespace(shows=lambda window: shown, tiles=SimpleNamespace(n_tiles=n_tiles))
    assert _may_be_one(axis, replace(FAR, n_panes=panes)) is may_be  # type: ignore[arg-type]


@pytest.mark.parametrize(("n_tiles", "believed"), [(9, 3.0), (147, 12.1), (588, 12.1)])
def test_four_times_the_tiles_are_not_believed_more_of_the_same(n_tiles: int, believed: float) -> None:
    gains = np.ones(n_tiles)
    likelier, other = (TileFit(FAR, 1.5, misfits) for misfits in (np.zeros(n_tiles), gains))
    assert likelier.believed_over(other) == pytest.approx(believed, abs=0.1)
    assert other.believed_over(likelier) == pytest.approx(-believed, abs=0.1)


@pytest.mark.parametrize(("panes", "pane_px", "gap_px"), [(2, 2.6, 5.3), (3, -2.5, -8.1)])
def test_several_panes_at_a_steep_view_are_no_dark_glass_across(panes: int, pane_px: float, gap_px: float) -> None:
    true, noise = SceneParameters(62.0, 25.0, pane_px, n_panes=panes, gap_shift=gap_px), 0.004
    found = find_scene(taken(true, 1, noise=noise), OPEN, noise).scene
    assert (found.n_panes, found.absorption) == (panes, 0.0)
    assert found.incidence_deg == pytest.approx(62.0, abs=0.5)
    assert abs(turn_between(found.values()[1], 25.0)) < 1


@pytest.mark.parametrize("number", [698, 1818])
def test_dark_glass_at_a_steep_view_does_not_lie_across(number: int) -> None:
    """It mirrors more beside what it lets through: as clear glass across, which was found, both layers swapped."""
    true, found = window_of(number, 192).scene, found_at_random(number)
    assert abs(turn_between(found.values()[1], true.values()[1])) < 1
    assert found.values()[0] == pytest.approx(true.values()[0], abs=1)
    assert found.absorption == pytest.approx(true.absorption, abs=0.15)


def test_two_panes_at_a_steep_view_are_no_single_one_across() -> None:
    """Single panes there are far less likely than those found, for two are like one at 86 degrees."""
    true, found = window_of(3993, 192).scene, found_at_random(3993)
    assert abs(turn_between(found.values()[1], true.values()[1])) < 1
    assert found.n_panes == 2
    assert found.values()[0] == pytest.approx(true.values()[0], abs=1)


def test_a_faint_likeness_far_off_is_no_ghost_of_tinted_glass() -> None:
    """The best of many shifts, where clear glass shows no ghost."""
    assert found_at_random(28, n_panes=1).absorption == 0


def test_close_ghosts_that_may_as_well_lie_elsewhere_are_none() -> None:
    """In strong noise, where another shift on the same side is about as likely."""
    assert not found_at_random(132).has_ghosts


def test_the_incidence_of_a_known_number_of_panes_is_found_where_their_images_lie_on_each_other() -> None:
    window = TWO.replace(incidence_deg=50.0, ghost_shift=0.0, gap_shift=0.0)
    found = find_scene(taken(window), window.replace(incidence_deg=None, azimuth_deg=None), NOISE).scene
    assert found.incidence_deg == pytest.approx(50, abs=1)
    assert (found.n_panes, found.ghost_shift, found.gap_shift) == (2, 0, 0)


def test_a_window_that_is_told_whole_is_separated() -> None:
    capture, truth = taken(TWO), pairs_of(None, 192)[0].frames[0]
    result = separate(capture, TWO)
    assert np.sqrt(np.mean((result.transmission - truth) ** 2)) < 0.008
    assert result.tried == ()


def test_before_a_wide_lens_a_known_number_of_panes_is_taken_in_place() -> None:
    window = TWO.replace(incidence_deg=50.0, ghost_shift=0.0, gap_shift=0.0, focal_px=230.0)
    asked = OPEN.replace(n_panes=2, focal_px=230.0)
    found = find_scene(taken(window), asked, NOISE).scene
    assert (found.rung, found.n_panes) == ("perspective", 2)
    assert found.incidence_deg == pytest.approx(50, abs=1.5)
    assert not found.has_ghosts


def test_a_thickness_is_for_a_single_pane() -> None:
    with pytest.raises(InputError, match="single pane"):
        find_scene(taken(TWO, size=64), OPEN.replace(n_panes=2), NOISE, thickness_px=5.0)


def test_tint_is_found_by_a_dim_ghost() -> None:
    tinted = SceneParameters(60.0, 25.0, 6.0, absorption=0.5)
    found = find_scene(taken(tinted, size=256), OPEN, NOISE)
    assert found.scene.absorption == pytest.approx(0.5, abs=0.2)
    assert (found.scene.n_panes, found.scene.gap_shift) == (1, 0)
    assert found.errors.absorption is not None


def test_without_double_images_it_is_said_what_looks_alike() -> None:
    found = find_scene(taken(SceneParameters(57.0, 25.0, 0.0)), OPEN, NOISE)
    (lowest,) = (rung for rung in found.tried if rung.taken)
    assert found.scene.n_panes == 1
    assert "two panes at 4" in lowest.reason


def test_a_told_incidence_that_suits_two_panes_is_not_doubted() -> None:
    window = TWO.replace(incidence_deg=45.0)
    assert not with_incidence_checked(taken(window), OPEN.replace(incidence_deg=45.0), NOISE).doubtful
