"""``flexid identify LOG...``: the main job."""

from pathlib import Path
from typing import Annotated

import typer

from flexid.errors import SettingError


def identify(
    logs: Annotated[list[Path], typer.Argument(help="CSV or Parquet files of one drive.")],
    columns: Annotated[
        Path | None, typer.Option(help="TOML map that renames, scales and combines raw columns.")
    ] = None,
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
    filter_rate: Annotated[
        float | None, typer.Option(help="Rate of the filter in 1/s; chosen from the log if unset.")
    ] = None,
    validation_share: Annotated[
        float, typer.Option(help="Share of each log, at its end, kept out for the free run.")
    ] = 1 / 3,
    out: Annotated[
        Path | None, typer.Option(help="Directory for estimate.json and the figures.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Identify a flexible joint: physical parameters with intervals and a verdict.

    Exit status 0: every coefficient is told by the data; 1: some are not, and the result says
    which and why; 2: bad input.
    """
    from rich.console import Console

    from flexid.identification.identify import identify as run
    from flexid.identification.settings import Settings
    from flexid.recording.read import read_log
    from flexid.report.documents import identification_document, output_directory, to_json
    from flexid.report.identification_table import print_identification

    settings = Settings(
        terms=tuple(term.strip() for term in terms.split(",") if term.strip()),
        known=_parse_known(known or []),
        hold=hold,  # type: ignore[arg-type] - Settings checks it
        filter_rate=filter_rate,
        validation_share=validation_share,
    )
    errors = Console(stderr=True)
    with errors.status("Identifying … (the first run on a machine compiles for some seconds)"):
        result = run([read_log(log, columns) for log in logs], settings)
        document = to_json(identification_document(result))
        if out is not None:
            from flexid.report.identification_figures import save_identification_figures

            with output_directory(out) as directory:
                (directory / "estimate.json").write_text(document, encoding="utf-8")
                save_identification_figures(result, directory)
    for warning in result.warnings:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_identification(result)
    if not result.supported:
        raise typer.Exit(1)


def _parse_known(assignments: list[str]) -> dict[str, float]:
    known = {}
    for assignment in assignments:
        name, _, text = assignment.partition("=")
        try:
            known[name.strip()] = float(text)
        except ValueError:
            raise SettingError(
                "--known", f"{assignment!r} is no name=number, e.g. motor_inertia=0.3"
            ) from None
    return known
