"""The most likely layers behind a pane that varies over the frame, from a closed form that takes them by places.

They are what explains the photographs best beside Gaussian layers of the spectra found: one large system of linear
equations, solved by conjugate gradients. Where the pane is seen from the front its photographs hardly tell the layers
apart, and what is slow there follows from places far away: slow changes are solved for all together, as a coarse space,
and what is fast by the filter of the mean pane.

References
----------
M. R. Hestenes, E. Stiefel, Methods of conjugate gradients for solving linear systems, J. Res. NBS 49, 1952.
V. Dolean, P. Jolivet, F. Nataf, An Introduction to Domain Decomposition Methods, SIAM 2015 (coarse spaces).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.inversion.canvas import Canvas
from polaropt.inversion.closed_form import ClosedForm
from polaropt.inversion.spectra import left_open
from polaropt.inversion.transfer import bilinear_transfer, images_that_tell
from polaropt.inversion.whitening import applied
from polaropt.numerics import filtered
from polaropt.optics import VaryingPSE
from priors.natural_image import in_basis
from solvers.kernels import in_blocks

Images = NDArray[np.float32]
Spectrum = NDArray[np.complex64]

# Slow are changes of this many pixels per period and more, but at most so many periods per side of the canvas: with
# that a layer's are 800 numbers. Behind a pane at 35 degrees before a lens of 79 (512x512 pixels, noise 0.4 %) the
# transmission ends at 32 dB with 10 periods, at 37 with 16, at 39 with 20, which take four times the seconds of 10.
_FASTEST_PX, _MOST_PERIODS = 20, 16
# Pixels are looked at so often per period of the fastest of them. Set by hand.
_PER_PERIOD = 8
# Most by which a change is scaled for what photographs tell of it in its place. By trial: 2 and 10 take a few steps
# more before a pane that is seen up to grazing incidence.
_MOST_SCALE = 4.0
# Steps at most, and the gain of log likelihood per value of the layers below which one is the last. Of ten windows with
# a lens or a bend 2e-4 leaves the reflection 0.3 dB lower, 2e-5 gains 0.1 dB for a third more seconds.
_MOST_STEPS, _LEAST_GAIN = 64, 1e-4
# Share of what is told on average by which all slow changes are told at least: above rounding. Set by hand.
_ROUNDING = 1e-12
# Curvature that is never fallen short of, so that black photographs divide by something.
_LEAST_CURVATURE = 1e-30


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
        What a pixel tells of its Stokes vector, an inverse covariance.
    misfit_gradient : callable
        Gradient (2, channel, H, W) of the photographs' misfit at canvas layers: linear.
    """
    system = _System(known, canvas, _scale_of(pse, canvas, precision), misfit_gradient)
    slow = _SlowChanges(known, canvas, pse, precision)
    fast = _FastFilter(known, canvas, slow.places)

    def preconditioned(residual: Images) -> Images:
        return np.asarray(fast.solved(residual) + slow.solved(residual / system.scale) / system.scale)

    change = system.scale * _conjugate_gradients(system.applied, preconditioned, system.right)
    return replace(known, layers=known.layers + in_basis(known.basis.T.astype(np.float32), change, np))


def _conjugate_gradients(
    applied: Callable[[Images], Images], preconditioned: Callable[[Images], Images], right: Images
) -> Images:
    """Solution of linear equations, until a step hardly lowers what it minimizes.

    The residual, by whose length those of libraries stop, tells little here: it is large where photographs tell much.
    """
    found, residual = np.zeros_like(right), right.copy()
    direction = preconditioned(residual)
    along = float(np.vdot(residual, direction))
    for _ in range(_MOST_STEPS):
        curved = applied(direction)
        step = along / max(float(np.vdot(direction, curved)), _LEAST_CURVATURE)
        found += np.float32(step) * direction
        if step * along / 2 < _LEAST_GAIN * right.size:
            break
        residual -= np.float32(step) * curved
        whitened = preconditioned(residual)
        before, along = along, float(np.vdot(residual, whitened))
        direction = whitened + np.float32(along / before) * direction
    return found


def _scale_of(pse: VaryingPSE, canvas: Canvas, precision: NDArray[np.float64]) -> Images:
    """By what a change of each layer is multiplied where photographs tell less or more of it, (2, 1, H, W)."""
    mixtures = pse.ghost_mixtures(canvas.height, canvas.width)
    weighted = np.tensordot(precision.astype(np.float32), mixtures, axes=1)
    told = np.einsum("elgyx,elgyx->lyx", mixtures, weighted)
    told /= told.mean(axis=(1, 2), keepdims=True)
    scale = 1 / np.sqrt(np.clip(told, _MOST_SCALE**-2, _MOST_SCALE**2))
    margins = [(0, 0), (canvas.top, canvas.bottom), (canvas.left, canvas.right)]
    return np.asarray(np.pad(scale, margins, mode="edge")[:, None], dtype=np.float32)


class _System:
    """Equations of the scaled change of the layers, images (2, channel, H, W) in the colour basis."""

    def __init__(
        self, known: ClosedForm, canvas: Canvas, scale: Images, misfit_gradient: Callable[[Images], Images]
    ) -> None:
        self.scale, self._basis, self._gradient = scale, known.basis.astype(np.float32), misfit_gradient
        self._stiffness = np.float32(1) / known.prior
        self._of_nothing = misfit_gradient(np.zeros_like(known.layers))
        pull = filtered(in_basis(self._basis, known.layers, np) - known.mean, self._stiffness)
        pull += in_basis(self._basis, misfit_gradient(known.layers), np)
        self.right: Images = np.asarray(-scale * pull)

    def applied(self, scaled: Images) -> Images:
        """The Hessian times a scaled change."""
        change = self.scale * scaled
        told = self._gradient(in_basis(self._basis.T, change, np)) - self._of_nothing
        return np.asarray(self.scale * (in_basis(self._basis, told, np) + filtered(change, self._stiffness)))


class _FastFilter:
    """Solves for all but slow changes, whose places in a half spectrum are told, behind the mean pane."""

    def __init__(self, known: ClosedForm, canvas: Canvas, slow: tuple[Any, Any]) -> None:
        of_each, determinant = left_open(known.told[:, None], known.cross, np.float32(1) / known.prior)
        self._of_each, self._cross, self._shape = of_each, -known.cross / determinant, canvas.shape
        for part in (self._of_each, self._cross):
            part[(..., *slow)] = 0

    def solved(self, right: Images) -> Images:
        """Fast changes that solve the equations."""
        from scipy.fft import irfft2, rfft2

        found = np.empty_like(right)

        def color(c: int, _: int) -> None:
            inverse = self._of_each[:, c], self._cross[c]
            found[:, c] = irfft2(applied(inverse, rfft2(right[:, c]), np), self._shape)

        in_blocks(color, right.shape[1], 1)
        return found


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

        self._periods = periods = max(1, min(_MOST_PERIODS, min(canvas.shape) // _FASTEST_PX))
        down, across = (x.ravel() for x in np.mgrid[-periods : periods + 1, 0 : periods + 1])
        kept = (np.hypot(down, across) <= periods) & ((across > 0) | (down >= 0))
        self._down, self._across = down[kept], across[kept]
        self._shape, self._n = canvas.shape, self._down.size
        # Of those that only change from row to row the half spectrum has each twice.
        self._twice = np.flatnonzero((self._across == 0) & (self._down > 0))
        level = int(np.flatnonzero((self._across == 0) & (self._down == 0))[0])
        self._length = np.full(self._n, np.sqrt(2.0))
        self._length[level] = 1.0
        self._waves = _waves(np.arange(-periods, periods + 1), np.arange(periods + 1), canvas.shape)
        told = _told_of(canvas, pse, precision, (self._down, self._across), self._length)
        # A level has no phase.
        self._free = np.delete(np.arange(4 * self._n), [self._n + level, 3 * self._n + level])
        prior = known.prior[:, :, self._down % canvas.shape[0], self._across].astype(np.float64)
        self._factors = []
        least = _ROUNDING * float(np.trace(told)) / len(told)
        for of_color in np.moveaxis(1 / prior, 1, 0):
            matrix = told + np.diag(np.repeat(of_color, 2, axis=0).ravel() + least)
            self._factors.append(cho_factor(matrix[np.ix_(self._free, self._free)]))

    @property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of a half spectrum that hold them."""
        rows = np.concatenate([self._down, -self._down[self._twice]]) % self._shape[0]
        return rows, np.concatenate([self._across, self._across[self._twice]])

    def solved(self, right: Images) -> Images:
        """Slow changes (2, channel, H, W) that solve the equations."""
        from scipy.linalg import cho_solve

        down, across = self._waves
        seen = (down @ right @ across)[..., self._down + self._periods, self._across] * self._length
        table = np.zeros((*right.shape[:2], len(down), across.shape[1]), dtype=np.complex64)
        for c, factor in enumerate(self._factors):
            whole = np.zeros(4 * self._n)
            parts = np.stack([seen[:, c].real, seen[:, c].imag], axis=1)
            whole[self._free] = cho_solve(factor, parts.ravel()[self._free], check_finite=False)
            of_each = whole.reshape(2, 2, self._n) * self._length
            table[:, c, self._down + self._periods, self._across] = of_each[:, 0] + 1j * of_each[:, 1]
        return np.asarray((down.conj().T @ table @ across.conj().T).real)


def _waves(down: NDArray[np.intp], across: NDArray[np.intp], shape: tuple[int, int]) -> tuple[Spectrum, Spectrum]:
    """What takes an image of this shape to its coefficients of some periods: (down, H) from the left, (W, across)."""
    rows, columns = (2 * np.pi * np.arange(side) / side for side in shape)
    left, right = np.exp(-1j * np.multiply.outer(down, rows)), np.exp(-1j * np.multiply.outer(columns, across))
    return (left / np.sqrt(shape[0])).astype(np.complex64), (right / np.sqrt(shape[1])).astype(np.complex64)


def _told_of(
    canvas: Canvas,
    pse: VaryingPSE,
    precision: NDArray[np.float64],
    periods: tuple[NDArray[np.intp], NDArray[np.intp]],
    length: NDArray[np.float64],
) -> NDArray[np.float64]:
    """What photographs tell of slow changes: of each layer's real and imaginary parts, (4 n, 4 n).

    Two changes meet in what the pane, which varies, has of their difference and of their sum.

    Parameters
    ----------
    canvas : Canvas
    pse : VaryingPSE
    precision : ndarray, shape (3, 3)
    periods : (ndarray, ndarray), shape (n,)
        Of the changes, down and across the canvas.
    length : ndarray, shape (n,)
        By what a coefficient is multiplied so that the transform keeps lengths.
    """
    down, across = periods
    most = 2 * int(max(down.max(), across.max()))
    step = max(1, min(canvas.shape) // (_PER_PERIOD * most))
    rows, columns = (np.arange(step // 2, side, step) for side in (canvas.height, canvas.width))
    mixtures, places = images_that_tell(pse, canvas.height, canvas.width)
    own = mixtures[..., rows[:, None], columns].astype(np.float64)
    weighted = np.tensordot(precision, own, axes=1)
    # What is seen of all differences and sums of two changes: from twice the periods one way to twice the other.
    omega = [2 * np.pi * np.arange(-most, most + 1) / side for side in canvas.shape]
    left = np.exp(1j * np.multiply.outer(omega[0], rows + canvas.top))
    right = np.exp(1j * np.multiply.outer(columns + canvas.left, omega[1]))
    apart = (most + down - down[:, None], most + across - across[:, None])
    together = (most + down + down[:, None], most + across + across[:, None])
    unit = length * (step / np.sqrt(canvas.shape[0] * canvas.shape[1]))
    moved = [
        unit * bilinear_transfer(dy, omega[0][most + down]) * bilinear_transfer(dx, omega[1][most + across])
        for dx, dy in places
    ]
    n = down.size
    told = np.empty((2, 2, n, 2, 2, n))
    for i, j in ((0, 0), (1, 1), (0, 1)):
        differences, sums = np.zeros((2, n, n), dtype=np.complex128)
        for g, h in np.ndindex(len(places), len(places)):
            table = left @ np.einsum("eyx,eyx->yx", own[:, i, g], weighted[:, j, h]) @ right
            differences += moved[g].conj()[:, None] * moved[h] * table[apart]
            sums += moved[g][:, None] * moved[h] * table[together]
        both, other = (differences + sums) / 2, (sums - differences) / 2
        block = np.array([[both.real, -both.imag], [-other.imag, -other.real]])
        told[i, :, :, j] = block.transpose(0, 2, 1, 3)
        told[j, :, :, i] = block.transpose(1, 3, 0, 2)
    return told.reshape(4 * n, 4 * n)
