"""``flexid identify LOG...``: the main job."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexid.cli.assignments import parse_bounds, parse_known, parse_names, parse_number
from flexid.cli.options import AsJson, Columns, Known, Logs

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.identification.result import Identification
    from flexid.identification.settings import Settings


def identify(
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
        str, typer.Option(help="Input between samples: zero (held), linear, cubic (smooth).")
    ] = "auto",
    input_delay: Annotated[
        str, typer.Option(help="Seconds by which the input acts later than recorded.")
    ] = "auto",
    link_delay: Annotated[
        str, typer.Option(help="Seconds by which the link encoder lags behind the motor's.")
    ] = "auto",
    coulomb_velocity: Annotated[
        str,
        typer.Option(
            help="Velocity in rad/s over which Coulomb friction changes sign; auto: at once."
        ),
    ] = "auto",
    filter_rate: Annotated[
        str, typer.Option(help="Rate in 1/s of the filter of least squares.")
    ] = "auto",
    segment_duration: Annotated[
        str, typer.Option(help="Segments of the prediction error in s.")
    ] = "auto",
    validation_share: Annotated[
        float, typer.Option(help="Share of each log, at its end, kept out for the free run.")
    ] = 1 / 3,
    stream: Annotated[
        bool,
        typer.Option(
            "--stream",
            help="Take one Parquet log of any length in one pass, in bounded memory, by least "
            "squares with choices made on its beginning.",
        ),
    ] = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Show the evidence for every choice.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Directory for estimate.json and the figures.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Identify a flexible joint: physical parameters with intervals and a verdict.

    What is auto is chosen from the log. With one encoder the joint is taken as rigid.

    Exit status 0: every coefficient is told by the data; 1: some are not, and the result says
    which and why; 2: bad input.
    """
    from rich.console import Console

    from flexid.identification.settings import Settings
    from flexid.report.documents import identification_document, output_directory, to_json
    from flexid.report.identification_table import print_identification

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
        filter_rate=parse_number("--filter-rate", filter_rate),
        segment_duration=parse_number("--segment-duration", segment_duration),
        validation_share=validation_share,
    )
    errors = Console(stderr=True)
    with nullcontext() if out is None else output_directory(out) as directory:
        if stream:
            from flexid.cli.streaming import identify_with_bar

            result = identify_with_bar(logs, columns, settings, errors)
        else:
            result = _identify_in_memory(logs, columns, settings, errors)
        document = to_json(identification_document(result))
        if directory is not None:
            from flexid.report.identification_figures import save_identification_figures

            with errors.status("drawing"):
                (directory / "estimate.json").write_text(document, encoding="utf-8")
                save_identification_figures(result, directory)
    for warning in result.warnings:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_identification(result, explain=explain)
    if not result.supported:
        raise typer.Exit(1)


def _identify_in_memory(
    logs: list[Path], columns: Path | None, settings: "Settings", errors: "Console"
) -> "Identification":
    from flexid.identification.identify import identify as run
    from flexid.recording.read import read_log

    with errors.status(
        "reading (the first run on a machine compiles for up to a minute)"
    ) as status:
        return run(
            [read_log(log, columns) for log in logs],
            settings,
            lambda step: status.update(f"identifying: {step}"),
        )
