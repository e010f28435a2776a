"""``python -m tests.crash --kills N``: kill commands at random moments and look at what is left.

Nothing that was there before is lost, what is there is whole, and the same command goes on and leaves nothing behind.
In the end one process separates 200 times, and keeps neither memory nor open files.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import imagecodecs
import numpy as np
import tifffile
import torch

from polaropt import StoppingRule, read_capture, separate
from polaropt.capture.files import results
from polaropt.capture.files.limits import complaints
from polaropt.cli import train
from polaropt.cli.app import main
from priors.networks.checkpoint import load_network
from studies.kit import run as study
from tests.attacks import add, begun
from tests.fuzz.commands import FOUR, QUICK
from tests.fuzz.seeds import write_seeds
from tests.fuzz.worker import heard


@dataclass(frozen=True)
class Number:
    """A job of a study that does nothing."""

    number: int


def _row(job: Number) -> list[Number]:
    time.sleep(0.002)
    return [job]


def _study() -> int:
    jobs = [Number(i) for i in range(40)]
    rows = study.run_jobs(_row, jobs, Path("study.json"), {})
    return 0 if [row["number"] for row in rows] == list(range(40)) else 1


def _command(*line: str) -> Callable[[], int]:
    return lambda: main(list(line))


_TRAINING = [
    "train", "-o", "networks", "--leaves-share", "0", "--steps", "4", "--batch", "1", "--size", "32",
]  # fmt: skip
"""Four steps, each of which is kept, of networks that are compared pixel by pixel."""


def _train() -> int:
    """Begun, or gone on with where it has got."""
    return main([*_TRAINING, "--features", "pixels", *["--resume"] * Path("networks/state.pt").is_file()])


_PANE = ["--incidence", "60", "--azimuth", "20", "--shift", "3", "--panes", "1"]

WORKS: dict[str, Callable[[], int]] = {
    "separate": _command("separate", *FOUR, *_PANE, "-o", "out", *QUICK),
    "simulate": _command("simulate", "color_000.png", "color_090.png", "-o", "pair"),
    "batch": _command("batch", "glass.tiff", "mosaic.png", "-o", "many", "--workers", "1", *QUICK),
    "study": _study,
    "train": _train,
}


def in_process(work: Callable[[], int], seconds: float | None = None) -> int:
    """Exit code of work in a process of its own, which is killed after some time; -9 where it was."""
    child = os.fork()
    if child == 0:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        os._exit(work())
    if seconds is not None:
        time.sleep(seconds)
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


UNFINISHED = (".part", ".partial")
"""Endings of files that take the place of others when they are whole."""


def whole(folder: Path, given: Collection[str] = ()) -> set[str]:
    """Files of a folder, beside those that were given, that are no killed run's own, each of which can be read."""
    found = set()
    for path in folder.rglob("*"):
        name = str(path.relative_to(folder))
        if path.is_file() and name not in given and ".polaropt-" not in name and path.suffix not in UNFINISHED:
            found.add(name)
            if path.suffix == ".tiff":
                tifffile.imread(path)
            elif path.suffix == ".png":
                with complaints():
                    imagecodecs.png_decode(path.read_bytes())
            elif path.suffix == ".json":
                json.loads(path.read_text(encoding="utf-8"))
            elif path.suffix == ".safetensors":
                load_network(path)
            elif path.suffix == ".pt":
                torch.load(path, weights_only=True)
            elif path.suffix == ".csv":
                assert path.read_bytes().endswith(b"\n")
    return found


def belongs_together() -> None:
    """Weights and the record of them, and all steps of the log."""
    if Path("networks").is_dir():
        record = json.loads(Path("networks/record.json").read_text(encoding="utf-8"))
        load_network(Path("networks/weights.safetensors"), record["sha256"])
        assert Path("networks/log.csv").read_text(encoding="utf-8").count("\n") == 1 + record["steps"]


def crash(name: str, kills: int, seed: int) -> Counter[str]:
    """Kill a command at so many random moments, in an empty folder and in one with earlier results; how it ended.

    Where it was done before it was killed that does not count.

    Raises
    ------
    AssertionError
        Something was lost, is not whole, or was left.
    """
    random, work, ended = np.random.default_rng(seed), WORKS[name], Counter[str]()
    results._SETTLED_SECONDS = -1.0  # the next run comes at once
    study.WRITE_SECONDS = 0.0
    train._TEST_EVERY = train._TEST_SAMPLES = 1
    before = os.getcwd()
    with tempfile.TemporaryDirectory(prefix="polaropt-crash-") as place:
        os.chdir(place)
        try:
            write_seeds(Path())
            given = set(os.listdir())
            begun = time.monotonic()
            assert in_process(work) == 0
            lasts, complete = time.monotonic() - begun, whole(Path(), given)
            while ended["killed"] < kills:
                there = whole(Path(), given)
                ended["killed" if in_process(work, random.uniform(0, lasts)) == -signal.SIGKILL else "ended"] += 1
                assert there <= whole(Path(), given)
                if random.random() < 0.5:
                    assert in_process(work) == 0
                    assert whole(Path(), given) == complete
                    assert not [
                        path for path in Path().rglob("*") if ".polaropt-" in path.name or path.suffix in UNFINISHED
                    ]
                    belongs_together()
                if random.random() < 0.5:
                    for folder in ("out", "pair", "many", "networks"):
                        shutil.rmtree(folder, ignore_errors=True)
                    Path("study.json").unlink(missing_ok=True)
        finally:
            os.chdir(before)
    return ended


def keeps_nothing(times: int) -> int:
    """Separate so many times in this process; by how many kB its memory grew after the first tenth.

    Raises
    ------
    AssertionError
        Files stayed open, or memory grew by more than 4 MB.
    """

    def solve(n: int) -> tuple[int, int]:
        for _ in range(n):
            separate(read_capture("glass.tiff"), stopping=StoppingRule(max_evaluations=4))
        return len(os.listdir("/proc/self/fd")), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before, after = solve(times // 10), solve(times - times // 10)
    assert after[0] == before[0], f"{after[0] - before[0]} files stayed open"
    assert after[1] - before[1] < 4096, f"memory grew by {after[1] - before[1]} kB"
    return after[1] - before[1]


def command_line(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.crash", description=__doc__)
    parser.add_argument("--kills", type=int, default=30, help="Of each command.")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--only", choices=[*WORKS, "many"], help="One of them.")
    parser.add_argument("-o", "--out", type=Path, help="Folder of results, which get the counts.")
    options = parser.parse_args(arguments)
    out = None if options.out is None else options.out.absolute()
    told = begun({}) if out is not None else {}
    with tempfile.TemporaryDirectory() as place, heard(Path(place)):
        here = os.getcwd()
        os.chdir(place)
        write_seeds(Path())
        if options.only != "many":
            for name, work in WORKS.items():  # compiles, and loads what is loaded late
                if options.only in (None, name):
                    assert work() == 0, name
        os.chdir(here)
    for name in [name for name in WORKS if options.only in (None, name)]:
        ended = crash(name, options.kills, options.seed)
        print(f"{name}: {ended['killed']} times killed, {ended['ended']} times too late; nothing lost", flush=True)
        if out is not None:
            row = {"what": name, "seed": options.seed, "killed": ended["killed"], "too late": ended["ended"], "lost": 0}
            add(out, "crash", told, row)
    if options.only in (None, "many"):
        with tempfile.TemporaryDirectory() as place:
            os.chdir(place)
            write_seeds(Path())
            grown = keeps_nothing(200)
            os.chdir(here)
        print(f"200 separations in one process: no files kept, {grown} kB more memory", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(command_line())
