"""``flexid excitation LOG...``: what a log can tell, and what to add."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.assignments import parse_bounds, parse_known, parse_names, parse_number
from flexid.cli.options import AsJson, Columns, Known, Logs


def excitation(
    logs: Logs,
    columns: Columns = None,
    known: Known = None,
    bounds: Annotated[
        list[str] | None,
        typer.Option(help="Ends of a coefficient, e.g. alpha2=0: or theta2=50:200; repeatable."),
    ] = None,
    terms: Annotated[
        str, typer.Option(help="Terms of the model beside the joint spring, comma-separated.")
    ] = "auto",
    hold: Annotated[
        str, typer.Option(help="Input between samples: zero (held), linear or cubic.")
    ] = "auto",
    input_delay: Annotated[
        str, typer.Option(help="Seconds by which the input acts later than recorded.")
    ] = "auto",
    link_delay: Annotated[
        str, typer.Option(help="Seconds by which the link encoder lags behind the motor's.")
    ] = "auto",
    coulomb_velocity: Annotated[
        str, typer.Option(help="Velocity in rad/s over which Coulomb friction changes sign.")
    ] = "auto",
    segment_duration: Annotated[
        str, typer.Option(help="Segments of the prediction error in s.")
    ] = "auto",
    out: Annotated[
        Path | None, typer.Option(help="Directory for excitation.json and excitation.png.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say how well a log tells each coefficient, which are confounded, and what to add.

    The log is identified as `flexid identify` does it, with the same answers.

    Exit status 0: every coefficient is told by the data; 1: some are not, and the result says
    which, why and what to add; 2: bad input.
    """
    from rich.console import Console

    from flexid.experiment_design.excitation_report import examine
    from flexid.identification.settings import Settings
    from flexid.recording.read import read_log
    from flexid.report.design_documents import excitation_document
    from flexid.report.documents import output_directory, to_json
    from flexid.report.excitation_table import print_excitation

    values, deviations = parse_known(known or [])
    settings = Settings(
        terms="auto" if terms == "auto" else parse_names(terms),
        known=values,
        known_deviations=deviations,
        bounds=parse_bounds(bounds or []),
        hold=hold,  # type: ignore[arg-type] - Settings checks it
        input_delay=parse_number("--input-delay", input_delay),
        link_delay=parse_number("--link-delay", link_delay),
        coulomb_velocity=parse_number("--coulomb-velocity", coulomb_velocity),
        segment_duration=parse_number("--segment-duration", segment_duration),
    )
    errors = Console(stderr=True)
    with nullcontext() if out is None else output_directory(out) as directory:
        with errors.status(
            "reading (the first run on a machine compiles for up to a minute)"
        ) as status:
            report = examine(
                [read_log(log, columns) for log in logs],
                settings,
                lambda step: status.update(f"examining: {step}"),
            )
        document = to_json(excitation_document(report))
        if directory is not None:
            from flexid.report.excitation_figures import save_excitation_figure

            (directory / "excitation.json").write_text(document, encoding="utf-8")
            save_excitation_figure(report, directory)
    for warning in report.identification.warnings:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_excitation(report)
    if not report.supported:
        raise typer.Exit(1)
