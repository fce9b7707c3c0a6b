"""``flexid design DRIVE``: an input that tells the coefficients apart, within limits."""

from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.options import AsJson


class Kind(StrEnum):
    """What is designed."""

    MULTISINE = "multisine"
    TRAJECTORY = "trajectory"


class Criterion(StrEnum):
    """What is made small."""

    E = "E"
    D = "D"


def design(
    drive: Annotated[Path, typer.Argument(help="TOML file: parameters, limits, sensors.")],
    out: Annotated[
        Path | None, typer.Option(help="Directory for command.csv, design.json and design.png.")
    ] = None,
    kind: Annotated[
        Kind | None, typer.Option(help="A torque to play, or a motor position to follow.")
    ] = None,
    criterion: Annotated[
        Criterion | None, typer.Option(help="E: the worst direction; D: the volume.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Length of the experiment in s.")] = None,
    estimate: Annotated[
        Path | None, typer.Option(help="estimate.json whose values replace the file's parameters.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the search's random starts.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Design an experiment that tells every coefficient, within limits, and check it.

    Exit status 0: every coefficient would be told to 10 % or better; 1: some would not, and the
    result says which; 2: bad input.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from flexid.experiment_design.design import STEPS
    from flexid.experiment_design.design import design as run
    from flexid.experiment_design.drive_file import read_drive
    from flexid.report.design_files import design_document, save_command
    from flexid.report.design_table import print_design
    from flexid.report.documents import output_directory, to_json

    given = {"kind": kind, "criterion": criterion, "duration": duration}
    choices = {
        name: value.value if isinstance(value, StrEnum) else value
        for name, value in given.items()
        if value is not None
    }
    file = read_drive(drive, estimate, choices)
    errors = Console(stderr=True)
    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with (
        nullcontext() if out is None else output_directory(out) as directory,
        Progress(*columns, console=errors, transient=True) as progress,
    ):
        task = progress.add_task("searching", total=STEPS)
        result = run(file, seed, lambda name: progress.update(task, advance=1, description=name))
        document = to_json(design_document(result))
        if directory is not None:
            from flexid.report.design_figures import save_design_figure

            (directory / "design.json").write_text(document, encoding="utf-8")
            save_command(result, directory)
            save_design_figure(result, directory)
    for warning in file.warnings:
        errors.print(f"warning: {warning}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_design(result)
    if not result.supported:
        raise typer.Exit(1)
