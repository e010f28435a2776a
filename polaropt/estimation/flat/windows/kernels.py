"""Compiled likelihood of trial windows: spectra of both layers that are fitted to a capture's mean spectra.

What `polaropt.estimation.flat.ghosts.ShiftLikelihood` does for one line of ghosts, for images at any places.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solvers.kernels import compiled

Array = NDArray[Any]


class Seen(NamedTuple):
    """What is known of a capture at each of n frequencies, float32."""

    along: Array
    across: Array
    """Angular frequency along and across the azimuth, (n,)."""
    multiplicity: Array
    shapes: Array
    """Natural images' power split into levels, (level, n)."""
    data: Array
    """Mean spectra: par, perp, and the real and imaginary part of their cross spectrum, (4, n)."""
    noise: Array
    """par, perp and cross, (3,)."""


class Lags(NamedTuple):
    """Where images of a layer lie from each other, for every kind of window and both layers: [0] transmission."""

    orders: Array
    """Shifts of a pane and of a gap between two images, (kind, 2, lag, 2)."""
    weights: Array
    """Of cosines in par, perp and cross, and of the sine in cross, (kind, 2, lag, 4)."""


@compiled
def _powers(phase: Array, cosines: Array, sines: Array) -> None:
    """Cosine and sine of 0, 1, ... times a phase (n,), each (order, n)."""
    for f in range(phase.size):
        cosines[0, f], sines[0, f] = np.float32(1), np.float32(0)
        cosines[1, f], sines[1, f] = np.cos(phase[f]), np.sin(phase[f])
    for k in range(2, len(cosines)):
        for f in range(phase.size):
            cosines[k, f] = cosines[k - 1, f] * cosines[1, f] - sines[k - 1, f] * sines[1, f]
            sines[k, f] = sines[k - 1, f] * cosines[1, f] + cosines[k - 1, f] * sines[1, f]


@compiled
def _response(orders: Array, weights: Array, common: Array, pane: Array, gap: Array, out: Array) -> None:
    """Outer product of a layer's transfer functions: par, perp, cross (real, imaginary) into out (4, n)."""
    out[:] = 0
    for k in range(len(orders)):
        w = weights[k]
        if w[0] == 0 and w[1] == 0 and w[2] == 0:
            continue
        i, j = orders[k, 0], abs(orders[k, 1])
        sign = np.float32(1) if orders[k, 1] >= 0 else np.float32(-1)
        p, q, s, d = common[k] * w[0], common[k] * w[1], common[k] * w[2], common[k] * w[3]
        pane_cos, pane_sin, gap_cos, gap_sin = pane[0, i], pane[1, i], gap[0, j], gap[1, j]
        for f in range(out.shape[1]):
            cosine = pane_cos[f] * gap_cos[f] - sign * pane_sin[f] * gap_sin[f]
            sine = pane_sin[f] * gap_cos[f] + sign * pane_cos[f] * gap_sin[f]
            out[0, f] += p * cosine
            out[1, f] += q * cosine
            out[2, f] += s * cosine
            out[3, f] -= d * sine


@compiled
def _dot(a0: Any, a1: Any, a2: Any, a3: Any, b0: Any, b1: Any, b2: Any, b3: Any) -> Any:
    """Trace of the adjugate of one Hermitian matrix times another."""
    return a0 * b1 + a1 * b0 - np.float32(2) * (a2 * b2 + a3 * b3)


@compiled
def _products(layers: Array, seen: Seen, out: Array) -> None:
    """Products of transmission B, reflection A, noise N and data D: aa, bb, ab, an, bn, ad, bd, nn, nd, (9, n)."""
    b, a, d, n = layers[0], layers[1], seen.data, seen.noise
    zero = np.float32(0)
    for f in range(out.shape[1]):
        a0, a1, a2, a3 = a[0, f], a[1, f], a[2, f], a[3, f]
        b0, b1, b2, b3 = b[0, f], b[1, f], b[2, f], b[3, f]
        d0, d1, d2, d3 = d[0, f], d[1, f], d[2, f], d[3, f]
        out[0, f] = max(_dot(a0, a1, a2, a3, a0, a1, a2, a3), np.float32(2e-6) * a0 * a1)
        out[1, f] = max(_dot(b0, b1, b2, b3, b0, b1, b2, b3), np.float32(2e-6) * b0 * b1)
        out[2, f] = max(_dot(a0, a1, a2, a3, b0, b1, b2, b3), zero)
        out[3, f] = _dot(a0, a1, a2, a3, n[0], n[1], n[2], zero)
        out[4, f] = _dot(b0, b1, b2, b3, n[0], n[1], n[2], zero)
        out[5, f] = _dot(a0, a1, a2, a3, d0, d1, d2, d3)
        out[6, f] = _dot(b0, b1, b2, b3, d0, d1, d2, d3)
        out[7, f] = _dot(n[0], n[1], n[2], zero, n[0], n[1], n[2], zero)
        out[8, f] = _dot(n[0], n[1], n[2], zero, d0, d1, d2, d3)


@compiled
def _model(of: Array, shapes: Array, levels: Array, out: Array) -> None:
    """A.M, B.M, det M and the data's squared distance from M, (4, n), at levels (2, level), reflection first."""
    for f in range(out.shape[1]):
        p, q = np.float32(0), np.float32(0)
        for s in range(len(shapes)):
            p += levels[0, s] * shapes[s, f]
            q += levels[1, s] * shapes[s, f]
        a = p * of[0, f] + q * of[2, f] + of[3, f]
        b = q * of[1, f] + p * of[2, f] + of[4, f]
        determinant = np.float32(0.5) * (p * (a + of[3, f]) + q * (b + of[4, f]) + of[7, f])
        out[0, f], out[1, f], out[2, f] = a, b, determinant
        out[3, f] = (p * of[5, f] + q * of[6, f] + of[8, f]) / determinant


@compiled
def window_misfits(
    trials: Array,
    kinds: Array,
    lags: Lags,
    common: Array,
    seen: Seen,
    freedom: Any,
    least: Any,
    rounds: int,
    first: Any,
    out: Array,
    start: int,
    stop: int,
) -> None:
    """Minus log likelihood per frequency of trials start..stop into `out`.

    Shapes: trials (trial, 3) shift of a pane, of a gap along and across the azimuth in pixels, kinds (trial,) which of
    `lags`, common (trial, 2, lag) what the tiles' window has in common with itself so far off. `freedom` is that of
    Student's likelihood, `least` the factor by which a level shrinks at most, `first` the level to start from.
    """
    n, n_levels, n_orders = seen.along.size, len(seen.shapes), lags.orders.max() + 1
    n_orders = max(n_orders, 2)
    pane, gap = np.empty((2, n_orders, n), np.float32), np.empty((2, n_orders, n), np.float32)
    layers, of, model = np.empty((2, 4, n), np.float32), np.empty((9, n), np.float32), np.empty((4, n), np.float32)
    phase, levels = np.empty(n, np.float32), np.empty((2, n_levels), np.float32)
    more, less = np.empty(n, np.float32), np.empty(n, np.float32)
    one = np.float32(1)
    total_weight = 0.0
    for f in range(n):
        total_weight += seen.multiplicity[f]
    for t in range(start, stop):
        for f in range(n):
            phase[f] = trials[t, 0] * seen.along[f]
        _powers(phase, pane[0], pane[1])
        for f in range(n):
            phase[f] = trials[t, 1] * seen.along[f] + trials[t, 2] * seen.across[f]
        _powers(phase, gap[0], gap[1])
        for i in range(2):
            _response(lags.orders[kinds[t], i], lags.weights[kinds[t], i], common[t, i], pane, gap, layers[i])
        _products(layers, seen, of)
        levels[:] = first
        for _ in range(rounds):
            _model(of, seen.shapes, levels, model)
            for i in range(2):
                for f in range(n):
                    scale = seen.multiplicity[f] / model[2, f]
                    surprise = (freedom + 2) / (freedom + model[3, f])
                    more[f] = (model[3, f] * model[i, f] - of[5 + i, f]) * surprise * scale
                    less[f] = model[i, f] * scale
                for s in range(n_levels):
                    gain, loss = np.float32(0), np.float32(0)
                    for f in range(n):
                        gain += more[f] * seen.shapes[s, f]
                        loss += less[f] * seen.shapes[s, f]
                    levels[i, s] *= max(gain / loss, least * one)
        _model(of, seen.shapes, levels, model)
        total = 0.0
        for f in range(n):
            value = np.log(model[2, f]) + (freedom + 2) * np.log(freedom + model[3, f])
            total += seen.multiplicity[f] * value
        out[t] = total / total_weight
