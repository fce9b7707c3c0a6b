"""``flexid validate ESTIMATE LOG...``: a stored estimate on logs that it was not made from."""

from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.options import AsJson, Columns, Logs, out_option
from flexid.cli.output import as_typed, hand_over, output, print_warnings

EXAMPLES = ("validate results/estimate.json run3.csv --out results",)


def validate(
    estimate: Annotated[
        Path,
        typer.Argument(
            metavar="ESTIMATE", help="The estimate.json of flexid identify.", show_default=False
        ),
    ],
    logs: Logs,
    columns: Columns = None,
    out: Annotated[Path | None, out_option("report.html, validation.json and a figure")] = None,
    as_json: AsJson = False,
) -> None:
    """Predict other logs of the same drive with an estimate.

    Predictions begin all over each log, for 0.05, 0.2, 1 and 5 s, and once for all of it.

    Exit status: 0 when it is done, 2 for bad input.
    """
    from rich.console import Console

    from flexid.recording.read import read_log
    from flexid.report.validation_document import validation_document
    from flexid.report.validation_table import print_validation
    from flexid.stored_estimates.validate_estimate import validate_estimate

    errors = Console(stderr=True)
    with output(out) as directory:
        with errors.status("predicting (the first run on a machine compiles for up to a minute)"):
            result = validate_estimate(estimate, [read_log(log, columns) for log in logs])
        document = validation_document(result)

        def write(directory: Path) -> None:
            from flexid.report.charts.figure import save_charts
            from flexid.report.documents import to_json
            from flexid.report.page.render import save_page
            from flexid.report.page.validation_page import validation_page
            from flexid.report.residual_chart import residual_chart
            from flexid.report.validation_chart import validation_chart

            (directory / "validation.json").write_text(to_json(document), encoding="utf-8")
            fit = validation_chart(result)
            save_charts([fit], directory)
            charts = (fit, residual_chart(result))
            save_page(validation_page(result, charts, as_typed()), directory)

        print_warnings(result.warnings, errors, "--json")
        hand_over(
            document,
            lambda: print_validation(result),
            write,
            as_json=as_json,
            directory=directory,
        )
