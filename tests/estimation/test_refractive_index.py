"""An index that is not known: found where the capture tells it, window glass's where not."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from polaropt import SceneParameters, SeparationWarning, StoppingRule, estimate, separate
from polaropt.capture import Capture, noise_level
from polaropt.errors import InputError
from polaropt.estimation import estimate_scene, find_scene, likelier_index, refractive_index, with_index
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.search import LikelyWindow
from polaropt.optics import GLASS_INDEX, SceneErrors
from polaropt.separation import Separation
from studies.random_windows.windows import window_of
from tests.blends import blend

QUICK = StoppingRule(max_evaluations=4)
OPEN = SceneParameters(None, None, None, refractive_index=None)


# Azimuth and ghosts are told to be fast.
TOLD = SceneParameters(None, 25.0, 5.3, refractive_index=None)


def test_beyond_brewsters_angle_an_index_is_found() -> None:
    example = blend(75.0, 128, refractive_index=1.8)
    fit = with_index(example.capture, TOLD, noise_level(example.capture))
    assert fit.error is not None
    assert fit.error < 0.1
    assert abs(fit.scene.index - 1.8) < 0.06
    assert fit.scene == TOLD.replace(refractive_index=fit.scene.index)


def test_window_glass_is_kept_where_nothing_speaks_against_it() -> None:
    example = blend(60.0, 80)
    asked = TOLD.replace(n_panes=None, gap_shift=None, absorption=None)
    fit = with_index(example.capture, asked, noise_level(example.capture))
    assert fit.scene == asked.replace(refractive_index=GLASS_INDEX)
    assert fit.error is not None
    assert fit.error > 0.1


def test_where_all_else_is_given_the_index_and_its_error_are_found() -> None:
    example = blend(70.0, 80, color=False)
    found = find_scene(example.capture, example.scene.replace(refractive_index=None), 0.005)
    assert found.scene == example.scene
    assert found.errors == SceneErrors(refractive_index=found.errors.refractive_index)
    assert found.errors.refractive_index is not None
    assert math.isfinite(found.errors.refractive_index)


def test_an_index_that_is_given_stays_and_has_no_error() -> None:
    example = blend(60.0, 64)
    asked = OPEN.replace(refractive_index=1.52)
    fit = with_index(example.capture, asked, 0.005)
    assert (fit.scene, fit.error) == (asked, None)


@pytest.mark.parametrize(
    "changes",
    [
        {"n_panes": 2, "gap_shift": None},
        {"absorption": 0.5},
        {"bend_deg_per_px": (0.1, 0.0, 0.0)},
        {"single_surface": True},
    ],
    ids=str,
)
def test_of_other_windows_than_one_clear_flat_pane_an_index_must_be_given(changes: dict[str, object]) -> None:
    with pytest.raises(InputError, match="one clear, flat pane"):
        with_index(blend(60.0, 64).capture, OPEN.replace(**changes), 0.005)


def test_a_scene_without_an_index_is_not_complete_and_has_no_number() -> None:
    scene = SceneParameters(refractive_index=None)
    assert not scene.complete
    with pytest.raises(InputError, match="lacks refractive_index"):
        _ = scene.index


@pytest.mark.parametrize("coated", [False, True], ids=["clear", "coated"])
def test_a_coating_is_told_by_colours_that_see_different_panes(coated: bool) -> None:
    layers = blend(60.0, 96).layers
    # What a low-emissivity coating mirrors along the plane of incidence: red, green and blue, at 60 degrees.
    along = np.array([0.063, 0.094, 0.156] if coated else [0.003] * 3)[:, None, None]
    across = 0.235 if coated else 0.31
    par, perp = ((1 - mirrored) * layers[0] + mirrored * layers[1] for mirrored in (along, across))
    photographs = np.stack([par, (par + perp) / 2, perp, (par + perp) / 2]) / 2
    photographs += 0.005 * np.random.default_rng(0).standard_normal(photographs.shape)
    asked = SceneParameters(None, 0.0, 0.0, refractive_index=None)
    assert with_index(Capture.of_planes(photographs.clip(0, 1)), asked, 0.005).coated == coated


@pytest.mark.parametrize("index", [1.5, 1.8])
def test_the_photographs_speak_against_an_index_that_is_not_the_panes(index: float) -> None:
    example = blend(75.0, 128, refractive_index=index)
    found = estimate_scene(example.capture, TOLD.replace(refractive_index=GLASS_INDEX), noise=0.005)
    likelier = likelier_index(example.capture, found.scene, 0.005)
    assert (likelier is None) == (index == GLASS_INDEX)
    if likelier is not None:
        assert abs(likelier.index - index) < 2 * likelier.error


def test_an_index_is_not_doubted_where_nothing_tells_it() -> None:
    example = blend(35.0, 96, refractive_index=1.8)
    found = estimate_scene(example.capture, TOLD.replace(refractive_index=GLASS_INDEX), noise=0.005)
    assert likelier_index(example.capture, found.scene, 0.005) is None


def test_two_panes_do_not_speak_against_their_index() -> None:
    example = blend(60.0, 128, n_panes=2, gap_shift=9.0)
    assert likelier_index(example.capture, example.scene, 0.005) is None


@lru_cache
def separated_as_glass(index: float) -> Separation:
    """What is separated of a pane of an index that is told to be window glass."""
    capture = blend(75.0, 128, refractive_index=index).capture
    return separate(capture, TOLD.replace(refractive_index=GLASS_INDEX), stopping=QUICK, index_known=True)


@pytest.mark.parametrize("index", [1.5, 1.8])
def test_a_wrong_index_is_warned_of(index: float) -> None:
    diagnostics = separated_as_glass(index).diagnostics
    assert (SeparationWarning.INDEX_DOUBTFUL in diagnostics.warnings) == (index != GLASS_INDEX)
    assert (diagnostics.likelier_index is None) == (index == GLASS_INDEX)


def test_an_index_that_is_only_assumed_makes_way_for_a_likelier_one() -> None:
    capture, asked = blend(75.0, 128, refractive_index=1.8).capture, TOLD.replace(refractive_index=GLASS_INDEX)
    assumed, known = separate(capture, asked, stopping=QUICK), separated_as_glass(1.8)
    assert abs(assumed.scene.index - 1.8) < 2 * assumed.errors.refractive_index
    assert assumed.asked.refractive_index is None
    assert estimate(capture, asked).scene == assumed.scene
    assert assumed.diagnostics.likelier_index is None
    assert (known.scene.index, known.errors.refractive_index) == (GLASS_INDEX, None)
    water = estimate(capture, TOLD.replace(refractive_index=1.33))
    assert water.scene.index == 1.33


def test_edges_alone_do_not_speak_against_an_index() -> None:
    # Low bits and ghosts that lie close together: with index 2 the edges overlap less, the spectra are less likely.
    window = window_of(210, 192)
    window = replace(window, scene=window.scene.replace(refractive_index=GLASS_INDEX), index_told=GLASS_INDEX)
    capture = window.sample(None, 192).capture
    asked = SceneParameters(None, None, None)
    found = find_scene(capture, asked, window.taking.noise, "ghosts")
    assert likelier_index(capture, found.scene, window.taking.noise) is None


@pytest.mark.parametrize(("gain", "told", "sure"), [(3.4, False, False), (3.6, True, False), (7.1, True, True)])
def test_the_limits_of_an_index_that_gradients_tell(
    gain: float, told: bool, sure: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside window glass, which most panes are of."""

    class Gradients:
        def __init__(self, frame: object, scene: SceneParameters) -> None:
            pass

        def cost(self, index: float) -> float:
            return 100 * (index - 1.65) ** 2 * gain / 2.25

        def incidence(self, index: float) -> float:
            return 40.0

        glanced, nearest = refractive_index._IndexGradients.glanced, refractive_index._IndexGradients.nearest
        _scene = SceneParameters(40.0, 20.0, 0.0)

    monkeypatch.setattr(refractive_index, "_IndexGradients", Gradients)
    monkeypatch.setattr(refractive_index, "noise_of_mirrored", lambda frame, scene: 0.0)
    found = refractive_index._told_by_gradients(None, Gradients._scene, 3.5)  # type: ignore[arg-type]
    assert (found is not None) == told
    if found is not None:
        assert found.index == pytest.approx(1.65, abs=0.01)
        assert found.sure == sure


def test_an_incidence_that_drifts_where_edges_overlap_less_and_less_speaks_for_no_index(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In noise: only as far as it makes the pane of the index that was told no less likely."""

    def judged(frame: object, scene: SceneParameters, **of: object) -> LikelyWindow:
        lower = max(1.0, scene.values()[0] - 1.4)
        # The index that was told suits best at 24 degrees, others about as well at theirs.
        score = 0.004 * (24.0 - lower) if scene.index == 1.5 else -0.0035
        return LikelyWindow(Window(lower, 0.0), score, score, (np.array([score] * 3), np.zeros(3)))

    monkeypatch.setattr(refractive_index, "judged_pane", judged)
    monkeypatch.setattr(refractive_index, "cross_spectra", lambda frame: None)
    assert refractive_index._told_by_spectra(None, SceneParameters(25.4, 20.0, 0.0)) is None  # type: ignore[arg-type]
