"""``polaropt`` and ``python -m polaropt``: the command line, before anything that takes its time is loaded."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from polaropt.errors import INTERRUPTED


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, see `polaropt.cli.app.main`; Ctrl-C while it is loaded is told as later on."""
    try:
        from polaropt.cli import main as run
    except KeyboardInterrupt:
        print("polaropt: interrupted; nothing was written", file=sys.stderr)
        # As in `polaropt.cli.app.main`: loading executes code for dataclasses.
        exec("")
        return INTERRUPTED
    return run(arguments)


if __name__ == "__main__":
    sys.exit(main())
