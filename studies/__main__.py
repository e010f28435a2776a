"""``python -m studies NAME [options] -o OUT``: one study, or ``all`` of them, and an index page of what there is.

All of them work on one process per core, but for a quick look and for those that are about seconds; started again after
a break, they go on with what is left.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.catalogue import STUDIES, Study
from studies.index_page import write_index

ALL = "all"
_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a study as a program of its own, each in its folder below OUT; the largest of their exit codes."""
    names = [study.name for study in STUDIES]
    parser = argparse.ArgumentParser(
        prog="polaropt study",
        description="Run a study: " + " ".join(f"{study.name}: {study.question}" for study in STUDIES),
        epilog="All other options go to the study; polaropt study NAME --help tells them.",
        add_help=False,
    )
    parser.add_argument("name", choices=[*names, ALL], nargs="?")
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("-o", "--out", type=Path, help="folder; each study has one of its own in it")
    parser.add_argument("--workers", help="processes (0: one per core); of all studies those about seconds have one")
    options, rest = parser.parse_known_args(arguments)
    if options.name is None:
        print(overview())
        return 0
    chosen = [study for study in STUDIES if options.name in (ALL, study.name)]
    if options.help:
        return max(_run(study.name, ["--help"], None) for study in chosen)
    if options.out is None:
        parser.error("the following arguments are required: -o/--out")
    try:
        return _run_each(chosen, rest, options.workers, options.out)
    except KeyboardInterrupt:
        # The study has said what there is to say.
        return _INTERRUPTED


def _run_each(chosen: Sequence[Study], rest: Sequence[str], workers: str | None, out: Path) -> int:
    """Run studies one after the other; the index page shows those that are over, whatever comes after them."""
    failed = {}
    for number, study in enumerate(chosen, 1):
        print(f"== {study.name}" + (f" ({number} of {len(chosen)})" if len(chosen) > 1 else ""), flush=True)
        processes = workers_in_all(study, rest, workers) if len(chosen) > 1 else workers
        if code := _run(study.name, rest if processes is None else [*rest, "--workers", processes], out):
            failed[study.name] = code
        page = write_index(out)
    print(f"wrote {page}" + (f"; failed: {', '.join(failed)}" if failed else ""))
    # A study that a signal has ended has a negative code.
    return max(map(abs, failed.values()), default=0)


def workers_in_all(study: Study, rest: Sequence[str], asked: str | None) -> str | None:
    """Processes of a study among all of them, as its option takes them; None: as it has it by itself, which is one."""
    if study.timed or "--quick" in rest:
        return None
    return "0" if asked is None else asked


def overview() -> str:
    """The studies, line by line."""
    width = max(len(study.name) for study in STUDIES)
    lines = [f"  {study.name:{width}}  {study.question}" for study in STUDIES]
    usage = "polaropt study NAME [--quick|--full] [--photos DIR] -o OUT"
    return "\n".join([usage, "", *lines, f"  {ALL:{width}}  All of them, one after the other."])


def _run(name: str, rest: Sequence[str], out: Path | None) -> int:
    where = [] if out is None else ["-o", str(out / name)]
    process = subprocess.Popen([sys.executable, "-m", f"studies.{name}", *rest, *where])
    try:
        return process.wait()
    except KeyboardInterrupt:
        # It has been interrupted, too, and writes what it has.
        process.wait()
        raise


if __name__ == "__main__":
    sys.exit(main())
