"""The analyzers of a sensor as they are: gain, contrast and angle of each corner of its cell, and how to measure them.

A pixel behind an analyzer measures ``I = g (s0 + D (s1 cos 2a + s2 sin 2a)) / 2``: gain g, contrast
``D = (E - 1) / (E + 1)`` of extinction ratio E, true angle a (Hagen, Otani, Optical Engineering 58, 2019).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polaropt.errors import InputError
from polaropt.numerics import turn_between
from polaropt.optics.stokes import analyzer_matrix

Floats = NDArray[np.float64]

_UNPOLARIZED = 0.1
"""Degree of polarization below which a field was taken without a polarizer: one behind it has 0.8 and more. By hand."""
_FEWEST_TURNS = 4
"""Turns of a polarizer that tell contrast and angle: four turns of four corners are 16 numbers for 15 unknowns, of
which a few choices fit; with a fifth turn or an unpolarized field only one does."""
_TRUST = 1e-2
"""Weight of analyzers being alike and as they should be, in units of a field's light: what fields tell hardly changes
by it, and what they leave open stays where sensors are made. Set by hand."""
_LEFT_OPEN = 0.3
"""Standard error of an angle, in units of what it would be without any field, from which on fields leave it open. Set
by hand."""
_LEAST_TURN_DEG = 5.0
"""By which turns must differ to count as two; set by hand."""
GAIN_LIMITS, CONTRAST_LIMITS, TURN_LIMIT_DEG = (0.5, 2.0), (0.5, 1.0), 20.0
"""Gains, contrasts and deviations from the nominal angle that a sensor can have; set by hand."""


@dataclass(frozen=True)
class Analyzer:
    """Analyzers of a cell by their nominal angles.

    Attributes
    ----------
    angles_deg : tuple of float
        Nominal, ascending.
    gains : tuple of float
        Their mean is 1.
    contrasts : tuple of float
    true_angles_deg : tuple of float
        Up to one common rotation; their mean deviation from the nominal ones is 0.

    Raises
    ------
    InputError
        Numbers outside what a sensor can have.
    """

    angles_deg: tuple[float, ...]
    gains: tuple[float, ...]
    contrasts: tuple[float, ...]
    true_angles_deg: tuple[float, ...]

    def __post_init__(self) -> None:
        lists = (self.angles_deg, self.gains, self.contrasts, self.true_angles_deg)
        if len({len(values) for values in lists}) != 1 or len(self.angles_deg) < 3:
            raise InputError("an analyzer needs an angle, gain, contrast and true angle for each corner of the cell")
        if not np.all(np.isfinite(np.array(lists))):
            raise InputError("a number of the analyzer is not finite; calibrate it anew")
        turned = np.abs(turn_between(np.array(self.true_angles_deg), np.array(self.angles_deg)))
        for name, values, (least, most) in (
            ("gain", self.gains, GAIN_LIMITS),
            ("contrast", self.contrasts, CONTRAST_LIMITS),
            ("deviation in degrees", turned.tolist(), (0.0, TURN_LIMIT_DEG)),
        ):
            if min(values) < least or max(values) > most:
                raise InputError(
                    f"an analyzer's {name} is {min(values):.3g} to {max(values):.3g}; it must lie in {least:g} to "
                    f"{most:g}: check the cell order and the fields that it was measured on"
                )

    @property
    def matrix(self) -> Floats:
        """Rows in the place of those of `analyzer_matrix`, without the gains, (k, 3)."""
        rows = analyzer_matrix(self.true_angles_deg)
        rows[:, 1:] *= np.array(self.contrasts)[:, None]
        return rows

    @property
    def missing(self) -> Floats:
        """What ideal analyzers at the nominal angles measure beyond these, gains apart, from Stokes vectors (k, 3).

        Samples are completed by it, with Stokes images of the whole mosaic, and then taken for an ideal sensor's. The
        rows themselves in the sampling of closed form and misfit were tried and are no better: simulated mosaics with
        contrasts of 0.90 to 0.94 and angles off by up to 3 degrees give 39.22 / 27.01 dB (transmission / reflection,
        means of 12 mono ones, pane known) so, 39.21 / 26.87 with the rows, 39.33 / 27.13 by an ideal sensor, and 38.47
        / 25.90 with nothing done; 8 colour ones 33.84 / 23.88, 33.88 / 23.80, 33.94 / 23.93 and 33.65 / 23.50.
        """
        return analyzer_matrix(self.angles_deg) - self.matrix


@dataclass(frozen=True)
class Calibration:
    """An analyzer, and what the fields told of it.

    Attributes
    ----------
    analyzer : Analyzer
    n_unpolarized, n_turns : int
        Fields without a polarizer, and different turns of one.
    residual : float
        Root mean square of what is left, as a share of the light.
    angles_open : bool
        Whether the fields leave the angles open beside their common rotation, as turns do that are 45 degrees apart:
        those of one orthogonal pair may turn against the other.
    """

    analyzer: Analyzer
    n_unpolarized: int
    n_turns: int
    residual: float
    angles_open: bool = False

    @property
    def complete(self) -> bool:
        """Whether contrast and angles were told, not the gains alone."""
        return self.n_turns >= _FEWEST_TURNS

    @property
    def ambiguous(self) -> bool:
        """Whether four turns alone explain the fields in more than one way, up to 1 % of a gain or contrast apart."""
        return self.n_turns == _FEWEST_TURNS and self.n_unpolarized == 0


def calibrate(fields: ArrayLike, angles_deg: Sequence[float]) -> Calibration:
    """Fit the analyzers of a cell to evenly lit fields.

    Unpolarized fields tell the gains. Fields of one steady, unpolarized lamp behind a good polarizer in four or more
    turns tell contrast and angles as well, up to one common rotation.

    Parameters
    ----------
    fields : array_like, shape (n, k)
        Mean of each corner's samples, linear, for each field.
    angles_deg : sequence of k floats
        Nominal angles, ascending.

    Raises
    ------
    InputError
        Fields that tell nothing: dark ones, or fewer than 4 turns and none without a polarizer.
    """
    from scipy.optimize import least_squares

    light = np.asarray(fields, dtype=np.float64)
    angles = np.asarray(angles_deg, dtype=np.float64)
    if light.ndim != 2 or light.shape[1] != angles.size or not len(light):
        raise InputError(f"fields have shape {light.shape}; give a mean for each corner of each field")
    if not np.all(np.isfinite(light)) or light.mean(axis=1).min() <= 0:
        raise InputError("a field is dark; give evenly lit ones")
    stokes = light @ np.linalg.pinv(analyzer_matrix(angles_deg)).T
    dolp, turns = np.hypot(stokes[:, 1], stokes[:, 2]) / stokes[:, 0], np.arctan2(stokes[:, 2], stokes[:, 1]) / 2
    flat = dolp < _UNPOLARIZED
    n_turns = _different(np.degrees(turns[~flat]))
    k, n_flat = angles.size, int(flat.sum())
    if not n_flat and n_turns < _FEWEST_TURNS:
        raise InputError(
            f"the fields show {n_turns} turns of a polarizer and none is unpolarized; give {_FEWEST_TURNS} turns or "
            "more, or fields without a polarizer"
        )
    if n_turns < _FEWEST_TURNS:
        shares = light[flat] / light[flat].mean(axis=1, keepdims=True)
        gains = shares.mean(axis=0)
        left = float(np.sqrt(np.mean(np.square(shares - gains))))
        of_gains = Analyzer(_listed(angles), _listed(gains / gains.mean()), (1.0,) * k, _listed(angles))
        return Calibration(of_gains, n_flat, n_turns, left)
    lit = light / light[~flat].mean()
    levels = np.r_[lit[~flat].mean(), lit[flat].mean(axis=1)]

    def residual(x: Floats) -> Floats:
        gains, contrasts, deviations, levels, turned = np.split(x, np.cumsum([k, k, k, 1 + n_flat]))
        model = np.empty_like(lit)
        swing = np.cos(2 * (turned[:, None] - np.radians(angles) - deviations))
        model[~flat] = levels[0] * gains * (1 + contrasts * swing)
        model[flat] = levels[1:, None] * gains
        # What no field tells is fixed: the mean gain and the common rotation; and turns as far apart as the analyzers
        # leave open which of them deviate.
        gauge = [
            gains.mean() - 1,
            deviations.mean(),
            *(_TRUST * deviations),
            *(_TRUST * (contrasts - contrasts.mean())),
        ]
        return np.concatenate([(model - lit).ravel(), gauge])

    start = np.concatenate([np.ones(k), np.full(k, 0.98), np.zeros(k), levels, turns[~flat]])
    fitted = least_squares(residual, start, x_scale="jac")
    gains, contrasts, deviations = np.split(fitted.x[: 3 * k], 3)
    analyzer = Analyzer(
        _listed(angles),
        _listed(gains),
        _listed(np.minimum(contrasts, CONTRAST_LIMITS[1])),
        _listed(angles + np.degrees(deviations)),
    )
    left = float(np.sqrt(np.mean(np.square(residual(fitted.x)[: lit.size]))))
    # The errors that all leave, were the unit of light the noise; the weakest prior counts as no field.
    errors = np.sqrt(np.diag(np.linalg.pinv(fitted.jac.T @ fitted.jac))[2 * k : 3 * k])
    return Calibration(analyzer, n_flat, n_turns, left, bool(errors.max() > _LEFT_OPEN / _TRUST))


def _different(turns_deg: Floats) -> int:
    """How many turns differ, modulo 180 degrees."""
    kept: list[float] = []
    for turn in turns_deg:
        if all(abs(turn_between(turn, other)) >= _LEAST_TURN_DEG for other in kept):
            kept.append(float(turn))
    return len(kept)


def _listed(values: NDArray[Any]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
