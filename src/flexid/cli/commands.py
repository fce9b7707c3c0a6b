"""All commands: registers each, and turns errors into one sentence and an exit status."""

import os
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from flexid.cli.command_table import COMMANDS
from flexid.cli.generated import (
    ExitStatus,
    open_what_is_closed,
    register,
    spell_what_cannot_be_encoded,
)
from flexid.errors import ConvergenceError, FlexidError, SimulationError

_TYPERS_INTERRUPTION = 130

_ABOUT = "Physical parameters of flexible-joint drives from their motion, with intervals."
_EPILOG = (
    "Every command has its own help: flexid identify --help. Exit status of all commands: 0 done "
    "and determined, 1 the data cannot support all of it, 2 bad input, 3 interrupted, 70 a defect "
    "of flexid."
)


def command_line(only: str = "") -> typer.Typer:
    """All commands, or one of them alone, for which less is loaded."""
    app = typer.Typer(
        name="flexid",
        help=_ABOUT,
        epilog=_EPILOG,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    for command in COMMANDS:
        if only in ("", command.name):
            register(app, command)
    return app


def _asked_for(arguments: Sequence[str]) -> str:
    """The command that is called; empty where all of them may be wanted."""
    first = next((each for each in arguments if each != "--debug"), "")
    named = any(command.name == first for command in COMMANDS)
    return first if named and "_FLEXID_COMPLETE" not in os.environ else ""


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"flexid {version('flexid')}")
        raise typer.Exit


class _Wanted:
    """What the user asked of the process as a whole."""

    debug = False


def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_show_version,
            is_eager=True,
            help="Show the version and exit.",
        ),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Print the traceback of a defect of flexid.")
    ] = False,
) -> None:
    _Wanted.debug = debug


def _ended(code: int) -> ExitStatus:
    """The exit status for one of Typer's, which has its own for Ctrl-C."""
    if code != _TYPERS_INTERRUPTION:
        return ExitStatus(code)
    typer.echo("flexid: interrupted; nothing half written is left", err=True)
    return ExitStatus.INTERRUPTED


def run() -> ExitStatus:
    """Run the command line as far as its exit status."""
    open_what_is_closed()
    spell_what_cannot_be_encoded()
    _Wanted.debug = False
    try:
        command_line(_asked_for(sys.argv[1:]))(prog_name="flexid")
    except SystemExit as end:
        return _ended(int(end.code or 0))
    except FlexidError as error:
        typer.echo(f"flexid: {error}", err=True)
        unsupported = isinstance(error, ConvergenceError | SimulationError)
        return ExitStatus.LACKING if unsupported else ExitStatus.BAD_INPUT
    except OSError as error:  # a full disk or a closed terminal; bad paths are FlexidErrors
        place = error.filename or "the output"
        reason = error.strerror or error
        typer.echo(
            f"flexid: {place} cannot be written ({reason}): make room, or write elsewhere", err=True
        )
        return ExitStatus.BAD_INPUT
    except MemoryError:
        typer.echo(
            "flexid: the memory does not suffice: close other programs, give a shorter log, or, "
            "with flexid identify, a Parquet file and --stream",
            err=True,
        )
        return ExitStatus.BAD_INPUT
    except Exception as error:  # an error that nobody foresaw
        if _Wanted.debug:
            import traceback

            traceback.print_exc()
        else:
            typer.echo(defect_message(error, sys.argv[1:]), err=True)
        return ExitStatus.DEFECT
    return ExitStatus.DONE


def defect_message(error: Exception, arguments: Sequence[str]) -> str:
    """One paragraph: what happened, and how to report it.

    The traceback goes into a temporary file.
    """
    import tempfile
    from traceback import format_exception

    from flexid.report.terminal import USUAL, wrapped

    command = " ".join(["flexid", *arguments])
    again = " ".join(["flexid", "--debug", *arguments])
    said = (
        f"flexid: this is a defect of flexid, not of your input: {type(error).__name__} "
        f"({str(error) or 'without a message'}). Please report it where you got flexid from, "
    )
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="flexid-defect-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write(f"{command}\n{_versions()}\n\n{''.join(format_exception(error))}")
        said += (
            f"with the file {file.name}: it holds the command, the versions and the traceback, and "
            f"none of your data. To see the traceback here: {again}"
        )
    except OSError:
        said += f"with what this prints: {again}"
    return "\n".join(wrapped(said, USUAL))


def _versions() -> str:
    import platform
    from importlib.metadata import version

    names = ("flexid", "numpy", "scipy", "numba", "polars")
    found = ", ".join(f"{name} {version(name)}" for name in names)
    return f"{found}, Python {platform.python_version()}, {sys.platform}"
