"""How a study speaks: its help and its mistakes as the other commands have them, its tables as tables."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NoReturn

_WRONG = 2


class StudyParser(argparse.ArgumentParser):
    """A parser whose help looks like that of the other commands, and whose errors are one line."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(prog=f"polaropt study {name_of_program()}", add_help=False, **settings)
        self.add_argument("-h", "--help", action="help", help="Show this message and exit.")

    def error(self, message: str) -> NoReturn:
        """Say in one line what is wrong, and end."""
        print(f"polaropt: {message.rstrip('.')}; see {self.prog} --help", file=sys.stderr)
        sys.exit(_WRONG)

    def print_help(self, file: IO[str] | None = None) -> None:
        """Usage, what the study does, and its options in a table."""
        from rich.console import Console
        from rich.padding import Padding
        from rich.panel import Panel
        from rich.table import Table
        from rich.text import Text

        table = Table.grid(padding=(0, 2))
        for names, value, words in self._rows():
            table.add_row(Text(names, style="bold cyan"), Text(value, style="bold yellow"), words)
        console = Console(file=file or sys.stdout, highlight=False)
        console.print(Padding(f"[bold]Usage:[/] {self.prog} [dim]\\[OPTIONS][/]", (1, 1)))
        console.print(Padding(Text(self.description or ""), (0, 1, 1, 1)))
        console.print(Panel(table, title="Options", title_align="left", border_style="dim"))

    def _rows(self) -> Iterator[tuple[str, str, str]]:
        """Names, value and meaning of every option."""
        for action in self._actions:
            if action.help == argparse.SUPPRESS:
                continue
            required = " [required]" if action.required else ""
            known = None if action.choices is None else ",".join(map(str, action.choices))
            value = "" if action.nargs == 0 else str(action.metavar or known or action.dest.upper())
            words = action.help or ""
            if action.default not in (None, False, argparse.SUPPRESS, "") and "efault" not in words:
                words = f"{words} Default: {action.default}."
            yield ", ".join(action.option_strings) or action.dest, value, words + required


def name_of_program() -> str:
    """The study that runs as this program, by its module's name."""
    path = Path(sys.argv[0])
    return path.parent.name if path.stem == "__main__" else path.stem


def say_tables(markdown: str) -> None:
    """Print tables: drawn on a terminal, else as Markdown, which other programs read."""
    if not sys.stdout.isatty():
        print(markdown)
        return
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(markdown))
