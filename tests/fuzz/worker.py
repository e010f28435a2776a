"""A process that runs one case after another and judges each: run by `tests.fuzz.attack`, with limits."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import resource
import shutil
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from polaropt.cli.app import main
from tests.fuzz.commands import file_case, option_case
from tests.fuzz.seeds import seeds, write_seeds

MEMORY = 6 * 2**30
"""Bytes of address space beside what is taken before the first case; set by hand."""
_FOLDERS_OF_OURS = ".polaropt-"
_ENDED_WELL, _REFUSED = (0, 1, 3), 2


@contextlib.contextmanager
def heard(folder: Path) -> Iterator[list[str]]:
    """What is written on standard output and error inside, by whomever."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept, texts = [os.dup(1), os.dup(2)], []
    files = [(folder / name).open("w+b") for name in ("stdout", "stderr")]
    for number, file in zip((1, 2), files, strict=True):
        os.dup2(file.fileno(), number)
    try:
        yield texts
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for number, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, number)
            os.close(copy)
        for file in files:
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
            file.close()


def judged(line: list[str], folder: Path, listening: Path) -> str:
    """What is wrong with how a command line ended; empty for nothing."""
    code, trace = -1, ""
    there = set(os.listdir(folder))
    with heard(listening) as texts:
        try:
            code = main(line)
        except BaseException:  # whatever it is, it is what is looked for
            trace = traceback.format_exc()
    out, err = texts
    left = [str(path) for path in folder.rglob(f"{_FOLDERS_OF_OURS}*")]
    if trace:
        return trace
    if left:
        return f"left {left}"
    if code == _REFUSED:
        if err.count("\n") != 1 or not err.startswith("polaropt: ") or not err[:-1].isprintable():
            return f"refused with {err!r}"
        if out:
            return f"refused, and said {out!r}"
        new = set(os.listdir(folder)) - there
        return f"refused, and wrote {new}" if new and line[0] != "batch" else ""
    if code not in _ENDED_WELL:
        return f"ended with {code}"
    unusual = [text for text in err.splitlines() if not text.startswith(("polaropt: ", "Compiling"))]
    return f"said {unusual!r}" if unusual else ""


def work() -> None:
    """Cases from standard input, a line of JSON each; what is wrong with them to standard output."""
    faulthandler.enable()
    warnings.simplefilter("always")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    whole = Path(tempfile.mkdtemp(prefix="polaropt-fuzz-"))
    try:
        write_seeds(whole)
        listening = whole / "heard"
        listening.mkdir()
        known = seeds()
        _limit()
        answers.write("ready\n")
        answers.flush()
        for request in sys.stdin:
            case = json.loads(request)
            folder = whole / "case"
            folder.mkdir()
            for file in whole.iterdir():
                if file.is_file():
                    (folder / file.name).symlink_to(file)
            os.chdir(folder)
            if "line" in case:
                line = case["line"]
            else:
                random = np.random.default_rng([case["seed"], case["kind"] == "file"])
                line = file_case(known, random, folder) if case["kind"] == "file" else option_case(random)
            wrong = judged(line, folder, listening)
            os.chdir(whole)
            if wrong and case["kind"] == "file" and "keep" in case:
                for file in folder.glob("damaged*"):
                    shutil.copy(file, case["keep"])
            shutil.rmtree(folder)
            answers.write(json.dumps({"line": line, "wrong": wrong}) + "\n")
            answers.flush()
    finally:
        shutil.rmtree(whole, ignore_errors=True)


def _limit() -> None:
    with open("/proc/self/statm", encoding="ascii") as file:
        taken = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY, resource.RLIM_INFINITY))


if __name__ == "__main__":
    work()
