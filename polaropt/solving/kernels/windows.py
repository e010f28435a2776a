"""Passes over a row of overlapping windows and their spectra; importing this imports numba."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled

Images = NDArray[np.float32]
Array = NDArray[Any]


@compiled
def cut(rows: Images, side: Images, step: int, pieces: Images) -> None:
    """Windows (2, channel, window, n, n) of rows (2, channel, n, width), every `step` pixels, times ``side side^T``."""
    n = side.size
    for layer in range(pieces.shape[0]):
        for c in range(pieces.shape[1]):
            for i in range(pieces.shape[2]):
                for y in range(n):
                    line, out, weight = rows[layer, c, y], pieces[layer, c, i, y], side[y]
                    for x in range(n):
                        out[x] = line[i * step + x] * (weight * side[x])


@compiled
def put(pieces: Images, side: Images, step: int, rows: Images) -> None:
    """Add windows times ``side side^T`` where `cut` took them from."""
    n = side.size
    for layer in range(pieces.shape[0]):
        for c in range(pieces.shape[1]):
            for i in range(pieces.shape[2]):
                for y in range(n):
                    line, piece, weight = rows[layer, c, y], pieces[layer, c, i, y], side[y]
                    for x in range(n):
                        line[i * step + x] += piece[x] * (weight * side[x])


@compiled
def power_of(spectra: Images, power: Images) -> None:
    """Squares (2, channel, window, frequency) of spectra (..., frequency, 2), real and imaginary parts."""
    for layer in range(power.shape[0]):
        for c in range(power.shape[1]):
            for i in range(power.shape[2]):
                of, out = spectra[layer, c, i], power[layer, c, i]
                for k in range(out.size):
                    out[k] = of[k, 0] * of[k, 0] + of[k, 1] * of[k, 1]


@compiled
def share_power(
    power: Images, counted: Images, prior: Images, along: NDArray[np.intp], beside: np.float32, of_light: np.float32
) -> None:
    """Draw the power of layers in windows to what is alike there, in units of the frame's own power.

    Parameters
    ----------
    power : array, shape (2, channel, window, frequency)
        Of the layers; overwritten.
    counted : array, shape (2, channel, n, frequency)
        What is added to it, of each window or of all (n is 1).
    prior : array, shape (2, channel, frequency)
        Power of the frame: nowhere 0.
    along : array, shape (2, frequency)
        The frequencies beside each, of the same direction.
    beside, of_light : float32
        Share that these have in a frequency's power, and the first colour in that of the others.
    """
    near, own, half = np.float32(1) - beside, np.float32(1) - of_light, np.float32(0.5) * beside
    busy, light = np.empty(prior.shape[-1], np.float32), np.empty(prior.shape[-1], np.float32)
    for layer in range(power.shape[0]):
        for i in range(power.shape[2]):
            for c in range(power.shape[1]):
                p, q, v = power[layer, c, i], counted[layer, c, i % counted.shape[2]], prior[layer, c]
                for k in range(busy.size):
                    busy[k] = (p[k] + q[k]) / v[k]
                for k in range(busy.size):
                    shared = near * busy[k] + half * (busy[along[0, k]] + busy[along[1, k]])
                    if c == 0:
                        light[k] = shared
                    else:
                        shared = own * shared + of_light * light[k]
                    p[k] = max(shared * v[k] - q[k], np.float32(0))


@compiled
def limit_power(
    power: Images, counted: Images, prior: Images, weight: NDArray[np.float32], direction: NDArray[np.intp]
) -> None:
    """Bound the power of layers in windows by that of the same direction, in units of the frame's own power.

    Parameters
    ----------
    power, counted, prior
        As of `share_power`.
    weight : array, shape (frequency,)
        Of each frequency in the mean of its direction; those without any are bounded by it.
    direction : array, shape (frequency,)
        Number of each frequency's direction, or -1: such are left alone.
    """
    n = direction.max() + 1
    sums, totals = np.empty(n, np.float32), np.zeros(n, np.float32)
    for k in range(direction.size):
        if direction[k] >= 0:
            totals[direction[k]] += weight[k]
    for layer in range(power.shape[0]):
        for c in range(power.shape[1]):
            v = prior[layer, c]
            for i in range(power.shape[2]):
                p, q = power[layer, c, i], counted[layer, c, i % counted.shape[2]]
                sums[:] = 0
                for k in range(direction.size):
                    if weight[k] > 0:
                        sums[direction[k]] += weight[k] * (p[k] + q[k]) / v[k]
                for k in range(direction.size):
                    if weight[k] == 0 and direction[k] >= 0:
                        most = sums[direction[k]] / totals[direction[k]] * v[k] - q[k]
                        p[k] = max(min(p[k], most), np.float32(0))


class Photographed(NamedTuple):
    """What photographs tell of windows, and what their solution is bounded by.

    Attributes
    ----------
    told : array, shape (2, n, frequency)
    cross : array, shape (n, frequency, 2)
        Entries on and off the diagonal (real and imaginary part), of photographs of precision 1: of each window, or of
        all (n is 1).
    counted : array, shape (2, channel, n, frequency)
        What is added to the power of layers.
    fast : array, shape (frequency,)
        1 where something changes, 0 elsewhere.
    least_power, resolution : float32
        Bounds of what is divided by: of power, and of a determinant in units of its diagonal's product.
    """

    told: Images
    cross: Images
    counted: Images
    fast: Images
    least_power: np.float32
    resolution: np.float32


@compiled
def _change(
    seen: Photographed,
    p: np.float32,
    j: int,
    k: int,
    s_t: np.float32,
    s_r: np.float32,
    h_t: Array,
    h_r: Array,
    d: tuple[Any, ...],
) -> tuple[Any, ...]:
    """Change of both layers at a frequency (real and imaginary parts), and what is left open of each."""
    t_re, t_im = d[0] - s_t * h_t[k, 0], d[1] - s_t * h_t[k, 1]
    r_re, r_im = d[2] - s_r * h_r[k, 0], d[3] - s_r * h_r[k, 1]
    of_t, of_r = p * seen.told[0, j, k] + s_t, p * seen.told[1, j, k] + s_r
    x_re, x_im = p * seen.cross[j, k, 0], p * seen.cross[j, k, 1]
    product = of_t * of_r
    inverse = np.float32(1) / max(product - (x_re * x_re + x_im * x_im), seen.resolution * product)
    moved = inverse * seen.fast[k]
    return (
        moved * (of_r * t_re - (x_re * r_re - x_im * r_im)),
        moved * (of_r * t_im - (x_re * r_im + x_im * r_re)),
        moved * (of_t * r_re - (x_re * t_re + x_im * t_im)),
        moved * (of_t * r_im - (x_re * t_im - x_im * t_re)),
        of_r * inverse,
        of_t * inverse,
    )


@compiled
def likely_power(
    here: Images, down: Images, precision: Images, seen: Photographed, changed: NDArray[np.bool_], power: Images
) -> None:
    """Power of what would be expected of windows under the power at hand, where they have changed; see `expect`."""
    one = np.float32(1)
    for c in range(here.shape[1]):
        for i in range(here.shape[2]):
            if not changed[i]:
                continue
            p, j = precision[i], i % seen.told.shape[1]
            h_t, h_r, d_t, d_r = here[0, c, i], here[1, c, i], down[0, c, i], down[1, c, i]
            p_t, p_r, q_t, q_r = power[0, c, i], power[1, c, i], seen.counted[0, c, j], seen.counted[1, c, j]
            for k in range(seen.fast.size):
                s_t = one / max(h_t[k, 0] * h_t[k, 0] + h_t[k, 1] * h_t[k, 1] + q_t[k], seen.least_power)
                s_r = one / max(h_r[k, 0] * h_r[k, 0] + h_r[k, 1] * h_r[k, 1] + q_r[k], seen.least_power)
                d = (d_t[k, 0], d_t[k, 1], d_r[k, 0], d_r[k, 1])
                t_re, t_im, r_re, r_im, _, _ = _change(seen, p, j, k, s_t, s_r, h_t, h_r, d)
                p_t[k] = (h_t[k, 0] + t_re) ** 2 + (h_t[k, 1] + t_im) ** 2
                p_r[k] = (h_r[k, 0] + r_re) ** 2 + (h_r[k, 1] + r_im) ** 2


@compiled
def expect(here: Images, down: Images, precision: Images, seen: Photographed, power: Images, left: Images) -> None:
    """From layers at hand to what is expected of them, in each window of a row.

    Parameters
    ----------
    here : array of float32, shape (2, channel, window, frequency, 2)
        Spectra of the layers at hand, real and imaginary parts.
    down : array, same shape
        Of the misfit's negative gradient there; overwritten by the change.
    precision : array, shape (window,)
    seen : Photographed
    power : array, shape (2, channel, window, frequency)
        Of the layers, as they are expected to be; overwritten by what is found.
    left : array, shape (2, channel, frequency)
        What is then left open is added to it.
    """
    one = np.float32(1)
    for c in range(here.shape[1]):
        for i in range(here.shape[2]):
            p, j = precision[i], i % seen.told.shape[1]
            h_t, h_r, d_t, d_r = here[0, c, i], here[1, c, i], down[0, c, i], down[1, c, i]
            p_t, p_r, q_t, q_r = power[0, c, i], power[1, c, i], seen.counted[0, c, j], seen.counted[1, c, j]
            l_t, l_r = left[0, c], left[1, c]
            for k in range(seen.fast.size):
                s_t = one / max(p_t[k] + q_t[k], seen.least_power)
                s_r = one / max(p_r[k] + q_r[k], seen.least_power)
                d = (d_t[k, 0], d_t[k, 1], d_r[k, 0], d_r[k, 1])
                t_re, t_im, r_re, r_im, open_t, open_r = _change(seen, p, j, k, s_t, s_r, h_t, h_r, d)
                d_t[k, 0], d_t[k, 1], d_r[k, 0], d_r[k, 1] = t_re, t_im, r_re, r_im
                p_t[k] = (h_t[k, 0] + t_re) ** 2 + (h_t[k, 1] + t_im) ** 2
                p_r[k] = (h_r[k, 0] + r_re) ** 2 + (h_r[k, 1] + r_im) ** 2
                l_t[k] += open_t
                l_r[k] += open_r


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that every separation needs, for `solvers.ahead`."""
    one, side = np.float32(1), np.ones(1, np.float32)
    # Rows of larger images are no arrays of their own.
    rows, told = np.zeros((2, 1, 1, 2), np.float32)[..., :1], np.zeros((2, 1, 1), np.float32)
    pieces, spectra = np.zeros((2, 1, 1, 1, 1), np.float32), np.zeros((2, 1, 1, 1, 2), np.float32)
    power, left = np.zeros((2, 1, 1, 1), np.float32), np.zeros((2, 1, 1), np.float32)
    seen = Photographed(told, np.zeros((1, 1, 2), np.float32), power.copy(), side, one, one)
    return [
        (expect, (spectra, spectra.copy(), side, seen, power, left)),
        (put, (pieces, side, 1, rows)),
        (cut, (rows, side, 1, pieces)),
        (power_of, (spectra, power)),
        (share_power, (power, power.copy(), told, np.zeros((2, 1), np.intp), one, one)),
    ]
