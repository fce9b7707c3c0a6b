"""``flexid campaign EXPERIMENT``: many runs; ``flexid campaign --summary DIR``: what they show."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.generated import Command, Options, present
from flexid.errors import SettingError


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
