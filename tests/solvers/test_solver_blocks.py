"""Blocks of a range on threads: order, borders, failures, nesting, forks."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from solvers.kernels import in_blocks, thread_count


@given(n=st.integers(0, 500), block=st.integers(1, 120), threads=st.integers(1, 5))
def test_blocks_tile_the_range_in_order_whatever_the_threads(n, block, threads):
    borders = in_blocks(lambda start, stop: (start, stop), n, block, threads=threads)
    assert [i for start, stop in borders for i in range(start, stop)] == list(range(n))
    assert all(start % block == 0 for start, _ in borders)
    assert borders == in_blocks(lambda start, stop: (start, stop), n, block, threads=1)


def test_two_threads_work_at_the_same_time():
    # Each block waits for the other: alone, neither would end.
    barrier = threading.Barrier(2, timeout=30)
    names = in_blocks(lambda start, stop: (barrier.wait(), threading.get_ident())[1], 2, 1, threads=2)
    assert len(set(names)) == 2


@pytest.mark.parametrize(("n", "threads"), [(9, 2), (20, 1)])
def test_small_work_and_one_thread_stay_with_the_caller(n, threads):
    idents = in_blocks(lambda start, stop: threading.get_ident(), n, 3, smallest=10, threads=threads)
    assert set(idents) == {threading.get_ident()}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("error", [IndexError, ZeroDivisionError, KeyboardInterrupt])
def test_a_failure_reaches_the_caller_and_ends_the_work(threads, error):
    begun = []

    def fails(start, stop):
        begun.append(start)
        raise error("here")

    with pytest.raises(error, match="here"):
        in_blocks(fails, 100, 1, threads=threads)
    assert len(begun) <= threads
    assert in_blocks(lambda start, stop: start, 3, 1, threads=2) == [0, 1, 2]


def test_calls_may_be_nested_and_come_from_many_threads():
    def inner(start, stop):
        return sum(in_blocks(lambda a, b: b - a, 100, 7, threads=3))

    def outer(_):
        return in_blocks(inner, 10, 1, threads=3)

    with ThreadPoolExecutor(6) as callers:
        assert list(callers.map(outer, range(30))) == [[100] * 10] * 30


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_has_threads_of_its_own():
    in_blocks(lambda start, stop: start, 8, 1, threads=2)
    child = os.fork()
    if child == 0:
        os._exit(0 if in_blocks(lambda start, stop: start, 8, 1, threads=2) == list(range(8)) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.parametrize(("asked", "threads"), [("1", 1), ("1,4", 1), ("0", 1), (" 1 ", 1)])
def test_fewer_threads_can_be_asked_for(monkeypatch, asked, threads):
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert thread_count() == threads


@pytest.mark.parametrize("asked", ["", "many", "100000", "-1"])
def test_other_wishes_give_the_cores_there_are(monkeypatch, asked):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    cores = thread_count()
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert thread_count() == cores >= 1


def test_a_block_has_a_length():
    with pytest.raises(ValueError, match="block is 0"):
        in_blocks(lambda start, stop: None, 10, 0)
