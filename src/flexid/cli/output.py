"""How an answer leaves a command: printed and written, each although the other may fail."""

import json
import os
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.library.answer import Answer

_MOST_WARNINGS = 3  # that anybody acts on at once


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
