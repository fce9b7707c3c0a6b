"""Commands that go on until they are ended: `flexid watch` and `flexid studio`."""

import json
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from flexid.cli.generated import Command, ExitStatus, Options, as_typed, output, print_warnings
from flexid.errors import RecordingError, SettingError
from flexid.files import shown
from flexid.library.arguments import one_thread

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.library.watched import Watch


_DRAWN_EVERY = 0.2  # s


@one_thread()
def watch(command: Command, options: Options, flags: Options) -> None:
    """Follow the source to its end, or to an interruption; then report."""
    from rich.console import Console

    if "source" not in options:
        raise SettingError("SOURCE", "is missing: name a file, - or an address")
    watched: Watch = command.function(**options)
    with output(flags["out"]) as files, _interruptions() as asked:
        failure = None
        try:
            _follow(watched, asked, Console(stderr=True), as_json=flags["json"])
        except Exception as error:  # whatever it is, it must not cost what was learnt before
            failure = error
        if watched.has_begun:
            _report(watched, as_json=flags["json"])
            if files is not None:
                watched._write_files(files, as_typed(), csv=False)
        if failure is not None:
            raise failure
    if asked:
        signal.raise_signal(asked[0])  # as if it came now, when all is reported
    if not watched.has_converged:
        raise click.exceptions.Exit(ExitStatus.LACKING)


@contextmanager
def _interruptions() -> Iterator[list[int]]:
    """Signals that came meanwhile: samples are taken in whole, and the second one is obeyed."""
    asked: list[int] = []
    before: dict[int, Any] = {}

    def noted(number: int, _frame: FrameType | None) -> None:
        asked.append(number)
        signal.signal(number, before[number])

    for number in (signal.SIGINT, signal.SIGTERM):
        before[number] = signal.signal(number, noted)
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _follow(watched: "Watch", asked: list[int], errors: "Console", *, as_json: bool) -> None:
    """Follow the stream until it ends, or an interruption; show what is known meanwhile."""
    from rich.live import Live

    from flexid.report.watch import live_view

    drawn = time.monotonic()
    warned = 0
    terminal = not as_json and errors.is_terminal
    live = Live(console=errors, transient=True, auto_refresh=False)
    with live if terminal else nullcontext():
        for due in watched.turns():
            print_warnings(watched.warnings[warned:], errors)
            warned = len(watched.warnings)
            now = time.monotonic()
            if due and as_json:
                click.echo(json.dumps(watched.document))
            if terminal and now - drawn > _DRAWN_EVERY:
                session = watched.result if watched.has_begun else None
                live.update(live_view(session, errors.width), refresh=True)
                drawn = now
            if asked:
                break


def _report(watched: "Watch", *, as_json: bool) -> None:
    """Print the last report."""
    if as_json:
        click.echo(json.dumps(watched.document))
        return
    from flexid.report.terminal import print_parts

    print_parts(watched._parts())


def studio(log: str | None = None, *, port: int = 8765, browser: bool = True) -> None:
    """Serve a page in which logs are checked and identified.

    Drop a log, say which column is what, see what it can tell before anything is run, identify,
    and keep what was found. The page's address holds what was chosen. Ctrl-C ends the studio.

    Parameters
    ----------
    log : path, optional
        A log that each window opens with, in any format that flexid identify takes.
    port : int, optional
        Port of the machine; 0 for any that is free.
    browser : bool, optional
        Open the page in a browser.
    """
    path = None if log is None else Path(log)
    if path is not None and not path.exists():
        raise RecordingError(
            shown(path), "", "there is no such file: check the spelling, or give the path of a log"
        )
    from flexid.studio import need_packages

    need_packages()
    from flexid.studio.server import serve

    def announce(address: str) -> None:
        click.echo(f"flexid studio: {address} (Ctrl-C ends it)")
        if browser:
            import webbrowser

            webbrowser.open(address)

    serve(path, port, announce)
