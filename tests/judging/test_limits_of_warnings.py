"""Every limit of a warning: just within it nothing is said, just beyond it the warning is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polaropt import Capture, SeparationWarning
from polaropt.capture import Mistakes
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.estimation.safeguard import correction, with_incidence_checked
from polaropt.judging.loss import SceneLoss
from polaropt.judging.warnings import diagnose
from polaropt.optics import Rival, SceneParameters
from tests.blends import blend

UNCERTAIN = SceneLoss(8.0, 8.0, 0.51, "incidence_deg", 0.2)
# Of each warning what is told of a solution: within the limit, beyond it, and what else is the same in both.
LIMITS = {
    "a bad fit": ("MODEL_DOES_NOT_EXPLAIN", "misfit_ratio", 2.19, 2.21, {}),
    "light that is left": ("MODEL_DOES_NOT_EXPLAIN", "unexplained", 3.99, 4.01, {}),
    "an unknown reflection": ("REFLECTION_NOT_IDENTIFIABLE", "reflection_unknown", 0.859, 0.861, {}),
    "its noise": ("NOISE_TOO_HIGH", "reflection_unknown", 0.859, 0.861, {}),
    "noise of the transmission": ("NOISE_TOO_HIGH", "noise_share", 0.419, 0.421, {}),
    "an uncertain scene": (
        "SCENE_UNCERTAIN",
        "loss",
        replace(UNCERTAIN, chance=0.5),
        replace(UNCERTAIN, chance=0.51),
        {},
    ),
    "frontal, not told": ("NEAR_NORMAL", "incidence", 12.1, 11.9, {"reflection_unknown": 0.9}),
    "frontal, noisy": ("NEAR_NORMAL", "incidence", 12.1, 11.9, {"noise_share": 0.5}),
    "frontal, uncertain": ("NEAR_NORMAL", "incidence", 12.1, 11.9, {"loss": UNCERTAIN}),
    "grazing, noisy": ("GRAZING", "incidence", 83.9, 84.1, {"noise_share": 0.5}),
    "grazing, uncertain": ("GRAZING", "incidence", 83.9, 84.1, {"loss": UNCERTAIN}),
    "clipped": ("SATURATED", "clipped", 0.009, 0.011, {}),
    "rivals": ("POLARIZATION_DOUBTFUL", "rivals", 0.5, 0.51, {}),
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
        from polaropt.estimation import NOTABLE_STAKE

        told["estimate"] = replace(estimate_scene(capture, scene), axis_stake=value * NOTABLE_STAKE)
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


@pytest.mark.parametrize(("ratio", "doubtful"), [(0.69, False), (0.64, True), (1.31, False), (1.36, True)])
def test_the_limit_of_an_incidence_that_was_given(ratio: float, doubtful: bool) -> None:
    example = blend(40, 96)
    found = estimate_scene(example.capture, SceneParameters(None, None, None), noise=0.005).scene
    given = SceneParameters(at_correction(found, ratio), None, None)
    checked = with_incidence_checked(example.capture, given, 0.005)
    assert checked.doubtful is doubtful
    # Twice what is right is as far off as the plain intensity is: a third more does no such harm.
    assert not checked.harmful
    assert (checked.scene.azimuth_deg is None) is not doubtful


@pytest.mark.parametrize(("ratio", "harmful"), [(1.9, False), (2.5, True)])
def test_the_limit_of_an_incidence_that_does_harm(ratio: float, harmful: bool) -> None:
    example = blend(40, 96)
    found = estimate_scene(example.capture, SceneParameters(None, None, None), noise=0.005).scene
    given = SceneParameters(at_correction(found, ratio), None, None)
    assert with_incidence_checked(example.capture, given, 0.005).harmful is harmful


def at_correction(scene: SceneParameters, ratio: float) -> float:
    """Incidence whose pane corrects so many times as much as a scene's."""
    wanted = ratio * correction(scene)
    angles = np.linspace(5, 85, 3201)
    apart = [abs(correction(scene.replace(incidence_deg=float(angle), n_panes=1)) - wanted) for angle in angles]
    return float(angles[np.argmin(apart)])
