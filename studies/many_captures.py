"""What many captures cost beside bare separations, and what they ask of a cluster's scheduler and of folders.

Run ``polaropt study many_captures -o OUT``; without ``--photos`` it uses photographs inside scikit-image. Captures of
256x256 pixels (``--size``) in colour, some of them broken (``--broken-every``), under many names.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame
from tifffile import imread

from polaropt.batch import Job as Capture
from polaropt.batch import Options, Place, place_for, run_batch
from polaropt.capture import read_capture, write_capture
from polaropt.optics import SceneParameters
from polaropt.separation import separate
from polaropt.simulation import simulate
from studies.kit.frames import markdown, summary
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import n_pairs_of, pairs_of

NAME = "many_captures"
SIZE, MARGIN = 256, 0
NUMBERS = {"quick": (4, 8), "default": (100, 300), "full": (100, 1000)}
BROKEN_EVERY = 10
"""One capture of so many is broken."""
WAYS = ("bare", "layers only", "all files", "cluster", "killed")
KILLS = 10
"""Processes that are killed while they work, one after another at random times."""
CLUSTER = (100_000, 200)
"""Captures and workers that are told of, beyond what is measured."""
_WORKERS = 2
_ASK_SECONDS = 0.5
_START_SECONDS = 120
# Seconds between two kills at least and at most, and the age of a process that is at its work: set by hand.
_BETWEEN_KILLS, _AT_WORK = (3.0, 9.0), 20.0


@dataclass(frozen=True)
class Job:
    """One way to separate so many captures."""

    photos: str | None
    way: str
    number: int
    size: int
    broken_every: int


@dataclass(frozen=True)
class Row:
    """What one way took.

    Attributes
    ----------
    way : str
    number : int
        Captures.
    failed : int
        Of them; all that are broken, and no other.
    seconds : float
        Of the whole, the start of processes included.
    cpu_seconds : float
        The same of all cores and processes together: what other work on the machine changes little.
    memory_early, memory_late : float
        Most bytes of this process and its children together, in the first and in the second half.
    through_scheduler : float
        Bytes to and from the scheduler of a cluster.
    tasks : float
        Most that it held at a time.
    files : float
        That were written.
    entries : float
        Most in one folder.
    kills : float
        Processes that were killed at their work.
    differing : float
        Captures whose layers are not, to the last bit, those of the others of the same content.
    """

    way: str
    number: int
    failed: int
    seconds: float
    cpu_seconds: float
    memory_early: float
    memory_late: float
    through_scheduler: float
    tasks: float
    files: float
    entries: float
    kills: float
    differing: float


def run(job: Job) -> list[Row]:
    """Separate all captures one way, in a folder that goes afterwards."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources = _captures(job, folder / "in")
        with _memory() as memory, _cpu_seconds() as cpu:
            began = time.perf_counter()
            if job.way == "bare":
                reading = _bare(sources)
                bare = (time.perf_counter() - began - reading[0], cpu() - reading[1])
                return [Row(job.way, job.number, 0, *bare, *memory(), *[np.nan] * 6)]
            options = Options(layers_only=job.way != "all files")
            out = folder / "out"
            jobs = [Capture(path.stem, (str(path),), str(out / path.stem), options) for path in sources]
            through = tasks = kills = np.nan
            if job.way == "cluster":
                with _cluster(folder) as (address, told):
                    outcome = run_batch(jobs, out, Place(scheduler=address))
                    seconds = time.perf_counter() - began
                    through, tasks = told()
            elif job.way == "killed":
                with _killing(KILLS) as (begin, killed):
                    outcome = run_batch(jobs, out, place_for(_WORKERS, None, None, False), begin)
                seconds, kills = time.perf_counter() - began, float(killed())
            else:
                outcome = run_batch(jobs, out, place_for(None, None, None, False))
                seconds = time.perf_counter() - began
            files, entries = _sizes(out)
            broken = sum(path.stat().st_size == 0 for path in sources)
            assert len(outcome.rows) == job.number
            assert len(outcome.failed) == broken, [row.message for row in outcome.failed]
            took, used = (seconds, cpu()), memory()
            told_of = (through, tasks, files, entries, kills, differing_layers(sources, out))
            return [Row(job.way, job.number, len(outcome.failed), *took, *used, *told_of)]


def _captures(job: Job, folder: Path) -> list[Path]:
    """Captures of all pairs under many names; files of one content are one file."""
    folder.mkdir()
    pairs = pairs_of(job.photos, job.size, MARGIN)
    random = np.random.default_rng(0)
    for i, pair in enumerate(pairs):
        pane = SceneParameters(float(random.uniform(45, 72)), float(random.uniform(0, 180)), 4.0)
        write_capture(simulate(pair.transmission, pair.reflection, pane, seed=i), folder / f"pair{i}.npz")
    paths = []
    for i in range(job.number):
        paths.append(folder / f"capture{i:06d}.npz")
        if i % job.broken_every == job.broken_every - 1:
            paths[-1].touch()
        else:
            os.link(folder / f"pair{i % len(pairs)}.npz", paths[-1])
    return paths


def _bare(sources: list[Path]) -> tuple[float, float]:
    """Separate captures one after another in this process; seconds and processor seconds of reading them."""
    reading = [0.0, 0.0]
    for path in sources:
        if path.stat().st_size:
            start = time.perf_counter(), time.process_time()
            capture = read_capture(path)
            reading[0] += time.perf_counter() - start[0]
            reading[1] += time.process_time() - start[1]
            separate(capture)
    return reading[0], reading[1]


def differing_layers(sources: list[Path], out: Path) -> float:
    """Captures whose layers differ from those of the first one of the same content."""
    seen: dict[int, bytes] = {}
    differing = 0
    for path in sources:
        if path.stat().st_size:
            files = (out / path.stem / f"{name}.tiff" for name in ("transmission", "reflection"))
            digest = hashlib.sha256(b"".join(np.ascontiguousarray(imread(file)).tobytes() for file in files)).digest()
            differing += digest != seen.setdefault(path.stat().st_ino, digest)
    return float(differing)


def _sizes(out: Path) -> tuple[float, float]:
    """Files in all folders, and most entries of one."""
    entries = {folder: len(folders) + len(files) for folder, folders, files in os.walk(out)}
    return float(sum(len(files) for _, _, files in os.walk(out))), float(max(entries.values()))


@contextmanager
def _memory() -> Iterator[Callable[[], tuple[float, float]]]:
    """Tells the most memory in the first and in the second half of the time until it is asked."""
    import psutil

    own, seen, ended = psutil.Process(), [], threading.Event()

    def watch() -> None:
        while not ended.wait(_ASK_SECONDS):
            total = 0
            for process in (own, *own.children(recursive=True)):
                try:
                    total += process.memory_info().rss
                except psutil.NoSuchProcess:
                    continue
            seen.append(total)

    def told() -> tuple[float, float]:
        half = len(seen) // 2
        early, late = (float(max(part, default=np.nan)) for part in (seen[:half], seen[half:]))
        return early, late

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield told
    finally:
        ended.set()
        thread.join()


@contextmanager
def _cpu_seconds() -> Iterator[Callable[[], float]]:
    """Tells the processor seconds of this process and of children that have ended, since it began."""

    def now() -> float:
        both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        return sum(usage.ru_utime + usage.ru_stime for usage in both)

    began = now()
    yield lambda: now() - began


@contextmanager
def _killing(number: int) -> Iterator[tuple[Callable[[int, int], None], Callable[[], int]]]:
    """Kills processes that work for this one, so many, one after another, once a capture has ended.

    Gives what is told how many have ended, and what tells how many processes were killed.
    """
    import psutil

    random, begun, ended, killed = np.random.default_rng(0), threading.Event(), threading.Event(), [0]

    def begin(done: int, failed: int) -> None:
        if done:
            begun.set()

    def kill() -> None:
        begun.wait()
        while killed[0] < number and not ended.wait(random.uniform(*_BETWEEN_KILLS)):
            # The one that tracks resources is no worker, and one that begins is at no capture.
            old = [child for child in psutil.Process().children() if time.time() - child.create_time() > _AT_WORK]
            workers = [child for child in old if "resource_tracker" not in " ".join(child.cmdline())]
            if workers:
                workers[int(random.integers(len(workers)))].send_signal(signal.SIGKILL)
                killed[0] += 1

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    try:
        yield begin, lambda: killed[0]
    finally:
        ended.set()
        begun.set()
        thread.join()


@contextmanager
def _cluster(folder: Path) -> Iterator[tuple[str, Callable[[], tuple[float, float]]]]:
    """Address of a scheduler with workers, all processes of their own, and what went through it.

    Everybody reaches the scheduler through a relay that counts.
    """
    from distributed import Client

    file = folder / "scheduler.json"
    listening = ("scheduler", "--scheduler-file", str(file), "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with _started(*listening):
        end = time.monotonic() + _START_SECONDS
        while not file.is_file():
            assert time.monotonic() < end, "no scheduler"
            time.sleep(0.1)
        with (
            Client(scheduler_file=str(file), set_as_default=False) as watcher,
            Relay(int(watcher.scheduler.address.rpartition(":")[2])) as relay,
        ):
            address = f"tcp://127.0.0.1:{relay.port}"
            worker = ("worker", address, "--nthreads", "1", "--nworkers", str(_WORKERS), "--no-dashboard")
            with _started(*worker):
                watcher.wait_for_workers(_WORKERS, timeout=_START_SECONDS)
                relay.count = 0
                most = _most_tasks(watcher)
                yield address, lambda: (float(relay.count), float(most()))


def _most_tasks(watcher: Any) -> Callable[[], int]:
    """Most tasks that the scheduler held, looked at now and then."""
    seen, ended = [0], threading.Event()

    def look(dask_scheduler: Any = None) -> int:
        return len(dask_scheduler.tasks)

    def watch() -> None:
        while not ended.wait(_ASK_SECONDS):
            seen.append(watcher.run_on_scheduler(look))

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()

    def told() -> int:
        ended.set()
        thread.join()
        return max(seen)

    return told


class Relay:
    """Passes connections on to a port of this machine and counts the bytes of both ways.

    Parameters
    ----------
    port : int

    Attributes
    ----------
    port : int
        Its own.
    count : int
        Bytes that were passed on.
    """

    def __init__(self, port: int) -> None:
        self.count = 0
        self._target = port
        self._loop = asyncio.new_event_loop()
        self._server = self._loop.run_until_complete(asyncio.start_server(self._connected, "127.0.0.1", 0))
        self.port = int(self._server.sockets[0].getsockname()[1])
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def __enter__(self) -> Relay:
        return self

    def __exit__(self, *error: object) -> None:
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        """Let no connection outlive the loop: whoever closes it later would find the loop closed."""
        self._server.close()
        passing = asyncio.all_tasks() - {asyncio.current_task()}
        for task in passing:
            task.cancel()
        await asyncio.gather(*passing, return_exceptions=True)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._target)
        await asyncio.gather(self._passed(reader, back), self._passed(there, writer))

    async def _passed(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while data := await reader.read(1 << 16):
                self.count += len(data)
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            writer.close()


@contextmanager
def _started(*arguments: str) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def tables(frame: DataFrame) -> str:
    """What each way took, and what the growth from the fewer to the more captures says of many more."""
    bare = frame[frame.way == "bare"].set_index("number")

    def against_bare(what: str) -> Callable[[DataFrame], str]:
        def ratio(part: DataFrame) -> str:
            known = bare[what].get(part.number.iloc[0])
            return "" if known is None else f"{part[what].iloc[0] / known:.2f}"

        return ratio

    cells: dict[str, Callable[[DataFrame], str]] = {
        "seconds": lambda part: f"{part.seconds.iloc[0]:.1f}",
        "against bare": against_bare("seconds"),
        "processor seconds": lambda part: f"{part.cpu_seconds.iloc[0]:.1f}",
        "of them against bare": against_bare("cpu_seconds"),
        "failed": lambda part: f"{part.failed.iloc[0]}",
        "GB, first half": lambda part: f"{part.memory_early.iloc[0] / 1e9:.2f}",
        "GB, second half": lambda part: f"{part.memory_late.iloc[0] / 1e9:.2f}",
        "kB through the scheduler per capture": lambda part: _number(
            part.through_scheduler.iloc[0] / part.number / 1e3
        ),
        "tasks at a time": lambda part: _number(part.tasks.iloc[0]),
        "files per capture": lambda part: _number(part.files.iloc[0] / part.number),
        "entries of the fullest folder": lambda part: _number(part.entries.iloc[0]),
        "processes killed": lambda part: _number(part.kills.iloc[0]),
        "layers that differ": lambda part: _number(part.differing.iloc[0]),
    }
    return f"{markdown(summary(frame, {'way': 'way', 'captures': 'number'}, cells))}\n\n{_beyond(frame)}"


def _number(value: Any) -> str:
    number = float(value.iloc[0]) if hasattr(value, "iloc") else float(value)
    return "" if number != number else f"{number:.3g}"


def _beyond(frame: DataFrame) -> str:
    """What the growth says of many more captures."""
    part = frame[frame.way == "cluster"].sort_values("number")
    if len(part) < 2:
        return ""
    few, many = part.iloc[0], part.iloc[-1]
    captures, workers = CLUSTER
    added = many.number - few.number
    each = (many.through_scheduler - few.through_scheduler) / added
    files = (many.files - few.files) / added
    tasks = many.tasks * workers / _WORKERS
    return (
        f"{captures:,} captures on {workers} workers ask for {each * captures / 1e9:.2f} GB through the scheduler "
        f"({each / 1e3:.1f} kB each), {tasks:.0f} tasks at a time, {files * captures:,.0f} files, and "
        f"{captures:,} folders in one where the sources lie in one folder."
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--ways", default=",".join(WAYS), help="names, comma separated")
    parser.add_argument("--numbers", help="captures, comma separated")
    parser.add_argument("--size", type=int, default=SIZE, help="pixels of a side")
    parser.add_argument("--broken-every", type=int, default=BROKEN_EVERY, help="one capture of so many is broken")
    options = parser.parse_args(arguments)
    n_pairs_of(options, 1, options.size, MARGIN)
    numbers = NUMBERS[effort_of(options)]
    if options.numbers:
        numbers = tuple(int(number) for number in options.numbers.split(","))
    jobs = [
        Job(options.photos, way, number, options.size, options.broken_every)
        for number in numbers
        for way in options.ways.split(",")
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), {})


if __name__ == "__main__":
    main()
