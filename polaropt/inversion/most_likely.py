"""The most likely layers behind a pane that varies over the frame, from a closed form that takes them by places.

They are what explains the photographs best beside Gaussian layers of the spectra found: one large system of linear
equations, solved by conjugate gradients. Where the pane is seen from the front its photographs hardly tell the layers
apart, and what is slow there follows from places far away: slow changes are solved for all together, as a coarse space,
and what is fast by the filter of the mean pane.

References
----------
S. V. Dolean, P. Jolivet, F. Nataf, An Introduction to Domain Decomposition Methods, SIAM 2015 (two-level methods).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.inversion.canvas import Canvas
from polaropt.inversion.closed_form import ClosedForm
from polaropt.inversion.spectra import Power, Spectrum, left_open
from polaropt.inversion.transfer import bilinear_transfer
from polaropt.numerics import column_multiplicity, each_plane
from polaropt.optics import VaryingPSE
from priors.natural_image import in_basis

Images = NDArray[np.float32]
Vector = NDArray[np.float32]

# Slow are changes of this many pixels per period and more, but at most so many periods per side of the canvas: with
# that a layer's are 1600 numbers. On a wide lens (79 degrees, 512x512 pixels, incidence 35 degrees) the transmission
# ends at 32.4 dB with 10 periods, at 37.2 with 16, at 38.8 with 20, which take four times the seconds of 10.
_FASTEST_PX, _MOST_PERIODS = 20, 16
# Pixels are looked at so often per period of the fastest of them. Set by hand.
_PER_PERIOD = 8
# Share of the light from which on a ghost counts.
_FAINT = 1e-3
# Steps at most, and the gain of log likelihood per value of the layers below which one is the last. Of 20 panes behind
# a lens or with a bend half end after 2 to 12 steps. Set by hand.
_MOST_STEPS, _LEAST_GAIN = 64, 2e-4


def most_likely_layers(
    known: ClosedForm,
    canvas: Canvas,
    pse: VaryingPSE,
    precision: NDArray[np.float64],
    misfit_gradient: Callable[[Images], Images],
) -> ClosedForm:
    """The closed form with the layers that are most likely under its spectra.

    Parameters
    ----------
    known : ClosedForm
    canvas : Canvas
    pse : VaryingPSE
        Made for the frame.
    precision : ndarray, shape (3, 3)
        Inverse covariance of a pixel's Stokes vector.
    misfit_gradient : callable
        Gradient (2, channel, H, W) of the photographs' misfit at canvas layers: linear.
    """
    system = _System(known, canvas, misfit_gradient)
    slow = _SlowChanges(known, canvas, pse, precision)
    fast = _fast_filter(known, slow.places)

    def preconditioned(vector: Vector) -> Vector:
        spectrum = system.spectrum(vector)
        change = np.asarray(fast(spectrum), dtype=np.complex64)
        change += slow.solved(spectrum)
        return system.vector(change)

    change = _conjugate_gradients(system.applied, preconditioned, system.right)
    return replace(known, layers=known.layers + system.images(system.spectrum(change)))


def _conjugate_gradients(
    applied: Callable[[Vector], Vector], preconditioned: Callable[[Vector], Vector], right: Vector
) -> Vector:
    """Solution of linear equations, until a step hardly lowers what it minimizes.

    The residual, by whose length those of libraries stop, tells little here: it is large where photographs tell much.
    """
    found, residual = np.zeros_like(right), right.copy()
    direction = preconditioned(residual)
    along = float(residual @ direction)
    for _ in range(_MOST_STEPS):
        curved = applied(direction)
        step = along / float(direction @ curved)
        found += np.float32(step) * direction
        if step * along / 2 < _LEAST_GAIN * right.size:
            break
        residual -= np.float32(step) * curved
        whitened = preconditioned(residual)
        before, along = along, float(residual @ whitened)
        direction = whitened + np.float32(along / before) * direction
    return found


class _System:
    """Equations of the change of the layers, in half spectra that are scaled to keep lengths."""

    def __init__(self, known: ClosedForm, canvas: Canvas, misfit_gradient: Callable[[Images], Images]) -> None:
        self._basis, self._shape, self._gradient = known.basis.astype(np.float32), canvas.shape, misfit_gradient
        self._length = np.sqrt(column_multiplicity(canvas.shape[1])).astype(np.float32)
        self._stiffness = np.float32(1) / known.prior
        self._of_nothing = misfit_gradient(np.zeros_like(known.layers))
        off_mean = self._transformed(known.layers)
        off_mean[..., 0, 0] -= known.mean[..., 0, 0] * np.float32(np.sqrt(canvas.shape[0] * canvas.shape[1]))
        pull = self._transformed(misfit_gradient(known.layers)) + self._stiffness * off_mean
        self.right = self.vector(-pull)

    def applied(self, vector: Vector) -> Vector:
        """The Hessian times a change."""
        spectrum = self.spectrum(vector)
        told = self._gradient(self.images(spectrum)) - self._of_nothing
        return self.vector(self._transformed(told) + self._stiffness * spectrum)

    def images(self, spectrum: Spectrum) -> Images:
        """Canvas images (2, channel, H, W) in the colours of the photographs."""
        from scipy.fft import irfft2

        own = np.empty((*spectrum.shape[:2], *self._shape), dtype=np.float32)

        def plane(where: tuple[int, int]) -> None:
            own[where] = irfft2(spectrum[where], self._shape, norm="ortho")

        each_plane(plane, own.shape)
        return np.asarray(in_basis(self._basis.T, own, np), dtype=np.float32)

    def spectrum(self, vector: Vector) -> Spectrum:
        """Half spectrum (2, channel, H, W // 2 + 1) of a vector."""
        shape = (2, len(self._basis), self._shape[0], self._shape[1] // 2 + 1)
        return np.asarray(np.ascontiguousarray(vector, np.float32).view(np.complex64).reshape(shape) / self._length)

    def vector(self, spectrum: Spectrum) -> Vector:
        """The inverse of `spectrum`."""
        return np.ascontiguousarray(spectrum * self._length, dtype=np.complex64).view(np.float32).ravel()

    def _transformed(self, images: Images) -> Spectrum:
        from scipy.fft import rfft2

        own = in_basis(self._basis, images, np)
        spectrum = np.empty((*own.shape[:-1], own.shape[-1] // 2 + 1), dtype=np.complex64)

        def plane(where: tuple[int, int]) -> None:
            spectrum[where] = rfft2(own[where], norm="ortho")

        each_plane(plane, own.shape)
        return spectrum


def _fast_filter(known: ClosedForm, slow: tuple[Any, Any]) -> Callable[[Spectrum], Spectrum]:
    """Solves for all but slow changes (their places in a half spectrum) behind the mean pane."""
    stiffness: Power = np.float32(1) / known.prior
    of_each, determinant = left_open(known.told[:, None], known.cross, stiffness)
    cross = known.cross / determinant
    for part in (of_each, cross):
        part[(..., *slow)] = 0

    def solved(right: Spectrum) -> Spectrum:
        return np.stack([of_each[0] * right[0] - cross * right[1], of_each[1] * right[1] - cross.conj() * right[0]])

    return solved


class _SlowChanges:
    """The equations restricted to slow changes of both layers, which all places together decide.

    Parameters
    ----------
    known : ClosedForm
    canvas : Canvas
    pse : VaryingPSE
    precision : ndarray, shape (3, 3)
    """

    def __init__(self, known: ClosedForm, canvas: Canvas, pse: VaryingPSE, precision: NDArray[np.float64]) -> None:
        from scipy.linalg import cho_factor

        periods = max(1, min(_MOST_PERIODS, min(canvas.shape) // _FASTEST_PX))
        down, across = (x.ravel() for x in np.mgrid[-periods : periods + 1, 0 : periods + 1])
        kept = (np.hypot(down, across) <= periods) & ((across > 0) | (down >= 0))
        self._down, self._across = down[kept], across[kept]
        self._shape, self._n = canvas.shape, self._down.size
        # Of those that only change from row to row the half spectrum has each twice.
        self._twice = np.flatnonzero((self._across == 0) & (self._down > 0))
        level = int(np.flatnonzero((self._across == 0) & (self._down == 0))[0])
        self._length = np.full(self._n, np.sqrt(2.0))
        self._length[level] = 1.0
        told = _told_of(canvas, pse, precision, (self._down, self._across), self._length)
        # A level has no phase.
        self._free = np.delete(np.arange(4 * self._n), [self._n + level, 3 * self._n + level])
        prior = known.prior[:, :, self._down % canvas.shape[0], self._across].astype(np.float64)
        self._factors = []
        for of_color in np.moveaxis(1 / prior, 1, 0):
            matrix = told + np.diag(np.repeat(of_color, 2, axis=0).ravel())
            self._factors.append(cho_factor(matrix[np.ix_(self._free, self._free)]))

    @property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of a half spectrum that hold them."""
        rows = np.concatenate([self._down, -self._down[self._twice]]) % self._shape[0]
        return rows, np.concatenate([self._across, self._across[self._twice]])

    def solved(self, right: Spectrum) -> Spectrum:
        """Half spectrum (2, channel, H, W // 2 + 1) of the slow changes that solve the equations."""
        from scipy.linalg import cho_solve

        seen = right[:, :, self._down % self._shape[0], self._across] * self._length
        found = np.zeros_like(right)
        for c, factor in enumerate(self._factors):
            whole = np.zeros(4 * self._n)
            parts = np.stack([seen[:, c].real, seen[:, c].imag], axis=1)
            whole[self._free] = cho_solve(factor, parts.ravel()[self._free])
            of_each = whole.reshape(2, 2, self._n) / self._length
            values = (of_each[:, 0] + 1j * of_each[:, 1]).astype(np.complex64)
            both = np.concatenate([values, values[:, self._twice].conj()], axis=1)
            found[:, c][(..., *self.places)] = both
        return found


def _told_of(
    canvas: Canvas,
    pse: VaryingPSE,
    precision: NDArray[np.float64],
    periods: tuple[NDArray[np.intp], NDArray[np.intp]],
    length: NDArray[np.float64],
) -> NDArray[np.float64]:
    """What photographs tell of slow changes: of each layer's real and imaginary parts, (4 n, 4 n).

    Two changes meet in what the pane, which varies, has of their difference and of their sum.
    """
    frame, (down, across) = (canvas.height, canvas.width), periods
    most = 2 * int(max(down.max(), across.max()))
    step = max(1, min(canvas.shape) // (_PER_PERIOD * most))
    rows, columns = (np.arange(step // 2, side, step) for side in frame)
    mixtures = pse.ghost_mixtures(*frame)
    light = np.abs(mixtures).max(axis=(0, 1, 3, 4))
    kept = np.flatnonzero(light > _FAINT * light.max())
    own = mixtures[..., rows[:, None], columns][:, :, kept].astype(np.float64)
    weighted = np.tensordot(precision, own, axes=1)
    turns = np.arange(-most, most + 1)
    omega = [2 * np.pi * turns / side for side in canvas.shape]
    waves = [np.exp(1j * np.multiply.outer(omega[0], rows + canvas.top))]
    waves.append(np.exp(1j * np.multiply.outer(columns + canvas.left, omega[1])))
    places = [pse.displacements(*frame)[k] for k in kept]
    unit = length * (step / np.sqrt(canvas.shape[0] * canvas.shape[1]))
    moved = [
        unit * bilinear_transfer(dy, omega[0][most + down]) * bilinear_transfer(dx, omega[1][most + across])
        for dx, dy in places
    ]
    apart = (most + down - down[:, None], most + across - across[:, None])
    together = (most + down + down[:, None], most + across + across[:, None])
    n = down.size
    told = np.empty((2, 2, n, 2, 2, n)).transpose(0, 3, 1, 4, 2, 5)
    for i, j in ((0, 0), (1, 1), (0, 1)):
        differences, sums = np.zeros((2, n, n), dtype=np.complex128)
        for g, h in np.ndindex(kept.size, kept.size):
            table = waves[0] @ np.einsum("eyx,eyx->yx", own[:, i, g], weighted[:, j, h]) @ waves[1]
            differences += moved[g].conj()[:, None] * moved[h] * table[apart]
            sums += moved[g][:, None] * moved[h] * table[together]
        both, other = (differences + sums) / 2, (sums - differences) / 2
        told[i, j] = [[both.real, -both.imag], [-other.imag, -other.real]]
        if i != j:
            told[j, i] = np.transpose(told[i, j], (1, 0, 3, 2))
    return np.asarray(told.transpose(0, 2, 4, 1, 3, 5)).reshape(4 * n, 4 * n)
