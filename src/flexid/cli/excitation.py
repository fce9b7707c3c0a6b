"""``flexid excitation LOG...``: what a log can tell, and what to add."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.assignments import parse_known, parse_names
from flexid.cli.options import AsJson, Columns, Logs


def excitation(
    logs: Logs,
    columns: Columns = None,
    known: Annotated[
        list[str] | None,
        typer.Option(help="What is known, e.g. motor_inertia=0.3 (kg m²); may be repeated."),
    ] = None,
    terms: Annotated[
        str, typer.Option(help="Terms of the model beside the joint spring, comma-separated.")
    ] = "gravity,motor_viscous",
    hold: Annotated[
        str, typer.Option(help="Input between samples: zero (held), linear or auto.")
    ] = "auto",
    out: Annotated[
        Path | None, typer.Option(help="Directory for excitation.json and excitation.png.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say how well a log tells each coefficient, which are confounded, and what to add.

    Exit status 0: every coefficient can be told; 1: some cannot, and the result says which, why
    and what to add; 2: bad input.
    """
    from rich.console import Console

    from flexid.design.excitation_report import examine
    from flexid.identification.settings import Settings
    from flexid.recording.read import read_log
    from flexid.report.design_documents import excitation_document
    from flexid.report.documents import output_directory, to_json
    from flexid.report.excitation_table import print_excitation

    values, deviations = parse_known(known or [])
    settings = Settings(
        terms=parse_names(terms),
        known=values,
        known_deviations=deviations,
        hold=hold,  # type: ignore[arg-type] - Settings checks it
    )
    errors = Console(stderr=True)
    with (
        nullcontext() if out is None else output_directory(out) as directory,
        errors.status("Examining … (the first run on a machine compiles for up to a minute)"),
    ):
        report = examine([read_log(log, columns) for log in logs], settings)
        document = to_json(excitation_document(report))
        if directory is not None:
            from flexid.report.excitation_figures import save_excitation_figure

            (directory / "excitation.json").write_text(document, encoding="utf-8")
            save_excitation_figure(report, directory)
    for warning in report.warnings:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_excitation(report)
    if not report.supported:
        raise typer.Exit(1)
