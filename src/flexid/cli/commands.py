"""All commands: registers each, and turns errors into one sentence and an exit status."""

import sys
from collections.abc import Callable
from typing import Annotated

import typer

from flexid.cli import studio
from flexid.cli.campaign import campaign
from flexid.cli.encoding import open_what_is_closed, spell_what_cannot_be_encoded
from flexid.cli.exit_status import ExitStatus
from flexid.cli.generated import Command, PlainCommand, register
from flexid.cli.identify import identify
from flexid.cli.texts import derive, export, simulate
from flexid.cli.watch import watch
from flexid.errors import ConvergenceError, FlexidError, SimulationError

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


COMMANDS = (
    Command(
        "identify",
        (
            "identify examples/flexible_joint.csv --out results",
            "identify run1.csv run2.csv --known motor_inertia=0.3+-0.01",
            "identify arm.csv --columns map.toml --bounds joint_stiffness=50:200",
            "identify day.parquet --stream --strict",
            "identify run.csv --model arm.toml",
        ),
        "0 where every parameter is determined or weak; 1 where one is not determined, and the "
        "answer says which and why; with --strict, 1 where one is weak, too; 2 for bad input.",
        doing="identifying",
        writes="report.html, estimate.json and the figures",
        flags=("explain", "strict"),
        notes="A planar arm of several elastic joints is described by a TOML file after --model, "
        "and its channels are numbered.",
        more="--explain",
        done=lambda answer, flags: answer.supports(strict=flags["strict"]),
        run=identify,
    ),
    Command(
        "validate",
        (
            "validate results/estimate.json run3.csv --out results",
            "validate results run3.csv --min-fit 80",
        ),
        "0 when it is done; 1 where the free run is below --min-fit; 2 for bad input.",
        doing="predicting",
        writes="report.html, validation.json and the figures",
        flags=("min_fit",),
        more="--json",
        done=lambda answer, flags: answer.supports(flags["min_fit"]),
    ),
    Command(
        "compare",
        (
            "compare before/estimate.json after/estimate.json",
            "compare drive1 drive2 --out differences",
            "compare before after --json",
        ),
        "0 where everything was compared and no change is seen; 1 where something has changed, or "
        "is not determined in both, and the answer says what; 2 for bad input.",
        writes="comparison.json, comparison.png and report.html",
        done=lambda answer, _flags: answer.agree,
    ),
    Command(
        "excitation",
        (
            "excitation examples/flexible_joint.csv",
            "excitation run1.csv --known motor_inertia=0.3 --out results",
        ),
        "as of flexid identify.",
        doing="examining",
        writes="excitation.json and excitation.png",
        flags=("strict",),
        more="flexid identify --explain",
        done=lambda answer, flags: answer.supports(strict=flags["strict"]),
    ),
    Command(
        "design",
        (
            "design examples/drive.toml --out results",
            "design examples/drive.toml --kind trajectory --duration 20",
        ),
        "0 where every coefficient would be determined to 10 % or better; 1 where some would not, "
        "and the answer says which; 2 for bad input.",
        doing="searching",
        writes="command.csv, design.json and design.png",
        done=lambda answer, _flags: answer.supported,
    ),
    Command(
        "derive",
        (
            "derive flexible-joint --to latex",
            "derive examples/models/pendulum.toml --to c",
        ),
        "0 when it is done, 2 for bad input, which includes a model that has no observer.",
        run=derive,
    ),
    Command(
        "export",
        (
            "export results/estimate.json --to c99 --sample-time 0.001 --out drive",
            "export flexible-joint --to c99 --log run.csv --out drive",
            "export results/estimate.json --to mjcf --out scene",
            "export results/estimate.json --to fmu --sample-time 0.001 --out units",
        ),
        "0 when it is done, 2 for bad input.",
        doing="exporting",
        run=export,
    ),
    Command(
        "watch",
        (
            "watch examples/flexible_joint.csv --stop-at-end",
            "watch run.csv --checkpoint run.checkpoint",
            "watch udp://127.0.0.1:9000 --json",
            "watch run.csv --estimate results/estimate.json --memory 60",
            "watch 'serial:///dev/ttyUSB0?baud=921600' --columns drive.toml",
        ),
        "0 where the estimates had converged in the end, 1 where they had not, 2 for bad input, "
        "3 for Ctrl-C; the last report and the checkpoint are written in any case.",
        writes="watch.json, the last report,",
        notes="In a terminal the view is renewed; with --json each report is one line.",
        run=watch,
    ),
    Command(
        "simulate",
        (
            "simulate experiments/sampled_joint.toml --out run",
            "simulate experiments/huang2003.toml --set controller.k=30",
        ),
        "0 when the run is done; 1 where it diverges or cannot meet its tolerance; 2 for bad "
        "input.",
        doing="simulating",
        writes="report.html, run.json, run.parquet, log.parquet, figures",
        flags=("csv",),
        run=simulate,
    ),
    Command(
        "campaign",
        (
            "campaign experiments/noise_campaign.toml --out noise",
            "campaign --summary noise",
        ),
        "0 where every run has its row, however it ended; 1 for a summary in which no run "
        "finished; 2 for bad input; 3 where it was interrupted, with all complete parts kept.",
        done=lambda answer, _flags: bool(answer.result.finished),
        run=campaign,
    ),
    Command(
        "reproduce",
        ("reproduce --out results",),
        "0 in any case but bad input, which is 2.",
        doing="reproducing",
        writes="report.html, result.json and the figures",
    ),
)
"""The commands that call a function of the library of the same name."""


def _register_own(command: Callable[..., None], examples: tuple[str, ...]) -> None:
    """Add a command that declares its options itself."""
    epilog = "\n".join(["\b", "Examples:", *(f"  flexid {example}" for example in examples)])
    summary = (command.__doc__ or "").partition("\n\n")[0]
    app.command(cls=PlainCommand, short_help=summary, epilog=epilog)(command)


for _command in COMMANDS:
    register(app, _command)
    if _command.name == "watch":  # in the order of the help
        _register_own(studio.studio, studio.EXAMPLES)


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
