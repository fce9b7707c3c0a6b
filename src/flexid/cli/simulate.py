"""``flexid simulate EXPERIMENT``: one run of an experiment file."""

from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.assignments import parse_values
from flexid.cli.options import AsJson, out_option
from flexid.cli.output import as_typed, hand_over, output
from flexid.errors import SettingError

EXAMPLES = (
    "simulate experiments/sampled_joint.toml --out run",
    "simulate experiments/huang2003.toml --set controller.k=30",
)


def simulate(
    experiment: Annotated[
        Path, typer.Argument(metavar="EXPERIMENT", help="TOML file.", show_default=False)
    ],
    out: Annotated[
        Path | None, out_option("report.html, run.json, run.parquet, log.parquet, figures")
    ] = None,
    values: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Replace a number of the file, e.g. controller.k=30. May be repeated.",
        ),
    ] = None,
    csv: Annotated[
        bool, typer.Option("--csv", help="Write the time series as CSV, too; needs --out.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a closed loop with an observer, from a file.

    Plant, controller, reference, observer, sensors and noise stand in the experiment file.

    Exit status: 0 when the run is done; 1 where it diverges or cannot meet its tolerance; 2 for bad
    input.
    """
    if csv and out is None:
        raise SettingError("--csv", "has nowhere to write: name a directory with --out")
    from rich.console import Console

    from flexid.experiments import read_experiment
    from flexid.experiments.measures import measure
    from flexid.report.run_document import run_document
    from flexid.report.run_table import print_run

    chosen = read_experiment(experiment).with_values(parse_values("--set", values or []))
    with output(out) as directory:
        with Console(stderr=True).status(
            "simulating (the first run on a machine compiles for up to a minute)"
        ):
            run = chosen.run()
        measures = measure(run)
        document = run_document(chosen, run, measures)

        def write(directory: Path) -> None:
            from flexid.report.charts.figure import save_charts
            from flexid.report.documents import to_json
            from flexid.report.page.render import save_page
            from flexid.report.page.run_page import run_page
            from flexid.report.run_charts import run_charts
            from flexid.report.run_series import save_run_series

            (directory / "run.json").write_text(to_json(document), encoding="utf-8")
            save_run_series(run, directory, csv)
            charts = run_charts(chosen.name, run)
            save_charts(charts, directory)
            log = str(Path(str(out)) / "log.parquet")
            save_page(run_page(chosen, run, measures, charts, as_typed(), log), directory)

        hand_over(
            document,
            lambda: print_run(chosen, run, measures),
            write,
            as_json=as_json,
            directory=directory,
        )
