"""Separations at the same time, again and again: the same bits, and nothing that grows."""

from __future__ import annotations

import os
import resource
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from polaropt import Capture, SceneParameters, StoppingRule, read_capture, separate
from polaropt.capture import write_capture
from tests.blends import blend

QUICK = StoppingRule(max_evaluations=4)
PANE = SceneParameters(60.0, 20.0, 3.0)


def layers(capture: Capture) -> np.ndarray:
    return separate(capture, PANE, stopping=QUICK).layers


def test_eight_threads_at_once_give_the_serial_bits(tmp_path: Path) -> None:
    files = [write_capture(blend(40 + 5 * k, 32).capture, tmp_path / f"{k}.tiff")[0] for k in range(8)]

    def separated(file: Path) -> np.ndarray:
        return layers(read_capture(file))

    serial = [separated(file) for file in files]
    with ThreadPoolExecutor(8) as threads:
        for alone, at_once in zip(serial, threads.map(separated, files), strict=True):
            np.testing.assert_array_equal(alone, at_once)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts open files as Linux tells them")
def test_many_solves_keep_no_memory_and_no_files(tmp_path: Path) -> None:
    (file,) = write_capture(blend(60, 32, color=False).capture, tmp_path / "a.tiff")

    def solve(times: int) -> tuple[int, int]:
        for _ in range(times):
            layers(read_capture(file))
        return len(os.listdir("/proc/self/fd")), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    solve(5)
    files, kilobytes = solve(10)
    more_files, more_kilobytes = solve(15)
    assert more_files == files
    assert more_kilobytes - kilobytes < 4096


@pytest.mark.parametrize(("chosen", "within"), [({}, 0.0), ({"init": "learned"}, 1e-5), ({"solver": "torch"}, 1e-5)])
def test_one_thread_and_two_find_the_same(
    chosen: dict[str, str], within: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch = pytest.importorskip("torch")
    capture, found, before = blend(60, 64).capture, [], torch.get_num_threads()
    try:
        for threads in (1, 2):
            monkeypatch.setenv("OMP_NUM_THREADS", str(threads))
            torch.set_num_threads(threads)
            found.append(separate(capture, PANE, stopping=QUICK, **chosen).layers)
    finally:
        torch.set_num_threads(before)
    np.testing.assert_allclose(*found, rtol=0, atol=within)
