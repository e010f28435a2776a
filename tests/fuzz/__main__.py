"""``python -m tests.fuzz --minutes N``: damaged files and random command lines on fresh seeds, and what they broke."""

from __future__ import annotations

import argparse
import itertools
import secrets
import sys
from collections import Counter
from pathlib import Path

from tests.fuzz.attack import attack

KINDS = ("file", "options")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--kind", choices=KINDS, help="Only these. Default: five damaged files for each command line.")
    parser.add_argument("--seed", type=int, help="First seed. Default: one that nobody has seen.")
    parser.add_argument("--keep", type=Path, help="Folder for the damaged files that broke something.")
    options = parser.parse_args()
    first = options.seed if options.seed is not None else secrets.randbelow(10**9) * 1000
    order = itertools.cycle([options.kind] if options.kind else ["file"] * 5 + ["options"])
    cases = ({"kind": kind, "seed": first + i} for i, kind in enumerate(order))
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
    done: Counter[str] = Counter()
    failed = 0
    watched: list[dict[str, object]] = []

    def followed():
        for case in cases:
            if options.keep is not None:
                case["keep"] = str(options.keep / f"{case['seed']}")
            watched.append(case)
            yield case

    for failure in attack(followed(), 60 * options.minutes):
        done[str(watched[-1]["kind"])] += 1
        if failure is not None:
            failed += 1
            print(f"{failure.case} {failure.line}\n{failure.wrong.strip()}\n", flush=True)
    print(f"{done['file']} damaged files, {done['options']} random command lines from seed {first}: {failed} failures")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
