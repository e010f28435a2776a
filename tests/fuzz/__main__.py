"""``python -m tests.fuzz --minutes N``: damaged files and random command lines on fresh seeds, and what they broke."""

from __future__ import annotations

import argparse
import itertools
import secrets
import sys
from collections import Counter
from pathlib import Path

from tests.attacks import add, begun
from tests.fuzz.attack import attack

KINDS = {"file": "damaged files", "options": "random command lines"}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--kind", choices=KINDS, help="Only these. Default: five damaged files for each command line.")
    parser.add_argument("--seed", type=int, help="First seed. Default: one that nobody has seen.")
    parser.add_argument("--keep", type=Path, help="Folder for the damaged files that broke something.")
    parser.add_argument("-o", "--out", type=Path, help="Folder of results, which get the counts.")
    options = parser.parse_args()
    told = begun({}) if options.out is not None else {}
    first = options.seed if options.seed is not None else secrets.randbelow(10**9) * 1000
    order = itertools.cycle([options.kind] if options.kind else ["file"] * 5 + ["options"])
    cases = ({"kind": kind, "seed": first + i} for i, kind in enumerate(order))
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
    done: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    watched: list[dict[str, object]] = []

    def followed():
        for case in cases:
            if options.keep is not None:
                case["keep"] = str(options.keep / f"{case['seed']}")
            watched.append(case)
            yield case

    # What was done counts, however it ends.
    try:
        for failure in attack(followed(), 60 * options.minutes):
            kind = str(watched[-1]["kind"])
            done[kind] += 1
            if failure is not None:
                failed[kind] += 1
                print(f"{failure.case} {failure.line}\n{failure.wrong.strip()}\n", flush=True)
    finally:
        for kind, words in KINDS.items():
            print(f"{done[kind]} {words} from seed {first}: {failed[kind]} failures", flush=True)
            if options.out is not None and done[kind]:
                row = {"what": words, "seed": first, "tried": done[kind], "failed": failed[kind]}
                add(options.out, "fuzz", told, row)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
