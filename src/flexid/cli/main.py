"""The ``flexid`` command: registers every command and turns errors into one sentence."""

import os
import sys
from typing import Annotated

import typer

from flexid.cli.campaign import campaign
from flexid.cli.derive import derive
from flexid.cli.design import design
from flexid.cli.excitation import excitation
from flexid.cli.identify import identify
from flexid.cli.reproduce import reproduce
from flexid.cli.simulate import simulate
from flexid.cli.validate import validate
from flexid.errors import FlexidError

app = typer.Typer(
    name="flexid",
    help="Trustworthy physical parameters of flexible-joint drives from their motion.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

# One line per command. Their modules import nothing heavy before they are called.
app.command()(identify)
app.command()(validate)
app.command()(excitation)
app.command()(design)
app.command()(derive)
app.command()(simulate)
app.command()(campaign)
app.command()(reproduce)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"flexid {version('flexid')}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line. Exit status: 0 done, 1 the data cannot support it, 2 bad input."""
    # Before NumPy is loaded: our matrices are small, and where other work has a core, threads of
    # the linear algebra that share them wait for each other longer than they compute.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        app()
    except FlexidError as error:
        typer.echo(f"flexid: {error}", err=True)
        sys.exit(2)
    except OSError as error:  # a full disk or a closed terminal; bad paths are FlexidErrors
        place = error.filename or "the output or the cache"
        reason = error.strerror or error
        typer.echo(
            f"flexid: {place} cannot be written ({reason}): make room, or write elsewhere", err=True
        )
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
