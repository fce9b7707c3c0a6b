"""Commands that check options of their own, or print something else than an answer."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import typer

from flexid.cli.generated import Command, Options, called, present, show, working
from flexid.cli.output import ExitStatus, print_document, print_warnings
from flexid.errors import SettingError
from flexid.models.arm_name import is_arm_file

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
    from flexid.library.arm_estimate import identify_arm

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
    if flags["as_json"]:
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
    if flags["as_json"]:
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
    if flags["as_json"]:
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
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        preparing = "preparing (the first run on a machine compiles)"
        task = bar.add_task(preparing, total=None, rate="")
        reported: set[int] = set()

        def report(done: int, total: int) -> None:
            reported.add(done)
            speed = bar.tasks[0].speed
            rate = f"{speed:.3g} runs/s" if speed else ""
            running = "running" if len(reported) > 1 else preparing  # the first comes before a part
            bar.update(task, completed=done, total=total, rate=rate, description=running)

        yield report
