"""All commands; the texts of their help are in ``commands.toml``."""

import os
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill

import click

from flexid import __version__
from flexid.cli.generated import (
    Command,
    ExitStatus,
    Options,
    open_what_is_closed,
    present,
    print_document,
    print_warnings,
    replace_what_cannot_be_encoded,
    working,
)
from flexid.cli.live import watch
from flexid.errors import ConvergenceError, FlexidError, SettingError, SimulationError
from flexid.files import is_arm_file

_ARM_OPTIONS = ("logs", "model", "columns")


def identify(command: Command, options: Options, flags: Options) -> None:
    """Identify a joint or an arm, and output the result."""
    model = options.get("model", "")
    if not is_arm_file(model):
        present(command, options, flags)
        return
    given = [name for name in options if name not in _ARM_OPTIONS]
    if given or flags["explain"]:
        name = (given or ["explain"])[0].replace("_", "-")
        raise SettingError(name, "is for one joint, and --model names an arm: leave it out")
    logs, columns = options["logs"], options.get("columns")
    if len(logs) > 1:
        raise SettingError("LOG", f"an arm takes one log, and {len(logs)} were given: give one")
    from flexid.library.identify import identify_arm

    log, arm, columns = Path(logs[0]), Path(model), columns and Path(columns)
    present(command, options, flags, lambda progress: identify_arm(log, arm, columns, progress))


def derive(command: Command, options: Options, flags: Options) -> None:
    """Print the equations, and notes on them on standard error."""
    text = command.call(options)
    for note in text.notes:
        click.echo(f"note: {note}", err=True)
    if flags["json"]:
        target = options.get("to", "latex")
        print_document({"model": options["model"], "to": target, "text": text, "notes": text.notes})
    else:
        click.echo(text, nl=False)


def export(command: Command, options: Options, flags: Options) -> None:
    """Write the files, and print their paths."""
    from rich.console import Console

    if "columns" in options and "log" not in options:
        raise SettingError("--columns", "is for a log: name one with --log")
    errors = Console(stderr=True)
    with working(errors, command.doing):
        files = command.call(options)
    print_warnings(files.warnings, errors)
    paths = [str(path) for path in files.paths]
    if flags["json"]:
        print_document({"files": paths, "warnings": files.warnings})
    else:
        click.echo("\n".join(paths))


def simulate(command: Command, options: Options, flags: Options) -> None:
    """Simulate, and output the result."""
    if flags["csv"] and flags["out"] is None:
        raise SettingError("--csv", "has nowhere to write: give a directory with --out")
    present(command, options, flags)


def campaign(command: Command, options: Options, flags: Options) -> None:
    """Run a campaign and print the status of its runs; or summarise one in its directory."""
    if "summary" in options:
        present(command, options, {**flags, "out": Path(options["summary"])})
        return
    out = options.get("out")
    try:
        with _progress_bar() as report:
            found = command.function(**options, progress=report)
    except KeyboardInterrupt:
        click.echo("flexid: interrupted: give the same command again to continue", err=True)
        raise click.exceptions.Exit(ExitStatus.INTERRUPTED) from None
    if flags["json"]:
        print_document(found.document)
        return
    statuses = ", ".join(f"{name} {count}" for name, count in found.statuses.items())
    click.echo(f"{sum(found.statuses.values())} runs in {out}: {statuses}")
    click.echo(f"Summary: flexid campaign --summary {out}")


@contextmanager
def _progress_bar() -> Iterator[Callable[[int, int], None]]:
    """Show progress and remaining time, on a terminal only."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("preparing (the first run on a machine compiles)", total=None)

        def report(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, description=f"{done} of {total} runs")

        yield report


def studio(command: Command, options: Options, _flags: Options) -> None:
    """Serve the studio until it is interrupted."""
    command.function(**options)


_WITH_OWN_FUNCTION = (identify, derive, export, watch, studio, simulate, campaign)
_RUN = {function.__name__: function for function in _WITH_OWN_FUNCTION}
"""Commands that check their own options, or print their result in another way."""

_IS_COMPLETE = {
    "identify": lambda answer, flags: answer.supports(strict=flags["strict"]),
    "excitation": lambda answer, flags: answer.supports(strict=flags["strict"]),
    "validate": lambda answer, flags: answer.supports(flags["min_fit"]),
    "compare": lambda answer, _flags: answer.agree,
    "design": lambda answer, _flags: answer.supported,
    "campaign": lambda answer, _flags: bool(answer.result.finished),
}
"""Whether a result is complete, for commands with results that may be incomplete."""

_TEXTS = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
COMMANDS = tuple(_TEXTS)  # names of all commands

_ABOUT = "Identify physical parameters of flexible-joint drives from logs of their motion."
_EPILOG = (
    "Every command has its own help, for example: flexid identify --help. Exit status: 0 done; 1 "
    "done, but the data do not support all of the result; 2 bad input; 3 interrupted; 70 a defect "
    "of flexid."
)


class _Group(click.Group):
    """The commands, in the order of ``commands.toml``."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's
        return list(self.commands)


def command_line(only: str = "") -> click.Group:
    """Return all commands, or only the named one, which imports less."""
    commands = [
        Command(
            name,
            **_TEXTS[name],
            run=_RUN.get(name, present),
            done=_IS_COMPLETE.get(name, lambda *_: True),
        )
        for name in COMMANDS
        if only in ("", name)
    ]
    group = _Group(
        name="flexid",
        help=_ABOUT,
        epilog=_EPILOG,
        commands=commands,
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    shown = "Show the version and exit."
    click.version_option(package_name="flexid", message="flexid %(version)s", help=shown)(group)
    defect = "Print the traceback if flexid has a defect."
    return click.option("--debug", is_flag=True, expose_value=False, help=defect)(group)


def run() -> ExitStatus:
    """Run the command line and return its exit status."""
    open_what_is_closed()
    replace_what_cannot_be_encoded()
    try:
        first = next((each for each in sys.argv[1:] if each != "--debug"), "")
        is_only = first in COMMANDS and "_FLEXID_COMPLETE" not in os.environ
        group = command_line(first if is_only else "")
        return ExitStatus(group.main(prog_name="flexid", standalone_mode=False) or 0)
    except click.ClickException as error:
        error.show()
        return ExitStatus(error.exit_code)
    except click.Abort:
        click.echo("flexid: interrupted; no half-written file is left", err=True)
        return ExitStatus.INTERRUPTED
    except FlexidError as error:
        click.echo(f"flexid: {error}", err=True)
        unsupported = isinstance(error, ConvergenceError | SimulationError)
        return ExitStatus.LACKING if unsupported else ExitStatus.BAD_INPUT
    except OSError as error:  # such as a full disk; bad paths are FlexidErrors
        place = error.filename or "the output"
        reason = error.strerror or error
        click.echo(
            f"flexid: {place} cannot be written ({reason}): make room, or write elsewhere", err=True
        )
        return ExitStatus.BAD_INPUT
    except MemoryError:
        click.echo(
            "flexid: there is too little memory: close other programs, give a shorter log, or, "
            "with flexid identify, a Parquet file and --stream",
            err=True,
        )
        return ExitStatus.BAD_INPUT
    except Exception as error:  # an unexpected error
        if "--debug" in sys.argv:
            import traceback

            traceback.print_exc()
        else:
            again = shlex.join(["flexid", "--debug", *sys.argv[1:]])
            message = (
                f"flexid: this is a defect of flexid {__version__}, not of your input: "
                f"{type(error).__name__} ({str(error) or 'without a message'}). Please report it "
                f"where you got flexid from, with what this prints: {again}"
            )
            wrapped = fill(message, 80, break_long_words=False, break_on_hyphens=False)
            click.echo(wrapped, err=True)
        return ExitStatus.DEFECT
