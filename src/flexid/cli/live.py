"""Commands that run until they are ended: `flexid watch` and `flexid studio`."""

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


_REFRESH_TIME = 0.2  # s between updates of the terminal


@one_thread()
def watch(command: Command, options: Options, flags: Options) -> None:
    """Follow the source to its end or to an interruption, then report."""
    from rich.console import Console

    from flexid.report.terminal import print_parts

    if "source" not in options:
        raise SettingError("SOURCE", "is missing: name a file, or - for standard input")
    watched: Watch = command.function(**options)
    with output(flags["out"]) as files, _interruptions() as signals:
        failure = None
        try:
            _follow(watched, signals, Console(stderr=True), as_json=flags["json"])
        except Exception as error:  # any error: the report of the samples before it comes first
            failure = error
        if watched.has_begun:
            if flags["json"]:
                click.echo(json.dumps(watched.document))
            else:
                print_parts(watched._parts())
            if files is not None:
                watched._write_files(files, as_typed(), csv=False)
        if failure is not None:
            raise failure
    if signals:
        signal.raise_signal(signals[0])  # handled now, after the report
    if not watched.has_converged:
        raise click.exceptions.Exit(ExitStatus.LACKING)


@contextmanager
def _interruptions() -> Iterator[list[int]]:
    """Collect signals, so that a block of samples is completed; the second one acts at once."""
    signals: list[int] = []
    before: dict[int, Any] = {}

    def record(number: int, _frame: FrameType | None) -> None:
        signals.append(number)
        signal.signal(number, before[number])

    for number in (signal.SIGINT, signal.SIGTERM):
        before[number] = signal.signal(number, record)
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _follow(watched: "Watch", signals: list[int], errors: "Console", *, as_json: bool) -> None:
    """Follow the stream to its end or to an interruption, and show the current report."""
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
            if terminal and now - drawn > _REFRESH_TIME:
                session = watched.result if watched.has_begun else None
                live.update(live_view(session, errors.width), refresh=True)
                drawn = now
            if signals:
                break


def studio(log: str | None = None, *, port: int = 8765, browser: bool = True) -> None:
    """Serve a web page to check and identify logs.

    On the page you drop a log, assign its columns, see what it can determine, identify it, and save
    the results. The page's address contains your choices. Ctrl-C ends the studio.

    Parameters
    ----------
    log : path, optional
        A log that each window opens, in any format that flexid identify reads.
    port : int, optional
        Port on this machine; 0 for any free port.
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
