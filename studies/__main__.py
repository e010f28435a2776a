"""``python -m studies NAME [options] -o OUT``: one study, or ``all`` of them, and an index page of what there is.

All of them work on one process per core, but for a quick look and for those that are about seconds; started again after
a break, they go on with what is left.
"""

from __future__ import annotations

import argparse
import difflib
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from polaropt.interruption import terminations, waited_for
from studies.catalogue import STUDIES, Study
from studies.kit.page import write_index

ALL = "all"
_INTERRUPTED, _WRONG, _UNREAD = 130, 2, 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a study as a program of its own, each in its folder below OUT; the largest of their exit codes."""
    # Its help is `overview`; all other options go to the study.
    parser = argparse.ArgumentParser(prog="polaropt study", add_help=False)
    parser.add_argument("name", nargs="?")
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("-o", "--out")
    parser.add_argument("--workers")
    for name in dict.fromkeys(name for study in STUDIES for name in study.inputs):
        parser.add_argument(name)
    options, rest = parser.parse_known_args(arguments)
    if options.name is None:
        print(overview())
        return 0
    names = [*(study.name for study in STUDIES), ALL]
    if options.name not in names:
        return _refuse(_no_such(options.name, names))
    chosen = [study for study in STUDIES if options.name in (ALL, study.name)]
    lacking = _lacking(chosen)
    if lacking and options.help:
        print(
            "\n".join(
                [*(f"{study.name}: {study.question}" for study in chosen), f"To run, or to tell its options, {lacking}"]
            )
        )
        return 0
    if lacking:
        return _refuse(lacking)
    if options.help:
        return max(_run(study.name, ["--help"], None) for study in chosen)
    if not options.out:
        return _refuse("the study's results need a folder; give its name: -o OUT")
    out = Path(options.out)
    if out.exists() and not out.is_dir():
        return _refuse(f"--out is {options.out!r}, which is a file; give a folder")
    alone = len(chosen) == 1
    plans = {
        study.name: [*rest, *inputs_of(study, options, alone), *workers_of(study, options, rest, alone)]
        for study in chosen
    }
    try:
        return _run_each(plans, out)
    except KeyboardInterrupt:
        # The study has said what there is to say.
        return _INTERRUPTED


def _refuse(sentence: str) -> int:
    print(f"polaropt: {sentence}", file=sys.stderr)
    return _WRONG


def _no_such(name: str, names: Sequence[str]) -> str:
    """That there is no such study, and which of them may be meant."""
    near = difflib.get_close_matches(name, names)
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    return f"there is no study {name!r}; {meant}polaropt study lists all of them"


def _lacking(chosen: Sequence[Study]) -> str:
    """What must be installed before these studies can run, in a line; empty where nothing must."""
    missing: dict[str, list[str]] = {}
    for study in chosen:
        missing |= study.missing()
    if not missing:
        return ""
    names = ", ".join(name for packages in missing.values() for name in packages)
    who = f"the study {chosen[0].name} needs" if len(chosen) == 1 else "these studies need"
    install = f"pip install 'polaropt[{','.join(missing)}]'"
    return f"{who} packages that are not installed ({names}); install them with: {install}"


def _run_each(plans: Mapping[str, Sequence[str]], out: Path) -> int:
    """Run studies by name, each with its options; the index page shows those that are over, whatever comes after."""
    failed = {}
    for number, (name, given) in enumerate(plans.items(), 1):
        print(f"== {name}" + (f" ({number} of {len(plans)})" if len(plans) > 1 else ""), flush=True)
        if code := _run(name, given, out):
            failed[name] = code
        page = write_index(out)
    print(f"wrote {page}" + (f"; failed: {', '.join(failed)}" if failed else ""))
    # A study that a signal has ended has a negative code.
    return max(map(abs, failed.values()), default=0)


def inputs_of(study: Study, options: argparse.Namespace, alone: bool) -> list[str]:
    """What a study is told to work on; alone it is given all, and refuses what it does not know."""
    names = dict.fromkeys(name for each in STUDIES for name in each.inputs if alone or each is study)
    values = {name: getattr(options, name.lstrip("-")) for name in names}
    return [part for name, value in values.items() if value is not None for part in (name, value)]


def workers_of(study: Study, options: argparse.Namespace, rest: Sequence[str], alone: bool) -> list[str]:
    """A study's option for processes: as asked for, and among all of them one per core but where seconds are told."""
    asked: str | None = options.workers
    if not alone:
        asked = None if study.timed or "--quick" in rest else asked or "0"
    return [] if asked is None else ["--workers", asked]


def overview() -> str:
    """The studies with their questions, line by line."""
    width = max(len(study.name) for study in STUDIES)
    lines = [f"  {study.name:{width}}  {study.question}" for study in STUDIES]
    usage = "polaropt study NAME [--quick|--full] [--photos DIR] -o OUT"
    last = "polaropt study NAME --help tells all options of a study."
    return "\n".join([usage, "", *lines, f"  {ALL:{width}}  All of them, one after the other.", "", last])


def _run(name: str, rest: Sequence[str], out: Path | None) -> int:
    where = [] if out is None else ["-o", str(out / name)]
    process = subprocess.Popen([sys.executable, "-m", f"studies.{name}", *rest, *where])
    # What interrupts this one interrupts it, too, and it writes what it has.
    return waited_for(process)


def _listened() -> int:
    """The studies as a program; whoever closes the pipe early, such as head, has read enough."""
    try:
        with terminations():
            code = main()
        sys.stdout.flush()
    except BrokenPipeError:
        # Nothing is left to be flushed when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _UNREAD
    return code


if __name__ == "__main__":
    sys.exit(_listened())
