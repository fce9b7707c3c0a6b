"""``flexid campaign EXPERIMENT``: many runs; ``flexid campaign --summary DIR``: what they show."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.options import AsJson, directory
from flexid.cli.output import hand_over, output
from flexid.errors import SettingError

if TYPE_CHECKING:
    from rich.progress import Progress

EXAMPLES = (
    "campaign experiments/noise_campaign.toml --out noise",
    "campaign --summary noise",
)


def campaign(
    experiment: Annotated[
        Path | None,
        typer.Argument(
            metavar="EXPERIMENT",
            help="TOML file with a table named campaign.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            parser=directory,
            help="Write the rows into this directory; a campaign begun there goes on.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, metavar="NUMBER", help="Use so many threads; all cores by default."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Run it on this Dask scheduler: tcp://host:8786."),
    ] = None,
    summary: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Summarise the campaign in this directory instead."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run an experiment many times, or summarise such runs.

    What varies stands in the file's table named campaign. A campaign that was interrupted goes on
    with the same command, and ends with the same rows.

    Exit status: 0 where every run has its row, whatever became of it; 1 for a summary in which no
    run finished; 2 for bad input; 3 where it was interrupted, with all complete parts kept.
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
        if len(reported) > 1:  # the first report comes before the first part
            bar.update(task, description="running")

    try:
        with bar:
            campaign = run_campaign(experiment, out, workers, scheduler, report)
    except KeyboardInterrupt:
        typer.echo(f"flexid: interrupted: {_kept(out)}; the same command goes on", err=True)
        raise typer.Exit(ExitStatus.INTERRUPTED) from None
    statuses = ", ".join(f"{name} {count}" for name, count in campaign.statuses.items())
    typer.echo(f"{campaign.runs} runs in {out}: {statuses}")
    typer.echo(f"Summary: flexid campaign --summary {out}")


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


def _summarise(campaign: Path, as_json: bool) -> None:
    from flexid.campaigns import summarise
    from flexid.report.campaign_document import campaign_document
    from flexid.report.campaign_table import print_campaign

    found = summarise(campaign)
    document = campaign_document(found)

    def write(directory: Path) -> None:
        from flexid.report.campaign_charts import campaign_charts
        from flexid.report.charts.figure import save_charts
        from flexid.report.documents import to_json
        from flexid.report.page.campaign_page import campaign_page
        from flexid.report.page.render import save_page

        (directory / "summary.json").write_text(to_json(document), encoding="utf-8")
        charts = campaign_charts(found)
        save_charts(charts, directory)
        save_page(campaign_page(found, charts), directory)

    with output(campaign) as files:
        hand_over(document, lambda: print_campaign(found), write, as_json=as_json, directory=files)
    if not found.finished:
        raise typer.Exit(ExitStatus.LACKING)
