"""A wide lens together with light that arrives polarized: found as one scene, with honest errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from polaropt.capture.capture import Capture
from polaropt.capture.noise import noise_level
from polaropt.capture.polarization import StokesImages, stokes_images
from polaropt.estimation.polarized.lens import PolarizedPerspectiveFit, fit_polarized_perspective
from polaropt.judging.warnings import SeparationWarning
from polaropt.optics.engine import VaryingPSE
from polaropt.optics.scene import SceneParameters
from polaropt.separation import separate
from polaropt.simulation.metrics import psnr_db
from tests.blends import Blend, blend

SCREEN = {"transmission_polarization": (0.6, 140.0)}
SKY = {"reflection_polarization": (0.3, 70.0)}
PLAIN = SceneParameters(60.0, 25.0, 0.0)
IN_PLACE = SceneParameters(None, None, 0.0)


def wide(size: int = 128, **changes: object) -> Blend:
    return blend(**{"incidence_deg": 55.0, "size": size, "ghost_shift": 0.0, "focal_px": 1.25 * size, **changes})


def stokes_of(made: Blend) -> StokesImages:
    return stokes_images(made.capture, noise_level(made.capture))


def trivial_db(made: Blend) -> float:
    s0, s1, s2 = made.capture.stokes
    return max(psnr_db(image, made.layers[0], 16) for image in (s0, s0 - np.hypot(s1, s2)))


def test_polarized_light_before_a_wide_lens_is_separated() -> None:
    made = wide(96, **SCREEN, **SKY)
    result = separate(made.capture, IN_PLACE)
    assert result.scene.rung == "polarized"
    assert psnr_db(result.layers[0], made.layers[0], 16) > trivial_db(made) + 10
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN not in result.diagnostics.warnings
    assert SeparationWarning.POLARIZED_SOURCE in result.diagnostics.warnings


def within_errors(fit: PolarizedPerspectiveFit, true: SceneParameters, most: float) -> bool:
    """Whether all true numbers lie within so many standard errors."""
    found, errors, off = fit.scene, fit.errors, []
    for name in ("incidence_deg", "azimuth_deg", "focal_px"):
        if getattr(errors, name) is not None:
            off.append((getattr(found, name) - getattr(true, name)) / getattr(errors, name))
    for name in ("transmission_polarization", "reflection_polarization"):
        error, (degree, angle) = getattr(errors, name), getattr(true, name)
        if error and degree:
            off.append((getattr(found, name)[0] - degree) / error[0])
            off.append(((getattr(found, name)[1] - angle + 90) % 180 - 90) / error[1])
    return max(map(abs, off)) < most


@pytest.mark.parametrize(
    ("polarization", "focal_told"),
    [(SCREEN, False), (SCREEN | SKY, False), (SCREEN | SKY, True)],
    ids=["screen", "both", "both, focal length told"],
)
def test_the_true_numbers_lie_within_the_errors(polarization: dict[str, object], focal_told: bool) -> None:
    made = wide(**polarization)
    fit = fit_polarized_perspective(stokes_of(made), PLAIN, made.scene.focal_px if focal_told else None)
    assert fit.misfit == pytest.approx(1, abs=0.1)
    assert within_errors(fit, made.scene, 3.5)
    assert (fit.errors.focal_px is None) == focal_told


def test_light_is_said_to_be_polarized_in_no_more_layers_than_needed() -> None:
    fit = fit_polarized_perspective(stokes_of(wide(**SCREEN)), PLAIN)
    assert fit.scene.reflection_polarization == (0.0, 0.0)
    assert fit.errors.reflection_polarization is None
    assert fit.n_parameters == 5


def test_water_before_a_wide_lens_mirrors_the_sky() -> None:
    made = wide(**SKY, single_surface=True, refractive_index=1.33)
    fit = fit_polarized_perspective(stokes_of(made), made.scene)
    assert fit.scene.incidence_deg == pytest.approx(55, abs=0.5)
    assert fit.scene.reflection_polarization == pytest.approx((0.3, 70.0), abs=1)


def test_a_fit_tells_where_a_layer_would_have_less_than_no_light() -> None:
    made = wide(**SKY)
    seen = stokes_of(made)
    assert fit_polarized_perspective(seen, PLAIN).negative == 0
    angles_deg = made.capture.angles_deg
    behind = VaryingPSE(made.scene, angles_deg).forward(np.stack([made.layers[0], 0 * made.layers[1]]))
    less = stokes_images(Capture.of_planes(behind, angles_deg), 0.002).images
    images = seen.images.copy()
    images[..., :40, :64] -= 1.3 * less[..., :40, :64]
    fit = fit_polarized_perspective(dataclasses.replace(seen, images=images), PLAIN)
    assert fit.negative == pytest.approx(40 * 64 / 128**2, abs=0.05)


def test_the_rung_can_be_asked_for_and_ghosts_beside_their_place_do_little_harm() -> None:
    made = wide(96, **SKY, ghost_shift=5.3)
    result = separate(made.capture, IN_PLACE, model="polarized")
    assert result.scene.focal_px == pytest.approx(made.scene.focal_px, rel=0.1)
    assert psnr_db(result.layers[0], made.layers[0], 16) > trivial_db(made) + 8


def test_polarized_light_behind_a_bent_pane_is_announced() -> None:
    # No rung knows both.
    made = wide(96, transmission_polarization=(0.3, 110.0), bend_deg_per_px=(-0.15, 0.1, 0.1))
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN in separate(made.capture, IN_PLACE).diagnostics.warnings
