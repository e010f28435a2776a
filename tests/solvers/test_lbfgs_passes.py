"""The parts of our L-BFGS: its passes over memory against numpy, its direction against the textbook."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solvers import passes
from solvers.lbfgs import Gram
from solvers.passes import Pairs


def two_loops(gradient, pairs):
    """Nocedal's recursion, in float64."""
    q, factors = gradient.copy(), []
    for step, change in reversed(pairs):
        factors.append(step @ q / (step @ change))
        q -= factors[-1] * change
    r = q
    if pairs:
        step, change = pairs[-1]
        r = r * (step @ change / (change @ change))
    for (step, change), factor in zip(pairs, reversed(factors), strict=True):
        r += (factor - change @ r / (step @ change)) * step
    return -r


class Walk:
    """Points and gradients of a random convex quadratic, walked along, with the pairs that a textbook would keep."""

    def __init__(self, n, history, seed):
        self.random = np.random.default_rng(seed)
        root = self.random.standard_normal((n, n)) / np.sqrt(n)
        self.hessian = root @ root.T + 0.1 * np.eye(n)
        self.history = history
        self.gram, self.pairs = Gram(history), Pairs(n, history)
        self.x = self.random.standard_normal(n).astype(np.float32)
        self.kept = []
        self.unit = 1 / np.linalg.norm(self.gradient)
        self.gram.begin(self.pairs.begin(self.gradient, self.unit))

    @property
    def gradient(self):
        return (self.hessian @ self.x).astype(np.float32)

    def step(self):
        before, gradient = self.x, self.gradient
        self.x = (before + self.random.standard_normal(before.size) / 2).astype(np.float32)
        slot = self.gram.take_slot()
        self.gram.remember(slot[0], self.pairs.absorb((before, self.x), self.gradient, slot))
        pair = (self.x - before).astype(np.float64), (self.gradient - gradient).astype(np.float64)
        self.kept = [*self.kept, pair][-self.history :]

    def direction(self):
        found = self.gram.direction()
        trial = np.empty_like(self.x)
        self.pairs.propose(self.x, found.weights, trial)
        return trial.astype(np.float64) - self.x, found.slope / self.unit

    def textbook(self):
        return two_loops(self.gradient.astype(np.float64), self.kept)


@given(
    n=st.integers(2, 40),
    history=st.integers(1, 7),
    n_steps=st.integers(0, 12),
    seed=st.integers(0, 999),
)
def test_the_direction_is_the_two_loop_recursions(n, history, n_steps, seed):
    walk = Walk(n, history, seed)
    for _ in range(n_steps):
        walk.step()
    direction, slope = walk.direction()
    expected = walk.textbook()
    # The gradient is kept in units: without pairs the direction is, too.
    if not n_steps:
        expected *= walk.unit
    size = np.linalg.norm(expected) + 1e-2 * np.linalg.norm(walk.x)
    assert np.linalg.norm(direction - expected) <= 2e-3 * size
    assert slope == pytest.approx(expected @ walk.gradient, rel=1e-2)
    assert slope < 0


def test_the_kept_pairs_predict_the_gradient_change():
    # The secant equation: the inverse Hessian turns the youngest change into its step.
    walk = Walk(30, 4, 5)
    for _ in range(6):
        walk.step()
    gradient = walk.gradient.astype(np.float64)
    step, change = walk.kept[-1]
    turned = two_loops(change, walk.kept)
    np.testing.assert_allclose(-turned, step, rtol=1e-9, atol=1e-12)
    assert gradient @ walk.direction()[0] < 0


@pytest.mark.parametrize("n", [1, 7, 4096, 10_000])
def test_the_passes_agree_with_numpy(n):
    random = np.random.default_rng(n)
    m, slot, used = 3, 1, 2
    x, trial, gradient, kept = random.standard_normal((4, n)).astype(np.float32)
    steps, changes = np.zeros((2, m, n), np.float32)
    before = kept.copy()
    passes.absorb(x, x, before, before, 1.0, steps, changes, 0, 1, 0, n)
    sums = passes.absorb(x, trial, gradient, kept, 0.5, steps, changes, slot, used, 0, n)
    np.testing.assert_array_equal(kept, gradient / 2)
    s, y = steps[slot], changes[slot]
    np.testing.assert_array_equal(s, trial - x)
    np.testing.assert_array_equal(y, gradient / 2 - before)
    expected = np.zeros(4 * m + 3)
    wide = [v.astype(np.float64) for v in (kept, y, s)]
    expected[[slot, m + slot, 2 * m + slot, 3 * m + slot]] = (
        wide[0] @ wide[2], wide[0] @ wide[1], wide[1] @ wide[2], wide[1] @ wide[1],
    )  # fmt: skip
    expected[-3:] = wide[0] @ wide[0], wide[1] @ wide[1], (trial - x).astype(float) @ (trial - x)
    np.testing.assert_allclose(sums, expected, rtol=1e-5, atol=1e-4 * np.sqrt(n))
    passes.propose(x, kept, steps, changes, np.array([0.3, 0, -0.7, 0, 0, 0.2, 0]), trial, 0, n)
    np.testing.assert_allclose(trial, x + 0.3 * kept - 0.7 * s + 0.2 * y, atol=2e-6)


def test_slots_that_hold_nothing_are_not_read():
    walk = Walk(20, 5, 1)
    walk.pairs._steps[:] = walk.pairs._changes[:] = np.nan
    for _ in range(3):
        walk.step()
        direction, slope = walk.direction()
        assert np.isfinite(direction).all()
        assert slope < 0


def test_a_pair_without_curvature_does_not_count():
    gram = Gram(2)
    gram.begin(1.0)
    slot, used = gram.take_slot()
    assert (slot, used) == (0, 1)
    # Step and change at a right angle.
    gram.remember(slot, np.array([0.5, 0, 0.5, 0, 0.0, 0, 1.0, 0, 1.0, 1.0, 1.0]))
    assert gram.empty
    assert gram.direction().weights.tolist() == [-1, 0, 0, 0, 0]
