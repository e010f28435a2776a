"""``python -m studies NAME [options] -o OUT``: one study, or ``all`` of them, and an index page of what there is."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.catalogue import STUDIES
from studies.index_page import write_index

ALL = "all"


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
    options, rest = parser.parse_known_args(arguments)
    if options.name is None:
        print(overview())
        return 0
    if options.help:
        rest = ["--help"]
    elif options.out is None:
        parser.error("the following arguments are required: -o/--out")
    chosen = names if options.name == ALL else [options.name]
    codes = [_run(name, rest, options.out) for name in chosen]
    if not options.help:
        print(f"wrote {write_index(options.out)}")
    return max(codes)


def overview() -> str:
    """The studies, line by line."""
    width = max(len(study.name) for study in STUDIES)
    lines = [f"  {study.name:{width}}  {study.question}" for study in STUDIES]
    usage = "polaropt study NAME [--quick|--full] [--photos DIR] -o OUT"
    return "\n".join([usage, "", *lines, f"  {ALL:{width}}  All of them, one after the other."])


def _run(name: str, rest: Sequence[str], out: Path | None) -> int:
    where = [] if out is None else ["-o", str(out / name)]
    print(f"== {name}", flush=True)
    return subprocess.run([sys.executable, "-m", f"studies.{name}", *rest, *where], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
