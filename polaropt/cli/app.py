"""The command line: ``polaropt demo | simulate | inspect | estimate | separate | batch | calibrate | ...``."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, TextIO

import typer

import polaropt
from polaropt.cli.calibrate import calibrate_command
from polaropt.cli.command import (
    Interrupted,
    PlainGroup,
    add_command,
    called_now,
    say,
    speaking_any_encoding,
)
from polaropt.cli.demo import demo_command
from polaropt.cli.inspect import estimate_command, inspect_command
from polaropt.cli.many.batch import batch_command
from polaropt.cli.many.sequence import sequence_command
from polaropt.cli.page import app_command
from polaropt.cli.separate import separate_command
from polaropt.cli.simulate import simulate_command
from polaropt.cli.study import add_study_command
from polaropt.cli.train import train_command
from polaropt.errors import INTERRUPTED, NO_ROOM, InputError, in_one_line
from polaropt.interruption import terminations

WRONG_INPUT = 2

app = typer.Typer(
    cls=PlainGroup,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Start with: polaropt demo",
)
_FOUR = "glass_000.png glass_045.png glass_090.png glass_135.png"
add_command(app, demo_command, "polaropt demo -o demo-output")
add_command(app, simulate_command, "polaropt simulate behind.png mirrored.png --incidence 55 --gamma srgb -o pair")
add_command(app, inspect_command, f"polaropt inspect {_FOUR} -o look.png")
add_command(app, estimate_command, f"polaropt estimate {_FOUR}")
add_command(app, separate_command, f"polaropt separate {_FOUR} -o out")
add_command(app, batch_command, "polaropt batch shots -o out --write layers")
add_command(app, sequence_command, "polaropt sequence film.tiff -o out --resolution cell --video")
add_command(app, app_command, "polaropt app")
add_command(app, calibrate_command, "polaropt calibrate flat_*.png -o analyzer.json")
add_command(app, train_command, "polaropt train --quick -o training")
add_study_command(app)


def _show_version(wanted: bool) -> None:
    if wanted:
        say(f"polaropt {polaropt.__version__}")
        raise typer.Exit


@app.callback()
def polaropt_command(
    version: Annotated[
        bool, typer.Option("--version", metavar="", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Separate what is behind glass from what it mirrors, in photographs taken through a polarizer."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        0 on success; 1 for a result that is warned of, where ``--strict`` asks for it; 2 for wrong options or input,
        told in one line on standard error; 3 where some of many captures or frames failed; 130 for Ctrl-C, 143 where
        the system asked to end. Anything unexpected is raised.
    """
    with called_now(), speaking_any_encoding(), _plugin_warnings_in_a_line(), terminations() as received:
        outcome = _run(arguments)
        if outcome == INTERRUPTED:
            # CPython would end by SIGINT, whatever is returned, where an exec was interrupted (dataclasses are made by
            # some), until another one ends well.
            exec("")
        return 128 + received[-1] if received and outcome == INTERRUPTED else outcome


@contextmanager
def _plugin_warnings_in_a_line() -> Iterator[None]:
    """Say that something of another package cannot be used as errors are said, unless somebody looks at warnings."""
    shown = warnings.showwarning

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        # Its module is not needed otherwise.
        if category.__name__ == "PluginWarning":
            typer.echo(f"polaropt: {in_one_line(str(message))}", err=True)
        else:
            shown(message, category, filename, lineno, file, line)

    if shown is not getattr(warnings, "_showwarning_orig", None):
        yield
        return
    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = shown


def _check_none_empty(arguments: Sequence[str]) -> None:
    """InputError for an empty argument, as of a shell's variable that is not set: as a name it is this very folder."""
    for before, given in zip(("", *arguments), arguments, strict=False):
        option = before if not given and before.startswith("-") else given.removesuffix("=")
        if not given or (given.startswith("--") and given.endswith("=")):
            what = f"{option} is empty" if option else "a name is empty"
            raise InputError(
                f"{what}; give one, or leave it out (a shell gives nothing for a variable that is not set)"
            )


def _run(arguments: Sequence[str] | None) -> int:
    try:
        _check_none_empty(sys.argv[1:] if arguments is None else arguments)
        outcome = app(args=arguments, prog_name="polaropt", standalone_mode=False)
    except InputError as error:
        return _refuse(str(error))
    except typer.TyperException as error:
        return _refuse(_usage_sentence(error))
    except OSError as error:
        # Also of help, which a library writes.
        if error.errno not in NO_ROOM:
            raise
        return _refuse(f"{error.filename or 'standard output'} cannot be written ({error.strerror}); make room")
    except Interrupted as interrupted:
        typer.echo(f"polaropt: interrupted; {interrupted}", err=True)
        return INTERRUPTED
    if outcome == INTERRUPTED:
        typer.echo("polaropt: interrupted; nothing was written", err=True)
    return outcome if isinstance(outcome, int) else 0


def _refuse(sentence: str) -> int:
    typer.echo(f"polaropt: {in_one_line(sentence)}", err=True)
    return WRONG_INPUT


def _usage_sentence(error: typer.TyperException) -> str:
    """What is wrong with the options, and where they are explained."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "polaropt"
    said = error.format_message().rstrip(".")
    return f"{said} See {command} --help" if said.endswith("?") else f"{said}; see {command} --help"
