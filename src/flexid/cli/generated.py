"""Commands generated from public functions: signatures and docstrings become options."""

import inspect
import io
import json
import logging
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import IntEnum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from flexid.cli.options import (
    FLAGS,
    OUT,
    Argument,
    declared,
    flag_of,
    option_of,
    sentences,
    typed_name,
)
from flexid.errors import SettingError
from flexid.library.arguments import described

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.library.answer import Answer


_MOST_WARNINGS = 3  # printed at most; the others are in the report


class ExitStatus(IntEnum):
    """Exit status of a command."""

    DONE = 0  # and every requested value is determined or weak
    LACKING = 1  # done, but the data do not support all of the result, which states what and why
    BAD_INPUT = 2  # an input, an option or an output path is invalid; the message states what to do
    INTERRUPTED = 3  # by Ctrl-C, SIGTERM or SIGHUP; no half-written file is left
    DEFECT = 70  # of flexid, as in sysexits.h; the message states how to report it


def output(out: Path | None) -> AbstractContextManager[Path | None]:
    """Return a context of the output directory, whose files appear once all are written."""
    from flexid.files import output_directory

    return nullcontext() if out is None else output_directory(out)


def hand_over(
    answer: "Answer", flags: Mapping[str, Any], files: Path | None, errors: "Console", rest: str
) -> OSError | None:
    """Print a result and write its files; return the error of printing, if any."""
    print_warnings(answer.warnings, errors, rest)
    failure = None
    try:
        _print_answer(answer, flags)
    except BrokenPipeError:  # the reader of the output, such as head, has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        failure = error
    if files is not None:
        answer._write_files(files, as_typed(), csv=flags.get("csv", False))
    return failure


def _print_answer(answer: "Answer", flags: Mapping[str, Any]) -> None:
    if flags["json"]:
        print_document(answer._document())
    else:
        from flexid.report.terminal import print_parts

        print_parts(answer._parts(explain=flags.get("explain", False)))


def as_typed() -> str:
    """Return the current command line, quoted for a shell."""
    return shlex.join(["flexid", *sys.argv[1:]])


def print_document(document: Mapping[str, Any]) -> None:
    """Print JSON on standard output, in ASCII if its encoding lacks a character."""
    from flexid.arrays import to_json

    text = to_json(document)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(json.loads(text), indent=2) + "\n"
    click.echo(text, nl=False)


def print_warnings(warnings: Sequence[str], errors: "Console", rest: str = "") -> None:
    """Print warnings on standard error, a line each."""
    shown = warnings[:_MOST_WARNINGS] if rest else warnings
    for warning in shown:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if len(shown) < len(warnings):
        count = len(warnings) - len(shown)
        more = f"{count} more warning{'s' if count > 1 else ''}: see {rest}"
        errors.print(more, style="yellow", markup=False, soft_wrap=True)


class _Closed(io.TextIOBase):
    """Standard output that is closed, so that nobody would receive a result."""

    def write(self, _text: str) -> int:
        raise OSError("it is closed")


def open_what_is_closed() -> None:
    """Open closed standard streams on the null device, so that no file gets their number."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # os.open takes the lowest free number
        pass
    os.close(number)
    if sys.stdout is None:
        sys.stdout = _Closed()
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115 - it stays open


def replace_what_cannot_be_encoded() -> None:
    """Make standard output and error print "?" for characters that they cannot encode."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


_OF_PYTHON = ("progress", "thresholds")  # parameters without an option

Options = Mapping[str, Any]
Progress = Callable[[str], None]


class Command(click.Command):
    """Command for a public function; its help describes arguments as well as options."""

    def __init__(
        self,
        name: str,  # of the command and of the function
        *,
        examples: Sequence[str],
        status: str,  # meaning of the exit status
        run: "Callable[[Command, Options, Options], None]",  # usually `present`
        done: Callable[[Any, Options], bool],  # whether a result is complete; else exit status 1
        doing: str = "",  # shown while the command runs
        writes: str = "",  # files that --out writes
        flags: Sequence[str] = (),  # names in `FLAGS`
        own: str = "",  # module of a function outside the library, which returns no result
        notes: str = "",  # further paragraph of the help
        more: str = "",  # option or command that shows all warnings
    ) -> None:
        self.run, self.done, self.doing, self.more = run, done, doing, more
        self.function: Callable[..., Any] = getattr(import_module(own or "flexid"), name)
        self._flags = [*flags, *(["out"] if writes else []), *([] if own else ["json"])]
        head, _, rest = (inspect.getdoc(self.function) or "").partition("\n\n")
        prose = re.split(r"\n[A-Z]\w+\n-{3,}", f"\n{rest}")[0]  # before the first section
        paragraphs = [sentences(part) for part in prose.strip().split("\n\n")]
        body = [head, *paragraphs, notes, f"Exit status: {status}"]
        lines = ["\b", "Examples:", *(f"  flexid {example}" for example in examples)]
        written = OUT._replace(note=f"Write {writes} into this directory.")
        printing = {"out": written, **FLAGS}
        super().__init__(
            name,
            params=[*self._from_library(), *(flag_of(n, printing[n]) for n in self._flags)],
            help="\n\n".join(filter(None, body)),
            short_help=head,
            epilog="\n".join(lines),
        )

    def _from_library(self) -> Iterator[click.Parameter]:
        documented = described(self.function)
        for name, parameter in inspect.signature(self.function).parameters.items():
            if name in _OF_PYTHON:
                continue
            kind, words = documented[name]
            choices = "|".join(re.findall(r'"(\w+)"', kind))
            option = option_of(parameter)
            yield declared(
                parameter,
                option._replace(
                    metavar=option.metavar or (f"<{choices}>" if choices else None),
                    note=f"{sentences(words)} {option.note}".strip(),
                ),
            )

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the command does, and the list of its arguments."""
        super().format_help_text(ctx, formatter)
        arguments = [each for each in self.params if isinstance(each, Argument)]
        if arguments:
            with formatter.section("Arguments"):
                formatter.write_dl([(f"{each.metavar}", each.note) for each in arguments])

    def invoke(self, ctx: click.Context) -> None:
        """Run the command; options that were not typed keep the library's defaults."""
        flags = {name: ctx.params[name] for name in self._flags}
        options = {
            name: value
            for name, value in ctx.params.items()
            if name not in flags and ctx.get_parameter_source(name) is not ParameterSource.DEFAULT
        }
        try:
            self.run(self, options, flags)
        except SettingError as error:
            typed = {each.name: typed_name(each) for each in self.params}
            raise SettingError(typed.get(error.setting, error.setting), error.reason) from None

    def call(self, options: Options, progress: Progress = lambda _step: None) -> Any:
        """Return the result of the public function."""
        if "progress" in inspect.signature(self.function).parameters:
            return self.function(**options, progress=progress)
        return self.function(**options)


def present(
    command: Command,
    options: Options,
    flags: Options,
    work: "Callable[[Progress], Answer] | None" = None,  # in place of the public function
) -> None:
    """Call the public function, print its result, write its files, and set the exit status."""
    from rich.console import Console

    errors = Console(stderr=True)
    with output(flags.get("out")) as files:
        with working(errors, command.doing) as progress:
            answer = work(progress) if work else command.call(options, progress)
        rest = "" if flags.get("explain") else "--json" if work else command.more
        with working(errors, "drawing" if files else ""):
            failure = hand_over(answer, flags, files, errors, rest)
    if failure is not None:  # after the files are in their place
        raise failure
    if not command.done(answer, flags):
        raise click.exceptions.Exit(ExitStatus.LACKING)


@contextmanager
def working(errors: "Console", doing: str) -> Iterator[Progress]:
    """Show log messages, and on a terminal progress; yields the function to call with each step."""
    logger, handler = logging.getLogger("flexid"), logging.StreamHandler()
    before = logger.level
    if doing:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        if doing and errors.is_terminal:
            with errors.status(doing) as status:
                yield lambda step: status.update(f"{doing}: {step}")
        else:
            yield lambda _step: None
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)
