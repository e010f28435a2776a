"""Programs in processes that have compiled nothing of ours yet: copies of one in which numba is ready."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
# Imports what compiles, and then forks a process for each program that it is given.
_FORKS = """
import importlib, json, os, sys, tempfile, traceback
import numba, solvers.kernels
from numba.core import config

# Files change within a second here, which Python's cache of bytecode does not notice.
sys.dont_write_bytecode = True
# What numba and its compiler set up once in a process, before anything is compiled that counts.
numba.njit(lambda x: 2 * x)(3)
for name in sys.argv[1:]:
    importlib.import_module(name)
for line in sys.stdin:
    program, environment = json.loads(line)
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        if os.fork() == 0:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            os.environ.update(environment)
            config.reload_config()
            status = 0
            try:
                exec(program, {"__name__": "__main__"})
            except BaseException:
                traceback.print_exc()
                status = 1
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
        _, status = os.wait()
        said = []
        for file in (out, err):
            file.seek(0)
            said.append(file.read())
    print(json.dumps([os.waitstatus_to_exitcode(status), *said]), flush=True)
"""


class Ran(NamedTuple):
    """Exit code of a program, and what it printed."""

    code: int
    out: str
    err: str


class Forks:
    """A process that is copied for every program."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def run(self, program: str, environment: Mapping[str, str] | None = None) -> Ran:
        """Run a program in a copy, with variables of the environment added to what it has."""
        asked, answers = self._process.stdin, self._process.stdout
        assert asked is not None
        assert answers is not None
        asked.write(json.dumps([program, dict(environment or {})]) + "\n")
        asked.flush()
        return Ran(*json.loads(answers.readline()))


@contextmanager
def forks(environment: Mapping[str, str], *ready: str, folder: Path = ROOT) -> Iterator[Forks]:
    """A process in a folder that is copied for every program, with modules that are ready; ended with the block."""
    with subprocess.Popen(
        [sys.executable, "-c", _FORKS, *ready],
        cwd=folder,
        env=dict(environment),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield Forks(process)
        assert process.stdin is not None
        process.stdin.close()
