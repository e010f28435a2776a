"""Power spectra by frequency and direction, fitted by Fisher scoring: for samples of a mosaic.

Four full photographs tell the layers nearly frequency by frequency, whatever is taken for their spectra. Samples leave
each frequency to be told from its aliases by the spectra alone: how a lens makes them fall toward the sampling limit,
and that edges of photographs run down and across more often than not.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polaropt.inversion.spectra import FittedSpectra, Moments, Power
from polaropt.numerics import NATURAL_POWER_LAW, frequencies, natural_frequencies

# Nodes of the spectra: some evenly spaced in the logarithm of frequency up to a frequency (rad/px), then some evenly
# spaced in frequency, where a lens acts; and directions. By trial on pairs of other photographs than are judged: more
# nodes gain nothing; evenly spaced in the logarithm alone, as many lose 0.1 to 0.3 dB.
_SLOW_NODES, _FAST_NODES, _FAST = 5, 7, 0.6
_DIRECTIONS = 4
# Turns of scoring: first the power law's level alone, then every node. By trial: six more change 0.05 dB.
SCORING_TURNS_LAW, SCORING_TURNS_NODES = 3, 8
# Squared share told that a step is divided by at least, and the largest step of a logarithm: what the samples hardly
# tell would run away. By trial: 0.02 and 0.1 lose up to 0.3 dB.
SCORING_LEAST_TOLD, SCORING_LONGEST_STEP = 0.05, 1.0
# Share of all frequencies that a node must hold before it moves freely. Set by hand.
SCORING_INERTIA = 2e-4
# Entries of a table over the logarithm of frequency, and over direction.
_TABLE = (2048, 128)

EQUIVALENT_TURNS = int(SCORING_TURNS_NODES / SCORING_LEAST_TOLD)
"""Turns of expectation maximization that lead as far where little is told: each goes a share ``told^2`` of the way."""


class DirectionalBands:
    """Nodes over frequency and direction of a half spectrum, linear between neighbours.

    Parameters
    ----------
    height, width : int
        Of the images.
    sample : ndarray of int, shape (n,)
        Flat indices of the frequencies to stand for all.
    counts : ndarray, shape (n,)
        For how many frequencies of the whole spectrum each of them stands.

    Attributes
    ----------
    sample : ndarray of int, shape (n,)
    share : ndarray of float32, shape (n,)
        Of all frequencies of the whole spectrum, for which a sampled one stands.
    squared_frequency : ndarray of float32, shape (n,)
        Of the sample.
    n_nodes : int
    """

    def __init__(self, height: int, width: int, sample: NDArray[np.intp], counts: NDArray[np.float64]) -> None:
        self._shape = (height, width)
        squared = natural_frequencies(height, width)
        self._span = np.log([float(squared.min()), float(squared.max())])
        self._logarithm: Power = np.log(squared).astype(np.float32)
        slowest, fastest = np.exp(self._span / 2)
        slow = np.geomspace(min(slowest, _FAST / 2), _FAST, _SLOW_NODES, endpoint=False)
        self._nodes = 2 * np.log(np.concatenate([slow, np.linspace(_FAST, fastest, _FAST_NODES)]))
        self.n_nodes = self._nodes.size * _DIRECTIONS
        self.sample = sample
        self.share: Power = (counts / (height * width)).astype(np.float32)
        self.squared_frequency: Power = squared.ravel()[sample].astype(np.float32)
        turns = self._turns().ravel()[sample]
        self._near = self._neighbours(np.log(squared.ravel()[sample]), turns)
        self._size = self.sums(self.share)

    def sums(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Sums of values at the sample over the parts of it that are nearest to each node, (nodes,)."""
        index, weights = self._near
        return np.asarray(np.bincount(index.ravel(), (weights * values).ravel(), self.n_nodes), dtype=np.float64)

    def step(self, ratio: Power, told: Power) -> NDArray[np.float64]:
        """Of the nodes' logarithms by Fisher scoring, from the expected power over the one assumed, and its share told.

        The logarithm of the likelihood rises by the excess of the ratio over 1; ``told^2`` is its expected curvature.
        """
        information = np.maximum(self.sums(told**2 * self.share), SCORING_LEAST_TOLD * self._size) + SCORING_INERTIA
        return _bounded(self.sums((ratio - 1) * self.share) / information)

    def at_sample(self, logarithms: NDArray[np.float64]) -> Power:
        """Exponential of the nodes' logarithms, interpolated to the sample."""
        index, weights = self._near
        smooth: Power = np.exp((logarithms[index] * weights).sum(axis=0)).astype(np.float32)
        return smooth

    @cached_property
    def weights(self) -> Power:
        """Of each sampled frequency in each node, (nodes, n): those of `at_sample` and `sums`."""
        return _dense(*self._near, self.n_nodes).astype(np.float32)

    @property
    def entry(self) -> NDArray[np.int32]:
        """Where in the `tables` each frequency is, (height, width // 2 + 1)."""
        return self._table[3]

    @property
    def tables(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The logarithm of a power law of 1 (n,), and each node's weight in its correction (n, nodes)."""
        logs, index, weights, _ = self._table
        return -NATURAL_POWER_LAW / 2 * logs, _dense(index, weights, self.n_nodes).T

    def power_law(self, power: float, logarithms: NDArray[np.float64]) -> Power:
        """Power of every frequency, (height, width // 2 + 1): a power law times the nodes' correction of it."""
        logs, index, weights, place = self._table
        correction = (logarithms[index] * weights).sum(axis=0)
        law = np.log(power) - NATURAL_POWER_LAW / 2 * logs
        table: Power = np.exp(correction + law).astype(np.float32)
        return np.asarray(table[place])

    @cached_property
    def _table(self) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.floating], NDArray[np.int32]]:
        """Of the entries that are used the logarithm (n,), nodes and their weights (4, n); which each frequency is at.

        Of a small frame they are a hundredth of the table.
        """
        entry = self._entry()
        used = np.zeros(_TABLE[0] * _TABLE[1], np.bool_)
        used[entry] = True
        entries = np.flatnonzero(used)
        place = np.zeros(used.size, np.int32)
        place[entries] = np.arange(entries.size)
        slowest, fastest = (float(end) for end in self._span)
        logs, turns = np.linspace(slowest, fastest, _TABLE[0]), np.arange(_TABLE[1]) / _TABLE[1]
        logs, turns = logs[entries // _TABLE[1]], turns[entries % _TABLE[1]]
        return logs, *self._neighbours(logs, turns), place[entry]

    def _entry(self) -> NDArray[np.int32]:
        """Where in a table over the logarithm of frequency and direction each frequency is."""
        rows = (self._logarithm - np.float32(self._span[0])) * np.float32((_TABLE[0] - 1) / np.ptp(self._span))
        across = np.rint(self._turns() * np.float32(_TABLE[1])).astype(np.int32) % _TABLE[1]
        down = np.clip(np.rint(rows), 0, _TABLE[0] - 1).astype(np.int32)
        return np.asarray(down * np.int32(_TABLE[1]) + across)

    def _turns(self) -> Power:
        """Direction of each frequency in half turns, (height, width // 2 + 1), 0..1."""
        down, across = (axis.astype(np.float32) for axis in frequencies(*self._shape))
        return np.asarray(np.arctan2(down, across) / np.float32(np.pi) % 1)

    def _neighbours(
        self, logarithm: NDArray[np.floating], turns: NDArray[np.floating]
    ) -> tuple[NDArray[np.intp], NDArray[np.floating]]:
        """The four nearest nodes of points (n,) and their weights, each (4, n)."""
        radius = np.interp(logarithm, self._nodes, np.arange(self._nodes.size))
        inner = np.minimum(radius.astype(np.intp), self._nodes.size - 2)
        direction = turns * _DIRECTIONS
        before = direction.astype(np.intp)
        outward, onward = radius - inner, direction - before
        places = [(inner + i) * _DIRECTIONS + (before + j) % _DIRECTIONS for i in (0, 1) for j in (0, 1)]
        weights = [(outward if i else 1 - outward) * (onward if j else 1 - onward) for i in (0, 1) for j in (0, 1)]
        return np.stack(places), np.stack(weights)


def _dense(index: NDArray[np.intp], weights: NDArray[np.floating], n: int) -> NDArray[np.float64]:
    """Weights (4, points) of nodes as a matrix (n, points)."""
    matrix = np.zeros((n, index.shape[1]))
    np.add.at(matrix, (index, np.arange(index.shape[1])), weights)
    return matrix


def _bounded(step: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.clip(step, -SCORING_LONGEST_STEP, SCORING_LONGEST_STEP)


def fit_directional_spectra(
    moments: Moments, bands: DirectionalBands, gradient_power: NDArray[np.float64]
) -> FittedSpectra:
    """Spectra under which the samples are likeliest: first a power law, then its correction at each node.

    Expectation maximization, which `polaropt.inversion.spectra.fit_spectra` does, would take more than a hundred turns:
    samples tell little of fast frequencies, and a turn goes no farther than the square of what is told.

    Parameters
    ----------
    moments : callable
        At the sample of `bands`.
    bands : DirectionalBands
    gradient_power : ndarray, shape (channel,)
        Mean squared gradient per colour to start from.

    References
    ----------
    C. R. Rao, Large sample tests of statistical hypotheses concerning several parameters, Mathematical Proceedings of
    the Cambridge Philosophical Society 44, 1948 (the method of scoring).
    """
    law = bands.squared_frequency ** (NATURAL_POWER_LAW / 2)
    power = np.stack([gradient_power, gradient_power])
    prior: Power = (power[..., None] / law).astype(np.float32)
    for _ in range(SCORING_TURNS_LAW):
        expected, left = moments(prior)
        excess, told = (expected / prior - 1) @ bands.share, (1 - left / prior) ** 2 @ bands.share
        power = power * np.exp(_bounded(excess / np.maximum(told, SCORING_LEAST_TOLD)))
        prior = (power[..., None] / law).astype(np.float32)
    logarithms = np.zeros((*power.shape, bands.n_nodes))
    for _ in range(SCORING_TURNS_NODES):
        expected, left = moments(prior)
        for where in np.ndindex(power.shape):
            step = bands.step(expected[where] / prior[where], 1 - left[where] / prior[where])
            logarithms[where] += step
            prior[where] *= bands.at_sample(step)
    return FittedSpectra(power, logarithms, prior, moments(prior)[1])
