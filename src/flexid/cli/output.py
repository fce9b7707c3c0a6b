"""How an answer leaves a command: on standard output, as files, and as an exit status."""

import codecs
import io
import json
import os
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.library.answer import Answer

_MOST_WARNINGS = 3  # that anybody acts on at once


class ExitStatus(IntEnum):
    """How a command ended."""

    DONE = 0
    """All that was asked for is there, and determined where it can be."""

    LACKING = 1
    """Done, but the data cannot support all of it; the answer says what, and why."""

    BAD_INPUT = 2
    """An input, an option or a place to write to cannot be used; one sentence says what to do."""

    INTERRUPTED = 3
    """By Ctrl-C or SIGTERM; nothing half written is left."""

    DEFECT = 70
    """An error of flexid itself, as in sysexits.h; what is printed says how to report it."""


@contextmanager
def output(out: Path | None) -> Iterator[Path | None]:
    """Directory whose files appear when all are written; none if none is wanted."""
    if out is None:
        yield None
        return
    from flexid.report.documents import output_directory

    with output_directory(out) as directory:
        yield directory


def hand_over(
    answer: "Answer", flags: Mapping[str, Any], files: Path | None, errors: "Console", rest: str
) -> None:
    """Print an answer and write its files: a full disk must not lose what is printed.

    The `OSError` that came first is raised when all has been tried; `rest` shows the warnings that
    are not printed.
    """

    def write() -> None:
        if files is not None:
            out, csv = str(flags["out"]), flags.get("csv", False)
            answer._write_files(files, as_typed(), out, csv=csv)

    print_warnings(answer.warnings, errors, rest)
    failures = []
    for step in (lambda: _print_answer(answer, flags), write):
        try:
            step()
        except BrokenPipeError:  # whoever read the answer has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except OSError as error:
            failures.append(error)
    if failures:
        raise failures[0]


def _print_answer(answer: "Answer", flags: Mapping[str, Any]) -> None:
    from flexid.report.terminal import print_parts

    if flags["as_json"]:
        print_document(answer._document())
    else:
        print_parts([*answer._parts(), *(answer._evidence() if flags.get("explain") else ())])


def as_typed() -> str:
    """The command that runs, as a shell would take it once more."""
    return shlex.join(["flexid", *sys.argv[1:]])


def print_document(document: Mapping[str, Any]) -> None:
    """Print JSON on standard output, in ASCII where that does not have every character."""
    from flexid.report.documents import to_json
    from flexid.report.terminal import encodable

    text = to_json(document)
    if not encodable(text):
        text = json.dumps(json.loads(text), indent=2) + "\n"
    typer.echo(text, nl=False)


def print_warnings(warnings: Sequence[str], errors: "Console", rest: str = "") -> None:
    """Print warnings on standard error, a line each."""
    shown = warnings[:_MOST_WARNINGS] if rest else warnings
    for warning in shown:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if len(shown) < len(warnings):
        more = f"{len(warnings) - len(shown)} more: {rest}"
        errors.print(more, style="yellow", markup=False, soft_wrap=True)


def open_what_is_closed() -> None:
    """Open standard streams that were closed (``>&-``) on the null device.

    Without it the first file that is opened takes their number, and what is printed lands in it.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest that is free
        pass
    os.close(number)
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - it stays open
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115 - it stays open


def spell_what_cannot_be_encoded() -> None:
    """Let standard output and error spell what their encoding lacks: alpha2 for α₂, +- for ±."""
    codecs.register_error("flexid.spelled", _spelled)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="flexid.spelled")


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    from flexid.report.terminal import spelled

    return spelled(error.object[error.start : error.end]), error.end
