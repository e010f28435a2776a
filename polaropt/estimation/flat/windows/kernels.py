"""Compiled likelihood of trial panes and windows: spectra of both layers, fitted to a capture's mean spectra.

Of a line of ghosts `polaropt.estimation.flat.ghosts.ShiftLikelihood` makes the products; here are those of images at
any places.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled, inlined

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


@inlined
def _powers(phase: Array, cosines: Array, sines: Array) -> None:
    """Cosine and sine of 0, 1, ... times a phase (n,), each (order, n)."""
    first_cos, first_sin = cosines[1], sines[1]
    for f in range(phase.size):
        cosines[0, f], sines[0, f] = np.float32(1), np.float32(0)
        first_cos[f], first_sin[f] = np.cos(phase[f]), np.sin(phase[f])
    for k in range(2, len(cosines)):
        before_cos, before_sin, here_cos, here_sin = cosines[k - 1], sines[k - 1], cosines[k], sines[k]
        for f in range(phase.size):
            here_cos[f] = before_cos[f] * first_cos[f] - before_sin[f] * first_sin[f]
            here_sin[f] = before_sin[f] * first_cos[f] + before_cos[f] * first_sin[f]


@inlined
def _response(orders: Array, weights: Array, common: Array, pane: Array, gap: Array, out: Array) -> None:
    """Outer product of a layer's transfer functions: par, perp, cross (real, imaginary) into out (4, n)."""
    out[:] = 0
    par, perp, cross_re, cross_im = out[0], out[1], out[2], out[3]
    for k in range(len(orders)):
        w0, w1, w2, w3 = weights[k, 0], weights[k, 1], weights[k, 2], weights[k, 3]
        if w0 == 0 and w1 == 0 and w2 == 0:
            continue
        of_gap, at = orders[k, 1], common[k]
        i, j = orders[k, 0], abs(of_gap)
        sign = np.float32(1) if of_gap >= 0 else np.float32(-1)
        p, q, s, d = at * w0, at * w1, at * w2, at * w3
        pane_cos, pane_sin, gap_cos, gap_sin = pane[0, i], pane[1, i], gap[0, j], gap[1, j]
        for f in range(par.size):
            cosine = pane_cos[f] * gap_cos[f] - sign * pane_sin[f] * gap_sin[f]
            sine = pane_sin[f] * gap_cos[f] + sign * pane_cos[f] * gap_sin[f]
            par[f] += p * cosine
            perp[f] += q * cosine
            cross_re[f] += s * cosine
            cross_im[f] -= d * sine


@compiled
def _dot(a0: Any, a1: Any, a2: Any, a3: Any, b0: Any, b1: Any, b2: Any, b3: Any) -> Any:
    """Trace of the adjugate of one Hermitian matrix times another."""
    return a0 * b1 + a1 * b0 - np.float32(2) * (a2 * b2 + a3 * b3)


@inlined
def _products(layers: Array, d: Array, n: Array, out: Array) -> None:
    """Products of transmission B, reflection A, noise N and data D: aa, bb, ab, an, bn, ad, bd, nn, nd, (9, n)."""
    b, a = layers[0], layers[1]
    zero, n0, n1, n2 = np.float32(0), n[0], n[1], n[2]
    for f in range(out.shape[1]):
        a0, a1, a2, a3 = a[0, f], a[1, f], a[2, f], a[3, f]
        b0, b1, b2, b3 = b[0, f], b[1, f], b[2, f], b[3, f]
        d0, d1, d2, d3 = d[0, f], d[1, f], d[2, f], d[3, f]
        out[0, f] = max(_dot(a0, a1, a2, a3, a0, a1, a2, a3), np.float32(2e-6) * a0 * a1)
        out[1, f] = max(_dot(b0, b1, b2, b3, b0, b1, b2, b3), np.float32(2e-6) * b0 * b1)
        out[2, f] = max(_dot(a0, a1, a2, a3, b0, b1, b2, b3), zero)
        out[3, f] = _dot(a0, a1, a2, a3, n0, n1, n2, zero)
        out[4, f] = _dot(b0, b1, b2, b3, n0, n1, n2, zero)
        out[5, f] = _dot(a0, a1, a2, a3, d0, d1, d2, d3)
        out[6, f] = _dot(b0, b1, b2, b3, d0, d1, d2, d3)
        out[7, f] = _dot(n0, n1, n2, zero, n0, n1, n2, zero)
        out[8, f] = _dot(n0, n1, n2, zero, d0, d1, d2, d3)


@inlined
def _model(of: Array, shapes: Array, levels: Array, out: Array) -> None:
    """A.M, B.M, det M and the data's squared distance from M, (4, n), at levels (2, level), reflection first."""
    first, second = out[0], out[1]
    first[:] = 0
    second[:] = 0
    for s in range(len(shapes)):
        shape, of_a, of_b = shapes[s], levels[0, s], levels[1, s]
        for f in range(shape.size):
            first[f] += of_a * shape[f]
            second[f] += of_b * shape[f]
    for f in range(out.shape[1]):
        p, q = first[f], second[f]
        an, bn = of[3, f], of[4, f]
        a = p * of[0, f] + q * of[2, f] + an
        b = q * of[1, f] + p * of[2, f] + bn
        determinant = np.float32(0.5) * (p * (a + an) + q * (b + bn) + of[7, f])
        out[0, f], out[1, f], out[2, f] = a, b, determinant
        out[3, f] = (p * of[5, f] + q * of[6, f] + of[8, f]) / determinant


@inlined
def _fit(
    of: Array,
    shapes: Array,
    multiplicity: Array,
    freedom: Any,
    least: Any,
    rounds: int,
    levels: Array,
    model: Array,
    spare: Array,
) -> None:
    """Levels (2, level) by multiplicative steps towards the maximum of the likelihood, and the model (4, n) there."""
    determinant, distance, more, less = model[2], model[3], spare[0], spare[1]
    for left in range(rounds, -1, -1):
        _model(of, shapes, levels, model)
        if left == 0:
            break
        for i in range(2):
            by_layer, of_data = model[i], of[5 + i]
            for f in range(more.size):
                scale = multiplicity[f] / determinant[f]
                surprise = (freedom + 2) / (freedom + distance[f])
                more[f] = (distance[f] * by_layer[f] - of_data[f]) * surprise * scale
                less[f] = by_layer[f] * scale
            for s in range(len(shapes)):
                gain, loss, shape = np.float32(0), np.float32(0), shapes[s]
                for f in range(more.size):
                    gain += more[f] * shape[f]
                    loss += less[f] * shape[f]
                levels[i, s] *= max(gain / loss, least)


@inlined
def _misfit(model: Array, multiplicity: Array, freedom: Any) -> float:
    """Minus log likelihood per frequency."""
    determinant, distance, total, total_weight = model[2], model[3], 0.0, 0.0
    for f in range(multiplicity.size):
        value = np.log(determinant[f]) + (freedom + 2) * np.log(freedom + distance[f])
        total += multiplicity[f] * value
        total_weight += multiplicity[f]
    return total / total_weight


@compiled
def fitted_misfits(
    products: Array,
    shapes: Array,
    multiplicity: Array,
    freedom: Any,
    least: Any,
    rounds: int,
    levels: Array,
    out: Array,
    start: int,
    stop: int,
) -> None:
    """Minus log likelihood per frequency of trials start..stop into `out`, their levels (trial, 2, level) fitted.

    `products` (trial, 9, n) are those of `_products`; the rest is as for `window_misfits`.
    """
    n = multiplicity.size
    model, spare = np.empty((4, n), np.float32), np.empty((2, n), np.float32)
    for t in range(start, stop):
        _fit(products[t], shapes, multiplicity, freedom, least, rounds, levels[t], model, spare)
        out[t] = _misfit(model, multiplicity, freedom)


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
    orders, weights = lags
    along, across, multiplicity, shapes, data, noise = seen
    two, n, n_levels, n_orders = orders.shape[1], along.size, len(shapes), 2
    for order in orders.flat:
        n_orders = max(n_orders, order + 1)
    pane, gap = np.empty((2, n_orders, n), np.float32), np.empty((2, n_orders, n), np.float32)
    layers, of, model = np.empty((2, 4, n), np.float32), np.empty((9, n), np.float32), np.empty((4, n), np.float32)
    phase, levels = np.empty(n, np.float32), np.empty((2, n_levels), np.float32)
    spare = np.empty((2, n), np.float32)
    for t in range(start, stop):
        of_pane, of_gap, aside, kind = trials[t, 0], trials[t, 1], trials[t, 2], kinds[t]
        for f in range(n):
            phase[f] = of_pane * along[f]
        _powers(phase, pane[0], pane[1])
        for f in range(n):
            phase[f] = of_gap * along[f] + aside * across[f]
        _powers(phase, gap[0], gap[1])
        for i in range(two):
            _response(orders[kind, i], weights[kind, i], common[t, i], pane, gap, layers[i])
        _products(layers, data, noise, of)
        levels[:] = first
        _fit(of, shapes, multiplicity, freedom, least, rounds, levels, model, spare)
        out[t] = _misfit(model, multiplicity, freedom)


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that every separation needs, for `solvers.ahead`."""
    one, numbers, table = np.float32(1), np.ones(1, np.float32), np.ones((1, 1), np.float32)
    lags = Lags(np.zeros((1, 2, 1, 2), np.int64), np.zeros((1, 2, 1, 4), np.float32))
    seen = Seen(numbers, numbers, numbers, table, np.ones((4, 1), np.float32), np.ones(3, np.float32))
    trials, kinds, common = np.zeros((1, 3), np.float32), np.zeros(1, np.int64), np.ones((1, 2, 1), np.float32)
    products, levels, out = np.ones((1, 9, 1), np.float32), np.ones((1, 2, 1), np.float32), np.zeros(1)
    return [
        (window_misfits, (trials, kinds, lags, common, seen, one, one, 0, one, out, 0, 0)),
        (fitted_misfits, (products, table, numbers, one, one, 0, levels, out, 0, 0)),
    ]
