"""All commands: registers each, and turns errors into one sentence and an exit status."""

import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand

from flexid.cli import (
    campaign,
    compare,
    derive,
    design,
    excitation,
    export,
    identify,
    reproduce,
    simulate,
    studio,
    validate,
    watch,
)
from flexid.cli.encoding import open_what_is_closed, spell_what_cannot_be_encoded
from flexid.cli.exit_status import ExitStatus
from flexid.errors import ConvergenceError, FlexidError, SimulationError
from flexid.library.threads import in_one_thread

_TYPERS_INTERRUPTION = 130

app = typer.Typer(
    name="flexid",
    help="Physical parameters of flexible-joint drives from their motion, with intervals.",
    epilog="Every command has its own help: flexid identify --help. "
    "Exit status of all commands: 0 done and determined, 1 the data cannot support all of it, "
    "2 bad input, 3 interrupted, 70 a defect of flexid.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class _Command(TyperCommand):
    """A command whose help shows its arguments without their Python types."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        for parameter in self.params:
            if isinstance(parameter, TyperArgument):
                setattr(parameter, "display_type_rich", lambda ctx: None)  # noqa: ARG005, B010


def _register(command: Callable[..., None], examples: tuple[str, ...]) -> None:
    """Add a command; its docstring's first sentence stands in the list of commands, whole."""
    epilog = "\n".join(["\b", "Examples:", *(f"  flexid {example}" for example in examples)])
    summary = (command.__doc__ or "").partition("\n\n")[0]
    app.command(cls=_Command, short_help=summary, epilog=epilog)(command)


# One line per command. Their modules import nothing heavy before they are called.
_register(in_one_thread(identify.identify), identify.EXAMPLES)
_register(in_one_thread(validate.validate), validate.EXAMPLES)
_register(compare.compare, compare.EXAMPLES)
_register(in_one_thread(excitation.excitation), excitation.EXAMPLES)
_register(in_one_thread(design.design), design.EXAMPLES)
_register(derive.derive, derive.EXAMPLES)
_register(in_one_thread(export.export), export.EXAMPLES)
_register(in_one_thread(watch.watch), watch.EXAMPLES)
_register(studio.studio, studio.EXAMPLES)
_register(simulate.simulate, simulate.EXAMPLES)
_register(campaign.campaign, campaign.EXAMPLES)
_register(in_one_thread(reproduce.reproduce), reproduce.EXAMPLES)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"flexid {version('flexid')}")
        raise typer.Exit


class _Wanted:
    """What the user asked of the process as a whole."""

    debug = False


@app.callback()
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
        app(prog_name="flexid")
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
            from flexid.cli.defect import defect_message

            typer.echo(defect_message(error, sys.argv[1:]), err=True)
        return ExitStatus.DEFECT
    return ExitStatus.DONE
