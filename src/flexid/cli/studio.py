"""``flexid studio [LOG]``: a page in which logs are identified and watched."""

import os
from pathlib import Path
from typing import Annotated

import typer

from flexid.errors import RecordingError
from flexid.files import shown


def studio(
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG",
            help="A log that each window opens with, in any format that flexid identify takes.",
            show_default=False,
        ),
    ] = None,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Where to listen. Off the loopback the address that is printed has a token in "
            "it, and only who knows it is let in.",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(metavar="NUMBER", help="Port of the machine; 0 for any that is free.")
    ] = 8765,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")
    ] = True,
) -> None:
    """Serve a page in which logs are checked and identified.

    Drop a log, say which column is what, see what it can tell before anything is run, identify,
    and keep what was found. The page's address holds what was chosen. Ctrl-C ends the studio.
    """
    if log is not None and not os.path.exists(log):
        raise RecordingError(
            shown(log), "", "there is no such file: check the spelling, or give the path of a log"
        )
    from flexid.studio.server import serve

    def announce(address: str) -> None:
        typer.echo(f"flexid studio: {address} (Ctrl-C ends it)")
        if browser:
            import webbrowser

            webbrowser.open(address)

    serve(log, host, port, announce)
