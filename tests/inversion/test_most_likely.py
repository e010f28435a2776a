"""The most likely layers behind a pane that varies: the equations that they solve, and what they gain."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import irfft2, rfft2

from polaropt import StoppingRule, Weights, separate
from polaropt.inversion.most_likely import _scale_of, _SlowChanges, _System
from polaropt.solving.problem import Problem
from priors.natural_image import in_basis
from tests.blends import blend


def problem_of(size=72, *, color=True, noise=0.005, incidence_deg=35.0, **scene):
    example = blend(incidence_deg, size, color=color, noise=noise, **{"focal_px": 60.0, **scene})
    return example, Problem(example.capture, example.scene, noise, Weights())


def off_mean_and_pull(problem, layers):
    """Layers off their mean, in the colour basis, and the slope of the spectral prior there."""
    known = problem.known
    own = in_basis(known.basis.astype(np.float32), layers, np) - known.mean
    return own, irfft2(rfft2(own, norm="ortho") / known.prior, s=problem.canvas.shape, norm="ortho")


def slope(problem, layers):
    """Of what the most likely layers minimize, in the colour basis."""
    _, pull = off_mean_and_pull(problem, layers)
    return in_basis(problem.known.basis.astype(np.float32), problem.slope_of_misfit(layers), np) + pull


def value(problem, layers):
    own, pull = off_mean_and_pull(problem, layers)
    return problem._misfit_of(layers) + 0.5 * float(np.sum(own * pull, dtype=np.float64))


@pytest.mark.parametrize("shift", [0.0, 4.0])
@pytest.mark.parametrize("color", [False, True])
def test_the_most_likely_layers_lie_near_the_lowest_point(shift, color):
    """Whatever step is taken from them along their own slope gains little beside what they gained."""
    _, problem = problem_of(color=color, ghost_shift=shift)
    before = problem.closed_form().layers
    found = problem.known.layers
    gained = value(problem, before) - value(problem, found)
    downhill = -slope(problem, found)
    curved = slope(problem, found + downhill) + downhill
    step = float((downhill**2).sum()) / float((downhill * curved).sum())
    still = value(problem, found) - value(
        problem, found + np.float32(step) * in_basis(problem.known.basis.T, downhill, np)
    )
    assert gained > 0
    assert still < 0.05 * gained


@pytest.mark.parametrize("shift", [0.0, 4.0])
def test_the_equations_of_slow_changes_are_those_of_the_whole(shift):
    """What the whole system makes of a slow change leads back to it."""
    _, problem = problem_of(color=False, ghost_shift=shift)
    known, canvas = problem.known, problem.canvas
    told = problem._told_of_stokes(problem.pse)
    scale = _scale_of(problem.pse, canvas, told)
    system = _System(known, canvas, scale, problem.slope_of_misfit)
    slow = _SlowChanges(known, canvas, problem.pse, told)
    spectrum = rfft2(np.random.default_rng(2).standard_normal((2, 1, *canvas.shape)))
    kept = np.zeros_like(spectrum)
    kept[(..., *slow.places)] = spectrum[(..., *slow.places)]
    change = irfft2(kept, canvas.shape).astype(np.float32)
    made = system.applied(change / scale)
    off = slow.solved(made / scale) / scale - change / scale
    # In the length of the system, which photographs tell: what they do not tell single precision does not, either.
    assert np.vdot(off, system.applied(off)) < 1e-5 * np.vdot(change / scale, made)


def test_seen_from_afar_they_are_those_of_a_pane_that_is_the_same_everywhere():
    example, far = problem_of(64, color=False, incidence_deg=60.0, focal_px=1e6, ghost_shift=3.0)
    flat = Problem(example.capture, example.scene.replace(focal_px=None), 0.005, Weights())
    found, same = (problem.canvas.crop(problem.known.layers) for problem in (far, flat))
    np.testing.assert_allclose(found[0, :, 8:-8, 8:-8], same[0, :, 8:-8, 8:-8], atol=0.01)
    np.testing.assert_allclose(found[1, :, 8:-8, 8:-8], same[1, :, 8:-8, 8:-8], atol=0.1)


def test_pixels_that_are_not_trusted_are_left_out():
    """Unlike filters, the equations know which photographs are trusted."""
    example, _ = problem_of(64, color=False)
    intensities, valid = example.capture.intensities.copy(), example.capture.valid.copy()
    intensities[:, 30:33, 30:33], valid[:, 30:33, 30:33] = 1.0, False
    spoilt = example.capture.replace(intensities=intensities, valid=valid)
    layers = [Problem(capture, example.scene, 0.005, Weights()) for capture in (example.capture, spoilt)]
    kept, without = (problem.canvas.crop(problem.known.layers)[0, 0] for problem in layers)
    elsewhere = np.ones_like(kept, dtype=bool)
    elsewhere[26:37, 26:37] = False
    assert np.abs(kept - without)[elsewhere].max() < 0.02


def test_less_noise_is_no_worse_behind_a_wide_lens():
    """With a third of the noise the transmission was 12 dB worse: filters of places spread what is unexplained."""
    ends = []
    for noise in (0.0045, 0.0015):
        example, _ = problem_of(128, noise=noise, ghost_shift=3.7, focal_px=78.0)
        found = separate(example.capture, scene=example.scene, stopping=StoppingRule(60)).layers
        inner = (..., slice(16, -16), slice(16, -16))
        ends.append(np.mean((found[0] - example.layers[0])[inner] ** 2))
    assert ends[1] < ends[0]
