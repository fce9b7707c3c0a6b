"""``flexid design DRIVE``: an input that determines the coefficients, within limits."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.options import AsJson, out_option
from flexid.cli.output import hand_over, output, print_warnings

EXAMPLES = (
    "design examples/drive.toml --out results",
    "design examples/drive.toml --kind trajectory --duration 20",
)


class Kind(StrEnum):
    """What is designed."""

    MULTISINE = "multisine"
    TRAJECTORY = "trajectory"


class Criterion(StrEnum):
    """What is made small."""

    E = "E"
    D = "D"


def design(
    drive: Annotated[
        Path,
        typer.Argument(
            metavar="DRIVE", help="TOML file with parameters, limits, sensors.", show_default=False
        ),
    ],
    out: Annotated[Path | None, out_option("command.csv, design.json and design.png")] = None,
    kind: Annotated[
        Kind | None, typer.Option(help="Design a torque to play, or a motor position to follow.")
    ] = None,
    criterion: Annotated[
        Criterion | None,
        typer.Option(help="Make the worst direction small (E), or the volume (D)."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Length of the experiment.")
    ] = None,
    estimate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Take the parameters from this estimate.json of flexid identify."
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, metavar="NUMBER", help="Seed of the search's random starts.")
    ] = 0,
    as_json: AsJson = False,
) -> None:
    """Design a motion that determines the parameters.

    It keeps to the drive's limits, and is checked on drives that are wrong by 30 %.

    Exit status: 0 where every coefficient would be determined to 10 % or better; 1 where some would
    not, and the answer says which; 2 for bad input.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from flexid.experiment_design.design import STEPS
    from flexid.experiment_design.design import design as run
    from flexid.experiment_design.drive_file import read_drive
    from flexid.report.design_files import design_document
    from flexid.report.design_table import print_design

    given = {"kind": kind, "criterion": criterion, "duration": duration}
    choices = {
        name: value.value if isinstance(value, StrEnum) else value
        for name, value in given.items()
        if value is not None
    }
    file = read_drive(drive, estimate, choices)
    errors = Console(stderr=True)
    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with output(out) as directory:
        with Progress(
            *columns, console=errors, transient=True, disable=not errors.is_terminal
        ) as progress:
            task = progress.add_task("searching", total=STEPS)
            result = run(
                file, seed, lambda name: progress.update(task, advance=1, description=name)
            )
        document = design_document(result)

        def write(directory: Path) -> None:
            from flexid.report.charts.figure import save_charts
            from flexid.report.design_chart import design_chart
            from flexid.report.design_files import save_command
            from flexid.report.documents import to_json

            (directory / "design.json").write_text(to_json(document), encoding="utf-8")
            save_command(result, directory)
            save_charts([design_chart(result)], directory)

        print_warnings(file.warnings, errors)
        hand_over(
            document, lambda: print_design(result), write, as_json=as_json, directory=directory
        )
    if not result.supported:
        raise typer.Exit(ExitStatus.LACKING)
