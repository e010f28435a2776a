"""``polaropt study``: start a study as a program of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import typer

import polaropt
from polaropt.cli.command import Interrupted
from polaropt.errors import INTERRUPTED, InputError
from polaropt.interruption import waited_for


def study_command(context: typer.Context) -> None:
    """Reproduce a study: tables and figures of accuracy, speed and stability.

    Without a name the studies are listed. Options behind the name go to the study.
    """
    house = Path(polaropt.__file__).parent.parent
    if not (house / "studies" / "__main__.py").is_file():
        raise InputError("the studies are not installed here; install polaropt with its extra: polaropt[studies]")
    # Neither the folder that the command is called in nor anything in it is looked at: it may hold another solvers.py.
    paths = filter(None, (str(house), os.environ.get("PYTHONPATH")))
    environment = os.environ | {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(paths)}
    if sys.stdout is not None:
        # Its tables hold signs that a terminal may lack.
        environment |= {"PYTHONIOENCODING": f"{sys.stdout.encoding}:backslashreplace"}
    process = subprocess.Popen([sys.executable, "-m", "studies", *context.args], env=environment)
    try:
        code = waited_for(process)
    except KeyboardInterrupt:
        # It has been interrupted, too, and has written what it had.
        code = INTERRUPTED
    if code == INTERRUPTED:
        raise Interrupted("what the study has written stays")
    raise typer.Exit(code)


def add_study_command(app: typer.Typer) -> None:
    """Register the command; what it does not know goes on to the study."""
    settings = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
    epilog = "Example: polaropt study paper_protocol --quick -o out"
    app.command("study", context_settings=settings, add_help_option=False, epilog=epilog)(study_command)
