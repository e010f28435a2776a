"""Compiled passes over frequencies: two layers of given spectra behind a pane, seen in all three Stokes components.

At each frequency the whitened data are ``y = a t + b r + noise`` with complex three-vectors a and b and unit noise.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.flat.gradients import FREEDOM
from solvers.ahead import Call
from solvers.kernels import compiled, inlined

Array = NDArray[Any]

_SURPRISE = FREEDOM + 3.0
"""Exponent of Student's density of three complex numbers, the Stokes components."""


class WhitenedSpectra(NamedTuple):
    """What is seen at the frequencies."""

    re: Array
    im: Array
    """Whitened Stokes spectra, (3, channel, n)."""
    power: Array
    """Sum of their squares, (channel, n)."""
    weight: Array
    """How much a frequency counts in the likelihood, (n,)."""


@compiled
def pane_vectors(mixing: Array, light: Array, cosine: Array, sine: Array, out: Array) -> None:
    """Vectors a and b at each frequency into `out` (n, layer, component, re/im).

    `mixing` (3, 3) leads from the plate's entries to the whitened components, `light` (layer, entry, 3) holds direct
    light, first ghost and the ratio of ghosts; the phase of one ghost step is told by its cosine and sine (n,).
    The sum over all ghosts is `polaropt.optics.ghost_sum`, written out for the compiler.
    """
    for n in range(cosine.size):
        for layer in range(2):
            out[n, layer] = 0.0
            for e in range(3):
                direct, ghost, ratio = light[layer, e]
                size = ghost / (1.0 - 2.0 * ratio * cosine[n] + ratio * ratio)
                re, im = direct + (cosine[n] - ratio) * size, -sine[n] * size
                for i in range(3):
                    out[n, layer, i, 0] += mixing[i, e] * re
                    out[n, layer, i, 1] += mixing[i, e] * im


@inlined
def _gram(pane: Array) -> tuple[float, float, float, float]:
    """``|a|^2, |b|^2`` and the real and imaginary part of ``a^H b``."""
    a_a, b_b, re, im = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        a_re, a_im, b_re, b_im = pane[0, i, 0], pane[0, i, 1], pane[1, i, 0], pane[1, i, 1]
        a_a += a_re * a_re + a_im * a_im
        b_b += b_re * b_re + b_im * b_im
        re += a_re * b_re + a_im * b_im
        im += a_re * b_im - a_im * b_re
    return a_a, b_b, re, im


@inlined
def _along(pane: Array, seen_re: Array, seen_im: Array, n: int) -> tuple[float, float]:
    """What a vector has in common with the data, ``a^H y``."""
    re, im = 0.0, 0.0
    for i in range(3):
        x, y = seen_re[i, n], seen_im[i, n]
        re += pane[i, 0] * x + pane[i, 1] * y
        im += pane[i, 0] * y - pane[i, 1] * x
    return re, im


@inlined
def _estimate(gram: tuple[float, float, float, float], along: Array, powers: Array, out: Array) -> float:
    """Wiener estimate of both layers into `out` (layer, re/im), its variances into `along` row 2, and the determinant.

    `along` (3, 2) holds what both vectors have in common with the data, `powers` (2,) those of the layers.
    """
    a_a, b_b, k_re, k_im = gram
    h_t, h_r = a_a + 1.0 / powers[0], b_b + 1.0 / powers[1]
    det = h_t * h_r - k_re * k_re - k_im * k_im
    scale = 1.0 / det
    out[0, 0] = (h_r * along[0, 0] - k_re * along[1, 0] + k_im * along[1, 1]) * scale
    out[0, 1] = (h_r * along[0, 1] - k_re * along[1, 1] - k_im * along[1, 0]) * scale
    out[1, 0] = (h_t * along[1, 0] - k_re * along[0, 0] - k_im * along[0, 1]) * scale
    out[1, 1] = (h_t * along[1, 1] - k_re * along[0, 1] + k_im * along[0, 0]) * scale
    along[2, 0], along[2, 1] = h_r * scale, h_t * scale
    return float(det)


@compiled
def explain(seen: WhitenedSpectra, pane: Array, powers: Array, slope: Array, layers: Array) -> float:
    """Minus log likelihood of the layers' powers (layer, channel, n), up to a constant.

    `slope` (2, layer, channel, n) becomes what speaks for more and what for less power, unless it is empty, and
    `layers` (n, layer, re/im) the Wiener estimate of the first channel's spectra.
    """
    total, fitting = 0.0, slope.size > 0
    along, estimate, power = np.empty((3, 2)), np.empty((2, 2)), np.empty(2)
    for n in range(seen.weight.size):
        gram = _gram(pane[n])
        volume, tails = 1.0, 1.0
        for c in range(powers.shape[1]):
            left = seen.power[c, n]
            for i in range(2):
                along[i, 0], along[i, 1] = _along(pane[n, i], seen.re[:, c], seen.im[:, c], n)
                power[i] = powers[i, c, n]
            volume *= _estimate(gram, along, power, estimate) * power[0] * power[1]
            for i in range(2):
                left -= along[i, 0] * estimate[i, 0] + along[i, 1] * estimate[i, 1]
            left = FREEDOM + max(left, 0.0)
            tails *= left
            for i in range(2):
                if fitting:
                    square = estimate[i, 0] * estimate[i, 0] + estimate[i, 1] * estimate[i, 1]
                    scale = seen.weight[n] / power[i]
                    slope[0, i, c, n] = scale * _SURPRISE / left * square / power[i]
                    slope[1, i, c, n] = scale * (1.0 - along[2, i] / power[i])
                if c == 0:
                    layers[n, i, 0], layers[n, i, 1] = estimate[i, 0], estimate[i, 1]
        total += seen.weight[n] * (np.log(volume) + _SURPRISE * np.log(tails))
    return total


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that polarized light needs, for `solvers.ahead`."""
    one, spectra, pane = np.ones(1), np.zeros((3, 1, 1)), np.zeros((1, 2, 3, 2))
    seen = WhitenedSpectra(spectra, spectra.copy(), np.zeros((1, 1)), one)
    powers, slope = np.ones((2, 1, 1), np.float32), np.zeros((2, 2, 1, 1), np.float32)
    return [
        (explain, (seen, pane, powers, slope, np.zeros((1, 2, 2), np.float32))),
        (pane_vectors, (np.eye(3), np.zeros((2, 3, 3)), one, one.copy(), pane.copy())),
    ]
