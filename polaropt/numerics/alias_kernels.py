"""Compiled passes over groups of aliases: what samples say of images, some groups side by side.

Shapes: combs (color, entry, measured, true), power (color, entry, entry, true, group), data (measured, group).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled

Array = NDArray[Any]

LANES = 16
"""Groups that are worked on side by side: a few vectors of the processor. By trial."""
# Of a number in single precision.
_ROUNDING = np.finfo(np.float32).eps


@compiled
def _covariance(combs: Array, power: Array, first: int, noise: Any, re: Array, im: Array) -> None:
    """Covariance (measured, measured, lane) of some groups' samples; below the diagonal and on it."""
    n_colors, n_entries, n = combs.shape[0], combs.shape[1], combs.shape[2]
    lanes = re.shape[2]
    re[:] = 0
    im[:] = 0
    for m in range(n):
        for x in range(lanes):
            re[m, m, x] = noise
    part_re, part_im = np.empty((n, lanes), np.float32), np.empty((n, lanes), np.float32)
    for c in range(n_colors):
        for t in range(n):
            for f in range(n_entries):
                part_re[:] = 0
                part_im[:] = 0
                for e in range(n_entries):
                    values = power[c, e, f, t]
                    for m in range(n):
                        a, b = combs[c, e, m, t].real, combs[c, e, m, t].imag
                        if a == 0 and b == 0:
                            continue
                        out_re, out_im = part_re[m], part_im[m]
                        for x in range(lanes):
                            p, q = values[first + x].real, values[first + x].imag
                            out_re[x] += a * p - b * q
                            out_im[x] += a * q + b * p
                for j in range(n):
                    a, b = combs[c, f, j, t].real, -combs[c, f, j, t].imag
                    if a == 0 and b == 0:
                        continue
                    for m in range(j, n):
                        in_re, in_im, out_re, out_im = part_re[m], part_im[m], re[m, j], im[m, j]
                        for x in range(lanes):
                            out_re[x] += a * in_re[x] - b * in_im[x]
                            out_im[x] += a * in_im[x] + b * in_re[x]


@compiled
def _factorize(re: Array, im: Array, noise: Any, inverse: Array) -> None:
    """Cholesky's factor in place of what lies below the diagonal; `inverse` (n, lane) of its diagonal.

    What is left of the diagonal is the noise at least. Where it is less, or less than its own rounding, the sample says
    what others have said: nothing of it goes to those after it, where it would be magnified without bounds.
    """
    n, lanes = re.shape[0], re.shape[2]
    news = np.empty(lanes, np.float32)
    # First the least that may be left.
    for j in range(n):
        for x in range(lanes):
            inverse[j, x] = max(_ROUNDING * re[j, j, x], noise)
    for j in range(n):
        for k in range(j):
            a, b = re[j, k], im[j, k]
            for m in range(j, n):
                c, d, out_re, out_im = re[m, k], im[m, k], re[m, j], im[m, j]
                for x in range(lanes):
                    out_re[x] -= c[x] * a[x] + d[x] * b[x]
                    out_im[x] -= d[x] * a[x] - c[x] * b[x]
        for x in range(lanes):
            least = inverse[j, x]
            inverse[j, x] = 1 / np.sqrt(max(re[j, j, x], least))
            news[x] = inverse[j, x] if re[j, j, x] >= least else 0
        for m in range(j + 1, n):
            for x in range(lanes):
                re[m, j, x] *= news[x]
                im[m, j, x] *= news[x]


@compiled
def _substitute(re: Array, im: Array, inverse: Array, v_re: Array, v_im: Array) -> None:
    """Solve with the lower factor in place, (n, lane)."""
    n, lanes = v_re.shape
    for j in range(n):
        for k in range(j):
            a, b, c, d = re[j, k], im[j, k], v_re[k], v_im[k]
            for x in range(lanes):
                v_re[j, x] -= a[x] * c[x] - b[x] * d[x]
                v_im[j, x] -= a[x] * d[x] + b[x] * c[x]
        for x in range(lanes):
            v_re[j, x] *= inverse[j, x]
            v_im[j, x] *= inverse[j, x]


@compiled
def _substitute_back(re: Array, im: Array, inverse: Array, v_re: Array, v_im: Array) -> None:
    """Solve with the lower factor's conjugate transpose in place, (n, lane)."""
    n, lanes = v_re.shape
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            a, b, c, d = re[k, j], im[k, j], v_re[k], v_im[k]
            for x in range(lanes):
                v_re[j, x] -= a[x] * c[x] + b[x] * d[x]
                v_im[j, x] -= a[x] * d[x] - b[x] * c[x]
        for x in range(lanes):
            v_re[j, x] *= inverse[j, x]
            v_im[j, x] *= inverse[j, x]


@compiled
def explained(combs: Array, power: Array, noise: Any, data: Array, out: Array, told: Array) -> None:
    """What the samples of groups say of the images' entries, under covariances of those.

    Shapes: combs (color, entry, measured, true), power (color, entry, entry, true, group), data (measured, group), out
    (color, entry, true, group): the posterior mean of the entries is power times it. told (color, entry, entry, true,
    group): its covariance is power - power told power; empty if not wanted. Groups are a multiple of the lanes.
    """
    n_colors, n_entries, n = combs.shape[0], combs.shape[1], combs.shape[2]
    lanes = LANES
    re, im = np.empty((n, n, lanes), np.float32), np.empty((n, n, lanes), np.float32)
    inverse = np.empty((n, lanes), np.float32)
    v_re, v_im = np.empty((n, lanes), np.float32), np.empty((n, lanes), np.float32)
    w_re, w_im = np.empty((n_entries, n, lanes), np.float32), np.empty((n_entries, n, lanes), np.float32)
    for first in range(0, data.shape[1], lanes):
        _covariance(combs, power, first, noise, re, im)
        _factorize(re, im, noise, inverse)
        for m in range(n):
            for x in range(lanes):
                v_re[m, x] = data[m, first + x].real
                v_im[m, x] = data[m, first + x].imag
        _substitute(re, im, inverse, v_re, v_im)
        _substitute_back(re, im, inverse, v_re, v_im)
        for c in range(n_colors):
            for e in range(n_entries):
                for t in range(n):
                    total_re, total_im = w_re[0, 0], w_im[0, 0]
                    for x in range(lanes):
                        total_re[x] = 0
                        total_im[x] = 0
                    for m in range(n):
                        a, b = combs[c, e, m, t].real, -combs[c, e, m, t].imag
                        for x in range(lanes):
                            total_re[x] += a * v_re[m, x] - b * v_im[m, x]
                            total_im[x] += a * v_im[m, x] + b * v_re[m, x]
                    for x in range(lanes):
                        out[c, e, t, first + x] = complex(total_re[x], total_im[x])
        if told.size == 0:
            continue
        for c in range(n_colors):
            for t in range(n):
                for e in range(n_entries):
                    for m in range(n):
                        for x in range(lanes):
                            w_re[e, m, x] = combs[c, e, m, t].real
                            w_im[e, m, x] = combs[c, e, m, t].imag
                    _substitute(re, im, inverse, w_re[e], w_im[e])
                for e in range(n_entries):
                    for f in range(n_entries):
                        for x in range(lanes):
                            of_re, of_im = np.float32(0), np.float32(0)
                            for m in range(n):
                                of_re += w_re[e, m, x] * w_re[f, m, x] + w_im[e, m, x] * w_im[f, m, x]
                                of_im += w_re[e, m, x] * w_im[f, m, x] - w_im[e, m, x] * w_re[f, m, x]
                            told[c, e, f, t, first + x] = complex(of_re, of_im)


@compiled
def filter_rows(combs: Array, power: Array, noise: Any, seen: Array, out: Array) -> None:
    """Wiener's filter itself: what each sample of a group counts in sums over the images' frequencies.

    Shapes: combs, power as of `explained`; seen (true, group): the weight of each frequency in the sums; out (color,
    entry, measured, group). Groups are a multiple of the lanes.
    """
    n_colors, n_entries, n = combs.shape[0], combs.shape[1], combs.shape[2]
    lanes = LANES
    re, im = np.empty((n, n, lanes), np.float32), np.empty((n, n, lanes), np.float32)
    inverse = np.empty((n, lanes), np.float32)
    v_re, v_im = np.empty((n, lanes), np.float32), np.empty((n, lanes), np.float32)
    p_re, p_im = np.empty(lanes, np.float32), np.empty(lanes, np.float32)
    for first in range(0, seen.shape[1], lanes):
        _covariance(combs, power, first, noise, re, im)
        _factorize(re, im, noise, inverse)
        for c in range(n_colors):
            for s in range(n_entries):
                # The covariance of samples is its own conjugate transpose: what is solved for is the conjugate.
                v_re[:] = 0
                v_im[:] = 0
                for t in range(n):
                    for e in range(n_entries):
                        for x in range(lanes):
                            of, at = power[c, s, e, t, first + x], seen[t, first + x]
                            p_re[x] = of.real * at.real - of.imag * at.imag
                            p_im[x] = -(of.real * at.imag + of.imag * at.real)
                        for m in range(n):
                            a, b = combs[c, e, m, t].real, combs[c, e, m, t].imag
                            for x in range(lanes):
                                v_re[m, x] += a * p_re[x] - b * p_im[x]
                                v_im[m, x] += a * p_im[x] + b * p_re[x]
                _substitute(re, im, inverse, v_re, v_im)
                _substitute_back(re, im, inverse, v_re, v_im)
                for m in range(n):
                    for x in range(lanes):
                        out[c, s, m, first + x] = complex(v_re[m, x], -v_im[m, x])


@compiled
def mixed_rows(gain_re: Array, gain_im: Array, spectra: Array, out: Array, start: int, stop: int) -> None:
    """Sums of spectra (place, row, column) with gains (row, image, place, column), rows start..stop of (image, ...)."""
    n_images, n_places, width = gain_re.shape[1], gain_re.shape[2], gain_re.shape[3]
    s_re, s_im = np.empty((n_places, width), np.float32), np.empty((n_places, width), np.float32)
    t_re, t_im = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(start, stop):
        for p in range(n_places):
            for x in range(width):
                s_re[p, x] = spectra[p, y, x].real
                s_im[p, x] = spectra[p, y, x].imag
        for o in range(n_images):
            t_re[:] = 0
            t_im[:] = 0
            for p in range(n_places):
                a, b, c, d = gain_re[y, o, p], gain_im[y, o, p], s_re[p], s_im[p]
                for x in range(width):
                    t_re[x] += a[x] * c[x] - b[x] * d[x]
                    t_im[x] += a[x] * d[x] + b[x] * c[x]
            for x in range(width):
                out[o, y, x] = complex(t_re[x], t_im[x])


def first_calls() -> list[Call]:
    """A call on next to nothing of the kernel that every mosaic needs, for `solvers.ahead`."""
    combs = np.zeros((1, 1, 1, 1), np.complex64)
    power, data = np.zeros((1, 1, 1, 1, LANES), np.complex64), np.zeros((1, LANES), np.complex64)
    mean, told = np.zeros((1, 1, 1, LANES), np.complex64), np.zeros((0, 0, 0, 0, 0), np.complex64)
    return [(explained, (combs, power, np.float32(1), data, mean, told))]
