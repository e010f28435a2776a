"""Ghost shift of the pane, by the likelihood of the capture's spectra (Whittle) as a function of the shift.

The ghosts put notches across the spectra of what each polarization shows, and turn the phase between the two; the
latter tells the shift's sense. The layers are independent, with smooth unknown power spectra that are fitted along.
The likelihood is Student's, so that a few frequencies full of oriented edges do not decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.cross_spectra import CrossSpectra
from polaropt.fresnel import interface
from polaropt.plate_frame import Images, Matrix
from polaropt.scene import SceneParameters

Spectrum = NDArray[np.complex64]

_RADIAL_KNOTS = 3
_DEGREES_OF_FREEDOM = 4.0
_FIRST_ROUNDS, _ROUNDS = 12, 4
_LEAST_DETERMINANT = np.float32(1e-6)
_EVERY = 8
"""Levels are first fitted for every so-many-th shift, then carried to those between."""


class _Hermitian(NamedTuple):
    """2x2 Hermitian matrices, one per shift and frequency."""

    par: Images
    perp: Images
    cross: Spectrum


class ShiftLikelihood:
    """Likelihood of ghost shifts given a capture's mean spectra.

    Parameters
    ----------
    spectra : CrossSpectra
    scene : SceneParameters
        Index and surfaces of the pane; its geometry is not used.
    """

    def __init__(self, spectra: CrossSpectra, scene: SceneParameters) -> None:
        self._data = _Hermitian(spectra.par, spectra.perp, spectra.cross)
        self._noise = spectra.covariance.astype(np.float32)
        self._along = spectra.along
        self._coherence = spectra.coherence
        self._multiplicity = spectra.multiplicity
        self._scene = scene
        self._shapes = _spectral_shapes(spectra.along, spectra.across)
        """(level, frequency): natural images' power, split over a few radii and two directions."""

    def misfit(self, incidence_deg: float, shifts: Sequence[float] | Matrix, quick: bool = False) -> Matrix:
        """Minus log likelihood per frequency of each shift (pixels, signed), up to a constant.

        `quick` fits the spectra less closely.
        """
        shifts = np.asarray(shifts, dtype=np.float64)
        sparse = shifts[::_EVERY]
        levels = np.full((2, sparse.size, len(self._shapes)), 1e-3, np.float32)
        levels = self._fitted(self._responses(incidence_deg, sparse), levels, _FIRST_ROUNDS)
        nearest = np.minimum((np.arange(shifts.size) + _EVERY // 2) // _EVERY, sparse.size - 1)
        responses = self._responses(incidence_deg, shifts)
        levels = self._fitted(responses, levels[:, nearest], 1 if quick else _ROUNDS)
        _, determinant, distance = self._model(responses, levels)
        nu = _DEGREES_OF_FREEDOM
        value: Matrix = (np.log(determinant) + (nu + 2) * np.log(nu + distance)) @ self._multiplicity.astype(np.float64)
        return value / float(self._multiplicity.sum())

    def _responses(self, incidence_deg: float, shifts: Matrix) -> tuple[_Hermitian, _Hermitian]:
        """Outer products of the transfer functions of reflection and transmission."""
        z = np.exp((-1j * self._along * shifts[:, None]).astype(np.complex64))
        coherence = self._coherence(shifts)[:, None]
        scene = self._scene
        reflected, transmitted, direct = [], [], []
        for reflectance in interface(incidence_deg, scene.refractive_index).reflection[:2]:
            through = (1 - reflectance) if scene.single_surface else (1 - reflectance) ** 2
            direct.append((reflectance, through))
            if scene.single_surface or scene.n_bounces == 0:
                reflected.append(np.zeros_like(z))
                transmitted.append(np.zeros_like(z))
            else:
                series = z / (1 - reflectance**2 * z)
                reflected.append((reflectance * through * series).astype(np.complex64))
                transmitted.append((through * reflectance**2 * series).astype(np.complex64))
        (r_par, t_par), (r_perp, t_perp) = direct
        return (
            _outer((r_par, r_perp), reflected, coherence),
            _outer((t_par, t_perp), transmitted, coherence),
        )

    def _fitted(self, responses: tuple[_Hermitian, _Hermitian], levels: Images, rounds: int) -> Images:
        """Levels of both layers' spectra by multiplicative steps towards the maximum of the likelihood."""
        levels = levels.copy()
        for _ in range(rounds):
            model, determinant, distance = self._model(responses, levels)
            inverse = _Hermitian(model.perp / determinant, model.par / determinant, -model.cross / determinant)
            weight = self._multiplicity * (_DEGREES_OF_FREEDOM + 2) / (_DEGREES_OF_FREEDOM + distance)
            seen = _sandwich(inverse, self._data)
            for level, response in zip(levels, responses, strict=True):
                gain = (_trace(seen, response) * weight) @ self._shapes.T
                expected = (_trace(inverse, response) * self._multiplicity) @ self._shapes.T
                level *= np.maximum(gain / expected, np.float32(1e-3))
        return levels

    def _model(self, responses: tuple[_Hermitian, _Hermitian], levels: Images) -> tuple[_Hermitian, Images, Images]:
        """Covariance at each shift and frequency, its determinant, and the data's squared distance from it."""
        powers = levels @ self._shapes
        noise = (self._noise[0, 0], self._noise[1, 1], self._noise[0, 1])
        par, perp, cross = (powers[0] * r + powers[1] * t + n for r, t, n in zip(*responses, noise, strict=True))
        model = _Hermitian(par, perp, cross)
        # Rounding must not make a covariance singular where one layer outshines noise and the other layer by far.
        determinant = np.maximum(par * perp - cross.real**2 - cross.imag**2, _LEAST_DETERMINANT * par * perp)
        swapped = _Hermitian(perp, par, -cross)
        return model, determinant, _trace(swapped, self._data) / determinant


def _spectral_shapes(along: Matrix, across: Matrix) -> Images:
    radius2 = along**2 + across**2
    position = np.log(radius2) / 2
    knots = np.linspace(position.min(), position.max(), _RADIAL_KNOTS)
    hats = np.maximum(0, 1 - np.abs(position - knots[:, None]) / (knots[1] - knots[0]))
    directions = np.stack([along**2, across**2]) / radius2
    shapes: Images = np.concatenate([hats * direction / radius2 for direction in directions]).astype(np.float32)
    return shapes


def _outer(direct: tuple[float, float], ghosts: Sequence[Spectrum], coherence: Images) -> _Hermitian:
    """Outer product of direct light plus ghosts, which the window tells apart from it as far as they are shifted."""
    par, perp = (np.float32(value) for value in direct)
    first, second = ghosts
    return _Hermitian(
        par * (par + 2 * coherence * first.real) + first.real**2 + first.imag**2,
        perp * (perp + 2 * coherence * second.real) + second.real**2 + second.imag**2,
        par * perp + first * second.conj() + coherence * (par * second.conj() + perp * first),
    )


def _sandwich(inverse: _Hermitian, data: _Hermitian) -> _Hermitian:
    """Inverse times data times inverse."""
    conjugate = inverse.cross.conj()
    top_left = inverse.par * data.par + inverse.cross * data.cross.conj()
    top_right = inverse.par * data.cross + inverse.cross * data.perp
    low_left = conjugate * data.par + inverse.perp * data.cross.conj()
    low_right = conjugate * data.cross + inverse.perp * data.perp
    return _Hermitian(
        (top_left * inverse.par + top_right * conjugate).real.astype(np.float32),
        (low_left * inverse.cross + low_right * inverse.perp).real.astype(np.float32),
        top_left * inverse.cross + top_right * inverse.perp,
    )


def _trace(a: _Hermitian, b: _Hermitian) -> Images:
    """Trace of the product of Hermitian matrices."""
    total: Images = a.par * b.par + a.perp * b.perp
    total = total + 2 * (a.cross.real * b.cross.real + a.cross.imag * b.cross.imag)
    return total
