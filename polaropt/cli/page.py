"""``polaropt app``: a page in the browser on which photographs are dropped and separated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from polaropt.cli.command import say

# Bytes of a megabyte, and megabytes of one capture's files: four camera raw files, or a long stack. Set by hand.
_MB, _LIMIT_MB = 1_000_000, 2000


@dataclass(frozen=True)
class PageOptions:
    """Where the page is, and what it takes."""

    port: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            max=65535,
            help="Port of this computer's own address (127.0.0.1) that the page is at. 0: one that is free.",
        ),
    ] = 0
    limit_mb: Annotated[
        int, typer.Option("--limit-mb", metavar="MB", min=1, help="Size of the files of one capture at most.")
    ] = _LIMIT_MB
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", metavar="", help="Open the page in the browser.")
    ] = True


def app_command(options: PageOptions) -> None:
    """Separate photographs on a page in the browser.

    Drop the photographs of a capture on it, see what they are, separate them, move the slider between the layers and
    download the results. One capture at a time. The page is on this computer alone: other computers cannot reach it,
    and its address holds a key that other people of this computer do not know. Nothing is sent to or loaded from
    elsewhere. What was dropped and what came of it is removed when other photographs are dropped, and when the program
    ends (Ctrl-C). Needs pip install 'polaropt[app]'.
    """
    from polaropt.web import serve

    def ready(address: str) -> None:
        say(f"The page is at {address}", "End it with Ctrl-C: what was dropped on it is removed then.")
        if options.browser:
            import webbrowser

            webbrowser.open(address)

    serve(options.port, options.limit_mb * _MB, ready)
