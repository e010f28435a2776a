"""The clock stands still while paused, and memory is what a call takes beyond what was held."""

from __future__ import annotations

import time

import numpy as np

from studies.kit.timing import Clock, Threads, peak_above


def test_the_clock_stands_still_while_paused():
    clock = Clock()
    with clock.paused():
        time.sleep(0.2)
    assert clock.read()[0] < 0.1
    time.sleep(0.1)
    assert clock.read()[0] >= 0.1


def test_the_peak_is_what_a_call_takes():
    assert peak_above(lambda: np.ones(50_000_000 // 8)) > 40


def test_threads_are_said_in_words():
    assert str(Threads(torch=1)) == "torch 1, BLAS all"
