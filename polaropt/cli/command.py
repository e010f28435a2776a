"""Commands whose options come in groups, and how they speak: sentences, JSON, a progress bar."""

from __future__ import annotations

import codecs
import dataclasses
import inspect
import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar, get_args, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from polaropt.errors import InputError
from polaropt.progress import Progress, Stages, clocks

Action = Callable[..., None]

SOME_FAILED = 3
"""Exit code where captures, or frames, failed and the others are done."""

DOUBTFUL = 1
"""Exit code of a result that is warned of, where that is asked for."""
_SPEED_SECONDS = 3600.0
"""Of what was done in so long a time the time left is told: captures may take minutes each. Set by hand."""
STARTING = "Starting"
"""The stage before the first file is read, and wherever else libraries are loaded."""
Group = TypeVar("Group")
_YES, _NO = frozenset({"yes", "true", "1"}), frozenset({"no", "false", "0"})


class Interrupted(Exception):
    """Ctrl-C in a command that writes as it goes; the text says what of it stays."""


def _in_plain_words(parameters: list[Any]) -> list[Any]:
    """Parameters as the help shows them: without Python's types of those whose names say what to give, or of flags."""
    for parameter in parameters:
        if parameter.param_type_name == "argument":
            parameter.display_type = lambda ctx: None
        elif parameter.is_flag and parameter.metavar is None:
            parameter.metavar = ""
    return parameters


class PlainCommand(TyperCommand):
    """A command whose help needs no Python to be read."""

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters, typer's own among them."""
        return _in_plain_words(super().get_params(ctx))


class PlainGroup(TyperGroup):
    """The same of several commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters, typer's own among them."""
        return _in_plain_words(super().get_params(ctx))


def add_command(app: typer.Typer, action: Action, example: str) -> None:
    """Register a function of options dataclasses as a command with one flat list of options.

    Parameters
    ----------
    app : Typer
    action : callable
        Every parameter is a dataclass whose fields are annotated with `typer.Option` or `typer.Argument`. Its
        docstring is the command's help.
    example : str
        Command lines, shown below the options.
    """
    hints = get_type_hints(action)
    groups = {name: hints[name] for name in inspect.signature(action).parameters}

    def run(**values: Any) -> None:
        chosen = {name: group(**{key: values[key] for key in _names(group)}) for name, group in groups.items()}
        action(**chosen)

    parameters = [parameter for group in groups.values() for parameter in _parameters(group)]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__doc__ = _joined(inspect.getdoc(action) or "")
    app.command(action.__name__.removesuffix("_command"), cls=PlainCommand, epilog=f"Example: {example}")(run)


def _joined(text: str) -> str:
    """One line per paragraph, so that the help is wrapped once; brackets are text, not styles."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n")).replace("[", r"\[")


def _names(group: type) -> list[str]:
    return [field.name for field in dataclasses.fields(group)]


def _parameters(group: type) -> Iterator[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    for field in dataclasses.fields(group):
        default = inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default
        yield inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hints[field.name]
        )


def with_texts(group: Group, texts: Mapping[str, str]) -> Group:
    """An options dataclass of which some fields are set by what a person wrote.

    Raises
    ------
    InputError
        A text is not what the option takes.
    """
    hints = get_type_hints(type(group))
    values = {name: _value(name, text, hints[name]) for name, text in texts.items() if name in hints}
    return dataclasses.replace(group, **values)  # type: ignore[type-var]


def _value(name: str, text: str, hint: Any) -> Any:
    """A text as an option of some type takes it."""
    kinds = [kind for kind in (get_args(hint) or (hint,)) if kind is not type(None)]
    if bool in kinds:
        if text.lower() not in _YES | _NO:
            raise InputError(f"{name} is {text!r}; give yes or no")
        return text.lower() in _YES
    if not all(isinstance(kind, type) for kind in kinds):  # of a Literal the words
        if text not in kinds:
            raise InputError(f"{name} is {text!r}; choose one of: {', '.join(map(str, kinds))}")
        return text
    try:
        return kinds[0](text)
    except ValueError:
        raise InputError(f"{name} is {text!r}; give a {'whole number' if kinds[0] is int else 'number'}") from None


# Signs that a terminal may lack, and what is as wide or means the same.
_LIKE_SIGNS = {"…": ".", "±": "+-"}
_SPELLED = "polaropt.spelled"


def _spelled(error: UnicodeError) -> tuple[str, int]:
    """What stands for characters that a stream cannot take, such as those of a file's name: as Python spells them."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    alike = (_LIKE_SIGNS.get(sign, sign).encode("ascii", "backslashreplace").decode() for sign in lacking)
    return "".join(alike), error.end


codecs.register_error(_SPELLED, _spelled)


@contextmanager
def speaking_any_encoding() -> Iterator[None]:
    """Within this context standard output takes every character, as standard error does anyway.

    A terminal or pipe of another encoding than UTF-8 has no ellipsis for the help, and names of files may be bytes in
    none.
    """
    out = sys.stdout
    if not isinstance(out, io.TextIOWrapper):  # closed, or somebody's own
        yield
        return
    errors = out.errors
    out.reconfigure(errors=_SPELLED)
    try:
        yield
    finally:
        out.reconfigure(errors=errors)


def say(*sentences: str) -> None:
    """Sentences for people, one per line.

    Raises
    ------
    InputError
        Standard output takes no more, as on a full disk. Whoever closes a pipe early has read enough.
    """
    try:
        for sentence in sentences:
            typer.echo(sentence)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputError(
            f"standard output cannot be written ({os.strerror(error.errno or 0)}); what the command wrote stays"
        ) from None


def say_warnings(*sentences: str) -> None:
    """What a result is warned of, on standard error, where standard output is for others or for nobody."""
    for sentence in sentences:
        typer.echo(f"polaropt: warning: {sentence}", err=True)


def say_json(document: dict[str, Any]) -> None:
    """One JSON object on standard output."""
    say(json.dumps(document, indent=2, allow_nan=False))


# When the command line was called: options are read, and what they need is loaded, before a command is.
_called: ContextVar[tuple[float, float] | None] = ContextVar("called", default=None)


@contextmanager
def called_now() -> Iterator[None]:
    """Within this context commands count their time from its begin on."""
    before = _called.set(clocks())
    try:
        yield
    finally:
        _called.reset(before)


@contextmanager
def watched(wanted: bool = True) -> Iterator[Stages]:
    """The stages of a command from its call on, shown as a bar where somebody watches."""
    with progress_bar(wanted) as progress:
        stages = Stages(progress, _called.get())
        stages.begin(STARTING, 0.0)
        yield stages


def _on_a_terminal() -> bool:
    """Whether somebody watches; a stream that was closed is None."""
    return all(stream is not None and stream.isatty() for stream in (sys.stdout, sys.stderr))


@contextmanager
def progress_bar(wanted: bool = True) -> Iterator[Progress | None]:
    """Bar on a terminal, taking a stage's sentence and the fraction done overall; None where nobody watches."""
    if not (wanted and _on_a_terminal()):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (
        SpinnerColumn("line" if console.options.ascii_only else "dots"),
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(STARTING, total=1.0)
        yield lambda stage, fraction: bar.update(task, description=stage, completed=fraction)


@contextmanager
def count_bar(total: int, what: str, wanted: bool = True) -> Iterator[Callable[..., None] | None]:
    """Bar on a terminal with the time left, taking how many are done, how many of them failed, and what is done with
    them, where that changes; None elsewhere."""
    if not (wanted and _on_a_terminal()):
        yield None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(stderr=True)
    times = TimeElapsedColumn(), TimeRemainingColumn()
    with Progress(*columns, *times, console=console, transient=True, speed_estimate_period=_SPEED_SECONDS) as bar:
        task, doing = bar.add_task(what, total=total), what

        def told(done: int, failed: int, does: str = what) -> None:
            nonlocal doing
            if does != doing:  # from the first one on, in a time of its own
                doing = does
                bar.reset(task)
            bar.update(task, completed=done, description=f"{does}, {failed} failed" if failed else does)

        yield told
