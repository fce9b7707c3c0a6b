"""``flexid validate ESTIMATE LOG...``: a stored estimate on logs that it was not made from."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.options import AsJson, Columns, Logs


def validate(
    estimate: Annotated[Path, typer.Argument(help="estimate.json of flexid identify.")],
    logs: Logs,
    columns: Columns = None,
    out: Annotated[
        Path | None, typer.Option(help="Directory for validation.json and validation.png.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Predict other logs of the same drive with an estimate as it is.

    Predictions begin all over each log, for 0.05, 0.2, 1 and 5 s, and once for all of it.

    Exit status 0: done; 2: bad input.
    """
    from rich.console import Console

    from flexid.identification.validate_estimate import validate_estimate
    from flexid.recording.read import read_log
    from flexid.report.documents import output_directory, to_json
    from flexid.report.validation_document import validation_document
    from flexid.report.validation_table import print_validation

    errors = Console(stderr=True)
    with nullcontext() if out is None else output_directory(out) as directory:
        with errors.status("predicting (the first run on a machine compiles for up to a minute)"):
            result = validate_estimate(estimate, [read_log(log, columns) for log in logs])
        document = to_json(validation_document(result))
        if directory is not None:
            from flexid.report.validation_figures import save_validation_figure

            (directory / "validation.json").write_text(document, encoding="utf-8")
            save_validation_figure(result, directory)
    for warning in result.warnings:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_validation(result)
