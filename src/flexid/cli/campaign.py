"""``flexid campaign EXPERIMENT``: many runs; ``flexid campaign --summary DIR``: what they tell."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexid.errors import SettingError

if TYPE_CHECKING:
    from rich.progress import Progress

_INTERRUPTED = 130


def campaign(
    experiment: Annotated[
        Path | None, typer.Argument(help="TOML file with a [campaign] table.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Directory of the rows; a campaign begun there goes on.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Threads; all cores by default.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler to run it on, e.g. tcp://host:8786.")
    ] = None,
    summary: Annotated[
        Path | None, typer.Option(help="Summarise the campaign in this directory instead.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the summary as JSON instead of tables.")
    ] = False,
) -> None:
    """Run an experiment many times, as its [campaign] table says, or summarise what was run.

    A campaign that was interrupted goes on with the same command, and ends with the same rows.

    Exit status 0: every run has its row, whatever became of it; 1: a summary in which no run
    finished; 2: bad input; 130: interrupted, with all complete pieces kept.
    """
    if summary is not None:
        _refuse("--summary", "stands alone", experiment, out, workers, scheduler)
        _summarise(summary, as_json)
        return
    if experiment is None:
        raise SettingError("EXPERIMENT", "is missing: name an experiment file, or use --summary")
    if out is None:
        raise SettingError("--out", "is missing: name the directory for the rows")
    if scheduler is not None:
        _refuse("--workers", "is for this machine: leave it out with --scheduler", workers)
    _refuse("--json", "belongs to --summary", as_json or None)
    _run(experiment, out, workers, scheduler)


def _refuse(setting: str, reason: str, *given: object) -> None:
    if any(one is not None for one in given):
        raise SettingError(setting, reason)


def _run(path: Path, out: Path, workers: int | None, scheduler: str | None) -> None:
    from flexid.campaigns import run_campaign
    from flexid.experiments import read_experiment

    experiment = read_experiment(path)
    bar = _progress_bar()
    task = bar.add_task("preparing (the first run on a machine compiles)", total=None)
    reported: set[int] = set()

    def report(done: int, total: int) -> None:
        reported.add(done)
        bar.update(task, completed=done, total=total)
        if len(reported) > 1:  # the first report comes before the first piece
            bar.update(task, description="running")

    try:
        with bar:
            campaign = run_campaign(experiment, out, workers, scheduler, report)
    except KeyboardInterrupt:
        typer.echo(f"flexid: interrupted: {_kept(out)}; the same command goes on", err=True)
        raise typer.Exit(_INTERRUPTED) from None
    statuses = ", ".join(f"{name} {count}" for name, count in campaign.statuses.items())
    typer.echo(f"{campaign.runs} runs in {out}: {statuses}")
    typer.echo(f"What they tell: flexid campaign --summary {out}")


def _kept(out: Path) -> str:
    from flexid.campaigns.store import find_store
    from flexid.errors import CampaignError

    try:
        store = find_store(out)
    except CampaignError:
        return "nothing was run yet"
    return f"{store.kept} of {store.manifest.runs} runs are kept in {out}"


def _progress_bar() -> "Progress":
    """Share, rate and time left, on a terminal only."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:.3g} runs/s" if task.speed else "")

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rate())
    left = TimeRemainingColumn(elapsed_when_finished=True)
    return Progress(*columns, left, console=console, disable=not console.is_terminal)


def _summarise(directory: Path, as_json: bool) -> None:
    from flexid.campaigns import summarise
    from flexid.report.campaign_document import campaign_document
    from flexid.report.campaign_figures import save_campaign_figures
    from flexid.report.campaign_table import print_campaign
    from flexid.report.documents import output_directory, to_json

    found = summarise(directory)
    document = to_json(campaign_document(found))
    with output_directory(directory) as files:
        (files / "summary.json").write_text(document, encoding="utf-8")
        save_campaign_figures(found, files)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_campaign(found)
    if not found.finished:
        raise typer.Exit(1)
