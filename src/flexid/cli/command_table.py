"""What each command is besides the function of the library that it calls.

That is examples, words and an end; some check options of their own, or print something else than
an answer.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import typer

from flexid.cli.generated import (
    Command,
    ExitStatus,
    Options,
    called,
    present,
    print_document,
    print_warnings,
    show,
    working,
)
from flexid.errors import SettingError
from flexid.library.arguments import is_arm_file

_OF_AN_ARM = ("logs", "model", "columns")


def identify(command: Command, options: Options, flags: Options) -> None:
    """Identify a joint or an arm, and hand the answer over."""
    model = options.get("model", "")
    if not is_arm_file(model):
        present(command, options, flags)
        return
    given = [name for name in options if name not in _OF_AN_ARM]
    if given or flags["explain"]:
        name = (given or ["explain"])[0].replace("_", "-")
        raise SettingError(name, "is for one joint, and --model names an arm: leave it out")
    logs = options["logs"]
    if len(logs) > 1:
        raise SettingError("LOG", f"an arm takes one log, and {len(logs)} were given: give one")
    from flexid.library.identify import identify_arm

    show(
        replace(command, more="--json"),
        flags,
        lambda progress: identify_arm(logs[0], Path(model), options.get("columns"), progress),
    )


def derive(command: Command, options: Options, flags: Options) -> None:
    """Print the equations, and on standard error what to know of them."""
    text = called(command, options, lambda _step: None)
    for note in text.notes:
        typer.echo(f"note: {note}", err=True)
    if flags["json"]:
        target = options.get("to", "latex")
        print_document({"model": options["model"], "to": target, "text": text, "notes": text.notes})
    else:
        typer.echo(text, nl=False)


def export(command: Command, options: Options, flags: Options) -> None:
    """Write the files, and print their paths."""
    from rich.console import Console

    if "columns" in options and "log" not in options:
        raise SettingError("--columns", "is for a log: name one with --log")
    errors = Console(stderr=True)
    with working(errors, command.doing):
        files = called(command, options, lambda _step: None)
    print_warnings(files.warnings, errors)
    paths = [str(path) for path in files.paths]
    if flags["json"]:
        print_document({"files": paths, "warnings": files.warnings})
    else:
        typer.echo("\n".join(paths))


def simulate(command: Command, options: Options, flags: Options) -> None:
    """Simulate, and hand the answer over."""
    if flags["csv"] and flags["out"] is None:
        raise SettingError("--csv", "has nowhere to write: name a directory with --out")
    present(command, options, flags)


def campaign(command: Command, options: Options, flags: Options) -> None:
    """Run a campaign and say how its runs ended; or summarise one, into its directory."""
    if "summary" in options:
        if len(options) > 1:
            raise SettingError("--summary", "stands alone")
        present(command, options, {**flags, "out": options["summary"]})
        return
    if "experiment" not in options:
        raise SettingError("EXPERIMENT", "is missing: name an experiment file, or use --summary")
    if "out" not in options:
        raise SettingError("--out", "is missing: name the directory for the rows")
    if "scheduler" in options and "workers" in options:
        raise SettingError("--workers", "is for this machine: leave it out with --scheduler")
    if flags["json"]:
        raise SettingError("--json", "belongs to --summary")
    out = options["out"]
    try:
        with _progress_bar() as report:
            found = command.function(**options, progress=report)
    except KeyboardInterrupt:
        typer.echo(f"flexid: interrupted: {_kept(out)}; the same command goes on", err=True)
        raise typer.Exit(ExitStatus.INTERRUPTED) from None
    statuses = ", ".join(f"{name} {count}" for name, count in found.statuses.items())
    typer.echo(f"{sum(found.statuses.values())} runs in {out}: {statuses}")
    typer.echo(f"Summary: flexid campaign --summary {out}")


def _kept(out: Path) -> str:
    from flexid.campaigns.store import find_store
    from flexid.errors import CampaignError

    try:
        store = find_store(out)
    except CampaignError:
        return "nothing was run yet"
    return f"{store.kept} of {store.manifest.runs} runs are kept in {out}"


@contextmanager
def _progress_bar() -> Iterator[Callable[[int, int], None]]:
    """Share, rate and time left, on a terminal only."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal) as bar:
        preparing = "preparing (the first run on a machine compiles)"
        task = bar.add_task(preparing, total=None)
        reported: set[int] = set()

        def report(done: int, total: int) -> None:
            reported.add(done)
            speed = bar.tasks[0].speed
            rate = f", {speed:.3g} runs/s" if speed else ""
            running = f"{done} of {total}{rate}" if len(reported) > 1 else preparing
            bar.update(task, completed=done, total=total, description=running)

        yield report


def watch(command: Command, options: Options, flags: Options) -> None:
    """Follow a source, and report."""
    from flexid.cli.live import watch as follow

    follow(command, options, flags)


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
        "as for flexid identify.",
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
        "studio",
        (
            "studio",
            "studio examples/flexible_joint.csv",
            "studio --port 9000 --no-browser",
        ),
        "3 when Ctrl-C ends it, 2 where it cannot listen, or LOG is not there.",
        own="flexid.cli.live",
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
        "0 when it is done; 2 for bad input.",
        doing="reproducing",
        writes="report.html, result.json and the figures",
    ),
)
"""The commands, each of which calls the function of its name in the library, or declares itself."""
