"""``flexid simulate EXPERIMENT``: one run of an experiment file."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.assignments import parse_values
from flexid.errors import SimulationError


def simulate(
    experiment: Annotated[Path, typer.Argument(help="TOML file, e.g. experiments/huang2003.toml.")],
    out: Annotated[
        Path | None, typer.Option(help="Directory for run.parquet, log.parquet, run.json, figures.")
    ] = None,
    values: Annotated[
        list[str] | None,
        typer.Option("--set", help="PATH=VALUE in the file, e.g. controller.k=30; repeatable."),
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write the time series as CSV too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Simulate an experiment: plant, controller and observer, with all values from a file.

    Exit status 0: the run is done; 1: it diverges or cannot meet its tolerance; 2: bad input.
    """
    from rich.console import Console

    from flexid.experiments import read_experiment
    from flexid.experiments.measures import measure
    from flexid.report.documents import output_directory, to_json
    from flexid.report.run_document import run_document
    from flexid.report.run_table import print_run

    chosen = read_experiment(experiment).with_values(parse_values("--set", values or []))
    with (
        nullcontext() if out is None else output_directory(out) as directory,
        Console(stderr=True).status(
            "simulating (the first run on a machine compiles for up to a minute)"
        ) as status,
    ):
        try:
            run = chosen.run()
        except SimulationError as error:
            typer.echo(f"flexid: {error}", err=True)
            raise typer.Exit(1) from None
        measures = measure(run)
        document = to_json(run_document(chosen, run, measures))
        if directory is not None:
            from flexid.report.run_figures import save_run_figures
            from flexid.report.run_series import save_run_series

            status.update("writing")
            (directory / "run.json").write_text(document, encoding="utf-8")
            save_run_series(run, directory, csv)
            save_run_figures(chosen.name, run, directory)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_run(chosen, run, measures)
