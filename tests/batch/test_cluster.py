"""Processes of our own and a cluster's workers do what this process does, also where they are killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from polaropt import SceneParameters, separate, separate_many
from polaropt.batch.cluster import Place, WorkerDied, _interruptions_later, connected, done, local_cluster, place_for
from polaropt.batch.job import Job, Options
from polaropt.batch.run import run_batch
from polaropt.capture.files.write import write_capture
from polaropt.errors import InputError
from tests.captured import photographed
from tests.workers import always_die, die_once

ROOT = Path(__file__).parents[2]
SECONDS = 60
# Dask leaves sockets to the garbage collector.
pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A client of a process of our own, which may die once at a job."""
    dask = pytest.importorskip("dask")
    # Its settings are there from here on.
    pytest.importorskip("distributed")
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}), local_cluster(1, 1, None) as client:
        yield client


def test_workers_of_a_client_separate_as_this_process_does(client: Any) -> None:
    captures, pane = [photographed((48, 48), seed=seed) for seed in range(2)], SceneParameters(60.0, 20.0, 4.0)
    there = list(separate_many(captures, pane, client=client))
    for result, capture in zip(there, captures, strict=True):
        np.testing.assert_array_equal(result.layers, separate(capture, pane).layers)
        assert result.uncertainty.shape == result.layers.shape


def test_what_killed_workers_were_at_is_done_again(client: Any, tmp_path: Path) -> None:
    assert client.scheduler.address.startswith("tls://127.0.0.1")
    assert dict(done(partial(die_once, folder=str(tmp_path)), range(3), client)) == {0: 0, 1: 1, 2: 4}
    assert (tmp_path / "killed").exists()
    found = dict(done(always_die, range(4), client, at_once=1))
    assert isinstance(found.pop(1), WorkerDied)
    assert isinstance(found.pop(2), InputError)
    assert found == {0: 0, 3: 9}


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of Dask's, ended with the block."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments], env=environment, cwd=ROOT, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def others() -> Iterator[Any]:
    """The scheduler of somebody's cluster with one worker, both threads of this process."""
    pytest.importorskip("dask")
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=None
    ) as cluster:
        yield cluster.scheduler


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.05)


def test_a_cluster_of_others_loses_a_worker_and_nothing_else(tmp_path: Path) -> None:
    for number in range(4):
        write_capture(photographed((32, 32), bits=12, seed=number), tmp_path / f"{number}.npz")
    (tmp_path / "bad.npz").write_bytes(b"")

    def jobs(out: str) -> list[Job]:
        options = Options(separating={"model": "pixelwise"}, layers_only=True)
        return [
            Job(path.stem, (str(path),), str(tmp_path / out / path.stem), options)
            for path in sorted(tmp_path.glob("*.npz"))
        ]

    file = tmp_path / "scheduler.json"
    worker = ("worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard")
    with others() as scheduler:
        file.write_text(json.dumps(scheduler.identity()))
        with started(*worker) as killed:
            wait_for(lambda: len(scheduler.workers) == 2, "no worker")
            place = place_for(None, None, str(file), False)
            assert place.elsewhere

            def told(ended: int, failed: int, what: str) -> None:
                if ended == 1:
                    killed.kill()

            outcome = run_batch(jobs("there"), tmp_path / "there", place, told)
    assert [(row.name, row.status) for row in outcome.rows if row.status != "done"] == [("bad", "failed")]
    run_batch(jobs("here"), tmp_path / "here", Place())
    for number in range(4):
        here, there = (tifffile.imread(tmp_path / out / str(number) / "transmission.tiff") for out in ("here", "there"))
        np.testing.assert_array_equal(here, there)


@pytest.mark.parametrize("text", ["", "no json", "[]", '{"address": null}', '{"type": "Scheduler"}'])
def test_another_file_than_a_scheduler_writes_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "scheduler.json").write_text(text)
    with (
        pytest.raises(InputError, match="tells no address of a scheduler"),
        connected(Place(scheduler_file=str(tmp_path / "scheduler.json"))),
    ):
        pass


def test_no_scheduler_and_contradictions_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("polaropt.batch.cluster._CONNECT_SECONDS", 1)
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        run_batch([Job("a", ("a",), str(tmp_path / "a"), Options())], tmp_path, Place(scheduler="tcp://127.0.0.1:9"))
    for wrong in ((None, "tcp://a:1", "file", False), (2, "tcp://a:1", None, False), (None, "tcp://a:1", None, True), (0, None, None, False)):  # fmt: skip # noqa: E501
        with pytest.raises(InputError):
            place_for(*wrong)


@pytest.mark.usefixtures("heard_keys")
def test_an_interruption_while_workers_start_waits_until_they_have_and_does_not_reach_them() -> None:
    reached = []
    with pytest.raises(KeyboardInterrupt), _interruptions_later():  # noqa: PT012 (what follows must be reached)
        signal.raise_signal(signal.SIGINT)
        reached.append(1)
        asks = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
        masked = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True).stdout
    assert (reached, masked.strip()) == ([1], "True")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
