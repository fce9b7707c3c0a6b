"""``flexid watch SOURCE``: follow a stream, show what is known, and save it."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import typer

from flexid.cli.generated import Command, ExitStatus, Options, as_typed, output, print_warnings
from flexid.errors import SettingError
from flexid.library.arguments import in_one_thread

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.library.watch import Watch

_SAVED_EVERY = 60.0  # s
_DRAWN_EVERY = 0.2  # s


@in_one_thread
def watch(command: Command, options: Options, flags: Options) -> None:
    """Follow the source to its end, or to an interruption; then save and report."""
    from rich.console import Console

    if "source" not in options:
        raise SettingError("SOURCE", "is missing: name a file, - or an address")
    watched: Watch = command.function(**options)
    checkpoint = options.get("checkpoint")
    with output(flags["out"]) as files, _interruptions() as asked:
        failure = None
        try:
            _follow(watched, checkpoint, asked, Console(stderr=True), as_json=flags["as_json"])
        except Exception as error:  # whatever it is, it must not cost what was learnt before
            failure = error
        if watched.has_begun:
            _end(watched, checkpoint, as_json=flags["as_json"])
            if files is not None:
                watched._write_files(files, as_typed(), str(flags["out"]), csv=False)
        if failure is not None:
            raise failure
    if asked:
        signal.raise_signal(asked[0])  # as if it came now, when all is saved
    if not watched.has_converged:
        raise typer.Exit(ExitStatus.LACKING)


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


def _follow(
    watched: "Watch",
    checkpoint: Path | None,
    asked: list[int],
    errors: "Console",
    *,
    as_json: bool,
) -> None:
    """Follow the stream until it ends, or an interruption; show what is known meanwhile."""
    from rich.live import Live

    from flexid.report.watch import Sparks, live_view

    saved = drawn = time.monotonic()
    warned = 0
    sparks = Sparks()
    terminal = not as_json and errors.is_terminal
    live = Live(console=errors, transient=True, auto_refresh=False)
    with live if terminal else nullcontext():
        for due in watched.turns():
            print_warnings(watched.warnings[warned:], errors)
            warned = len(watched.warnings)
            now = time.monotonic()
            if due and as_json:
                _print_line(watched)
            if terminal and now - drawn > _DRAWN_EVERY:
                session = watched.session if watched.has_begun else None
                live.update(live_view(session, sparks, errors.width), refresh=True)
                drawn = now
            if checkpoint is not None and watched.has_begun and now - saved > _SAVED_EVERY:
                _save_meanwhile(watched, checkpoint, errors)
                saved = now
            if asked:
                break


def _save_meanwhile(watched: "Watch", checkpoint: Path, errors: "Console") -> None:
    """Save, or warn: there may be room again in a minute, and the drive runs on."""
    try:
        watched.save_checkpoint(checkpoint)
    except SettingError as error:
        print_warnings((str(error),), errors)


def _end(watched: "Watch", checkpoint: Path | None, *, as_json: bool) -> None:
    """Save, then print the last report: a reader that has gone must not cost the checkpoint."""
    from flexid.report.terminal import print_parts

    try:
        if checkpoint is not None:
            watched.save_checkpoint(checkpoint)
    finally:  # a full disk must not cost the report
        if as_json:
            _print_line(watched)
        else:
            print_parts(watched._parts())


def _print_line(watched: "Watch") -> None:
    import json

    typer.echo(json.dumps(watched.document))
