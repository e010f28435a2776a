"""Every limit of a warning: just within it nothing is said, just beyond it the warning is."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import brentq

from polaropt import Capture, SeparationWarning, separate
from polaropt.capture import Mistakes, stokes_images
from polaropt.estimation import likelier_index, still_photographs, with_index
from polaropt.estimation.angles import GhostDirection
from polaropt.estimation.flat.azimuth import principal_axis
from polaropt.estimation.flat.estimate import SceneEstimate, estimate_scene
from polaropt.estimation.flat.windows.search import LikelyWindow
from polaropt.estimation.safeguard import correction, with_incidence_checked
from polaropt.judging.loss import SceneLoss
from polaropt.judging.warnings import diagnose
from polaropt.numerics import jackknife_error
from polaropt.optics import Rival, SceneParameters
from tests.blends import Blend, blend

BLIND = SceneParameters(None, None, None)
UNCERTAIN = SceneLoss(8.0, 8.0, 0.51, "incidence_deg", 0.2)
# Of each warning what is told of a solution: within the limit, beyond it, and what else is the same in both.
LIMITS = {
    "a bad fit": ("MODEL_DOES_NOT_EXPLAIN", "misfit_ratio", 2.19, 2.21, {}),
    "light that is left": ("MODEL_DOES_NOT_EXPLAIN", "unexplained", 3.99, 4.01, {}),
    "an unknown reflection": ("REFLECTION_NOT_IDENTIFIABLE", "reflection_unknown", 0.859, 0.861, {}),
    "its noise": ("NOISE_TOO_HIGH", "reflection_unknown", 0.859, 0.861, {}),
    "noise of samples": ("NOISE_TOO_HIGH", "gain_of_less_noise", 1.24, 1.26, {"reflection_unknown": 0.9}),
    "samples that hide": ("UNDERSAMPLED", "gain_of_less_noise", 1.26, 1.24, {"reflection_unknown": 0.9}),
    "their reflection": ("UNDERSAMPLED", "reflection_unknown", 0.859, 0.861, {"gain_of_less_noise": 1.0}),
    "their transmission": ("UNDERSAMPLED", "noise_share", 0.419, 0.421, {"gain_of_less_noise": 1.0}),
    "noise of the transmission": ("NOISE_TOO_HIGH", "noise_share", 0.419, 0.421, {}),
    "an uncertain scene": (
        "SCENE_UNCERTAIN",
        "loss",
        replace(UNCERTAIN, chance=0.49),
        replace(UNCERTAIN, chance=0.5),
        {},
    ),
    "frontal, not told": ("NEAR_NORMAL", "incidence", 12.1, 11.9, {"reflection_unknown": 0.9}),
    "frontal, noisy": ("NEAR_NORMAL", "incidence", 12.1, 11.9, {"noise_share": 0.5}),
    "frontal, uncertain": ("NEAR_NORMAL", "incidence", 12.1, 11.9, {"loss": UNCERTAIN}),
    "grazing, noisy": ("GRAZING", "incidence", 83.9, 84.1, {"noise_share": 0.5}),
    "grazing, uncertain": ("GRAZING", "incidence", 83.9, 84.1, {"loss": UNCERTAIN}),
    "clipped": ("SATURATED", "clipped", 0.009, 0.011, {}),
    "rivals": ("POLARIZATION_DOUBTFUL", "rivals", 0.49, 0.5, {}),
    "a pane across": ("AXIS_DOUBTFUL", "axis", 0.99, 1.0, {}),
    "shifted": ("MISALIGNED", "mistakes", Mistakes(shift_px=0.49), Mistakes(shift_px=0.51), {}),
    "encoded": ("GAMMA_ENCODED", "mistakes", Mistakes(gamma=1.0), Mistakes(gamma=1.01), {}),
    "in a wrong order": ("ANGLES_SWAPPED", "mistakes", Mistakes(), Mistakes(swapped=True), {}),
    "gains apart": ("MODEL_DOES_NOT_EXPLAIN", "apart", 0.95, 1.05, {}),
}


def said(what: str, value: object, more: dict[str, object], patch: pytest.MonkeyPatch) -> set[SeparationWarning]:
    """Warnings of a good capture, of which one thing is changed."""
    example = blend(60, 64)
    capture, scene = example.capture, example.scene
    told = {"misfit_ratio": 1.0, "reflection_unknown": 0.3, "estimate": None, **more}
    if what == "incidence":
        scene = scene.replace(incidence_deg=value)
    elif what == "clipped":
        valid = np.ones(capture.valid.shape, bool)
        valid.reshape(-1)[: round(value * valid.size)] = False
        capture = Capture.of_planes(capture.intensities, valid=valid)
    elif what == "rivals":
        scene = scene.replace(transmission_polarization=(0.5, 30.0))
        told["estimate"] = replace(estimate_scene(capture, scene), rivals=(Rival(scene, 0.5),))
        told["loss"] = replace(UNCERTAIN, chance=value)
    elif what == "axis":
        from polaropt.estimation import NOTABLE_CHANCE

        told["estimate"] = replace(estimate_scene(capture, scene), axis_chance=value * NOTABLE_CHANCE)
    elif what == "apart":
        # Light that pairs do not add up by, as a part of what is polarized.
        patch.setattr("polaropt.judging.warnings.closure_share", lambda *_: value * 0.1 * polarized_share(capture))
    else:
        told[what] = value
    return set(diagnose(capture, 0.005, scene=scene, **told).warnings)


def polarized_share(capture: Capture) -> float:
    light, *polarized = capture.stokes.reshape(3, *capture.shape[:-2], 8, 8, 8, 8).mean(axis=(-3, -1))
    return float(np.sqrt(np.square(polarized).sum(axis=0).mean() / np.square(light).mean()))


@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_of_a_warning(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    warning, what, within, beyond, more = LIMITS[name]
    assert SeparationWarning[warning] not in said(what, within, more, monkeypatch)
    assert SeparationWarning[warning] in said(what, beyond, more, monkeypatch)


@lru_cache
def pane_at_40() -> tuple[Blend, SceneParameters]:
    """Photographs, and what is found of them."""
    example = blend(40, 96)
    return example, estimate_scene(example.capture, BLIND, noise=0.005).scene


@pytest.mark.parametrize(("ratio", "doubtful"), [(0.69, False), (0.64, True), (1.31, False), (1.36, True)])
def test_the_limit_of_an_incidence_that_was_given(ratio: float, doubtful: bool) -> None:
    example, found = pane_at_40()
    given = SceneParameters(at_correction(found, ratio), None, None)
    checked = with_incidence_checked(example.capture, given, 0.005)
    assert checked.doubtful is doubtful
    # Twice what is right is as far off as the plain intensity is: a third more does no such harm.
    assert not checked.harmful
    assert (checked.scene.azimuth_deg is None) is not doubtful


@pytest.mark.parametrize(("ratio", "harmful"), [(1.9, False), (2.5, True)])
def test_the_limit_of_an_incidence_that_does_harm(ratio: float, harmful: bool) -> None:
    example, found = pane_at_40()
    given = SceneParameters(at_correction(found, ratio), None, None)
    assert with_incidence_checked(example.capture, given, 0.005).harmful is harmful


def at_correction(scene: SceneParameters, ratio: float) -> float:
    """Incidence whose pane corrects so many times as much as a scene's."""
    wanted = ratio * correction(scene)
    angles = np.linspace(5, 85, 3201)
    apart = [abs(correction(scene.replace(incidence_deg=float(angle), n_panes=1)) - wanted) for angle in angles]
    return float(angles[np.argmin(apart)])


@pytest.mark.parametrize(("errors", "polarized"), [(9.5, False), (10.5, True)])
def test_the_limit_of_polarization(errors: float, polarized: bool) -> None:
    capture = blend(60, 64).capture
    grey = capture.intensities.mean(axis=0)
    noise = np.random.default_rng(0).normal(0, 0.005, capture.intensities.shape)

    def faded(share: float) -> Capture:
        images = grey + share * (capture.intensities - grey) + noise
        return Capture.of_planes(images.astype(np.float32), capture.angles_deg)

    def snr(share: float) -> float:
        return principal_axis(stokes_images(faded(share), 0.005)).snr

    share = brentq(lambda x: snr(x) - errors, 0.0, 0.2, xtol=1e-4)
    assert snr(share) == pytest.approx(errors, abs=0.3)
    assert estimate_scene(faded(share), noise=0.005).polarization_snr == pytest.approx(errors, abs=0.3)
    said = separate(faded(share), BLIND).diagnostics.warnings
    assert (SeparationWarning.NO_POLARIZATION in said) is not polarized


DIRECTION = GhostDirection(25.0, 25.0, 50.0, 0.1, 0.01, 0.008, 12.0, 0.1)
# Of ghosts in a direction: what is so within the limit, beyond it, and what else; and what is then said.
DIRECTIONS = {
    "beside the azimuth": ({"direction_deg": 29.9}, {"direction_deg": 30.1}, "ANGLES_ROTATED"),
    "on the other side": ({"direction_deg": 148.9}, {"direction_deg": 149.1}, "ANGLES_REVERSED"),
    "too few": ({"gain": 0.0079}, {"gain": 0.0081}, "ANGLES_ROTATED"),
    "a rival": ({"rival": 0.0601}, {"rival": 0.0599}, "ANGLES_ROTATED"),
    "hardly aside": ({"shift_px": 1.38}, {"shift_px": 1.41}, "ANGLES_ROTATED"),
    "unsteady": ({"shift_error_px": 0.31}, {"shift_error_px": 0.29}, "ANGLES_ROTATED"),
    "faint": ({"incidence_deg": 31.9}, {"incidence_deg": 32.1}, "ANGLES_ROTATED"),
    "steep": ({"incidence_deg": 76.1}, {"incidence_deg": 75.9}, "ANGLES_ROTATED"),
}


@lru_cache
def pane_at_50() -> tuple[Capture, SceneEstimate]:
    """Photographs, and what is found of them."""
    capture = blend(50, 64).capture
    return capture, estimate_scene(capture, noise=0.005)


@pytest.mark.parametrize("name", DIRECTIONS)
def test_the_limit_of_a_direction(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    within, beyond, warning = DIRECTIONS[name]
    capture, estimate = pane_at_50()
    elsewhere = DIRECTION if "direction_deg" in within else replace(DIRECTION, direction_deg=60.0, rival=0.001)

    def said(changes: dict[str, float]) -> set[SeparationWarning]:
        found = replace(elsewhere, **changes)
        monkeypatch.setattr("polaropt.estimation.angles.ghost_direction", lambda *_: found)
        return set(diagnose(capture, 0.005, misfit_ratio=1.0, reflection_unknown=0.3, estimate=estimate).warnings)

    assert SeparationWarning[warning] not in said(within)
    assert SeparationWarning[warning] in said(beyond)


@pytest.mark.parametrize(("gain", "error", "said"), [
    (0.0039, 0.0, False), (0.0041, 0.0, True), (0.024, 0.01, False), (0.026, 0.01, True),
])  # fmt: skip
def test_the_limit_of_an_index(gain: float, error: float, said: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """By how much a pane of another index must be likelier: at least, and in standard errors of it."""
    # Without double images, by which tiles would tell it.
    example = blend(60, 64, ghost_shift=0.0)

    def judged(_frame: object, scene: SceneParameters, **_: object) -> LikelyWindow:
        worse = gain * abs(scene.index - 1.6) / 0.1
        # A part left out moves the score of the index told alone.
        spread = jackknife(error) if scene.index == 1.5 else np.zeros(4)
        return LikelyWindow(scene, worse, worse, (spread, np.zeros(4)))

    def jackknife(of: float) -> np.ndarray:
        parts = np.array([-1.0, -1.0, 1.0, 1.0])
        return of * parts / jackknife_error(parts)

    monkeypatch.setattr("polaropt.estimation.refractive_index.judged_pane", judged)
    likelier = likelier_index(example.capture, example.scene, 0.005)
    assert (likelier is not None) is said
    told = diagnose(
        example.capture, 0.005, misfit_ratio=1.0, reflection_unknown=0.3, estimate=None, likelier_index=likelier
    )
    assert (SeparationWarning.INDEX_DOUBTFUL in told.warnings) is said


@pytest.mark.parametrize(("errors", "coated"), [(2.9, False), (3.1, True)])
def test_the_limit_of_colours_that_tell_of_other_panes(
    errors: float, coated: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = blend(60, 64).capture
    of_color = iter([60.0, 60.0, 60.0 + errors * math.hypot(0.3, 0.3)])
    of_all: list[SceneEstimate] = []

    def estimated(part: Capture, *arguments: object, **options: object) -> SceneEstimate:
        if part.color:
            of_all.append(estimate_scene(part, *arguments, **options))
            return of_all[-1]
        found = of_all[-1]
        scene = found.scene.replace(incidence_deg=next(of_color))
        return replace(found, scene=scene, errors=replace(found.errors, incidence_deg=0.3))

    monkeypatch.setattr("polaropt.estimation.refractive_index.estimate_scene", estimated)
    # Azimuth and ghosts are told to be fast.
    fit = with_index(capture, SceneParameters(None, 25.0, 5.3, None), 0.005)
    assert fit.coated is coated
    said = diagnose(capture, 0.005, misfit_ratio=1.0, reflection_unknown=0.3, estimate=None, coated=fit.coated)
    assert (SeparationWarning.COATED in said.warnings) is coated


@pytest.mark.parametrize(("errors", "side", "moves"), [(5.5, 16, False), (6.5, 16, True), (6.5, 12, False)])
def test_the_limit_of_what_moves(errors: float, side: int, moves: bool) -> None:
    """A square of 16 blocks or more is seen from 6 standard errors of its mean on."""
    noise, light = 0.005, 0.4
    down, across = np.mgrid[:96, :96] / 96 - 0.5
    wave = 0.05 * np.sin(9 * across + 5 * down)
    # The light and both of its polarized parts vary, so that wrong gains of a filter would show everywhere.
    photographs = light + 0.1 * across + np.stack([0.1 * down, wave, -0.1 * down, -wave])
    # Beside the noise photographs may be off by 0.5 % of the light and 0.3 % of its mean.
    error = math.hypot(noise / side, 0.005 * light, 0.003 * light)
    # Of what one photograph changes by, the closure fails by half.
    photographs[1, 40 : 40 + side, 40 : 40 + side] += 2 * errors * error
    photographs += np.random.default_rng(1).normal(0, noise, photographs.shape)
    capture = Capture.of_planes(photographs.astype(np.float32)[:, None])
    found = still_photographs(capture)
    assert (found.moving is not None) is moves
    said = diagnose(found.capture, noise, misfit_ratio=1.0, reflection_unknown=0.3, estimate=None, moving=found.moving)
    assert (SeparationWarning.MOVING in said.warnings) is moves
