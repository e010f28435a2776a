"""``polaropt study``: start a study as a program of its own."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import typer

from polaropt.cli.command import INTERRUPTED, Interrupted
from polaropt.errors import InputError


def study_command(context: typer.Context) -> None:
    """Reproduce a study: tables and figures of accuracy, speed and stability.

    Without a name the studies are listed. Options behind the name go to the study.
    """
    if importlib.util.find_spec("studies") is None:
        raise InputError("the studies are not installed here; install polaropt with its extra: polaropt[studies]")
    process = subprocess.Popen([sys.executable, "-m", "studies", *context.args])
    try:
        code = process.wait()
    except KeyboardInterrupt:
        # It has been interrupted, too, and writes what it has.
        process.wait()
        code = INTERRUPTED
    if code == INTERRUPTED:
        raise Interrupted("what the study has written stays")
    raise typer.Exit(code)


def add_study_command(app: typer.Typer) -> None:
    """Register the command; what it does not know goes on to the study."""
    settings = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
    epilog = "Example: polaropt study paper_protocol --quick -o out"
    app.command("study", context_settings=settings, add_help_option=False, epilog=epilog)(study_command)
