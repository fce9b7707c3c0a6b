"""``flexid export ESTIMATE|MODEL --to TARGET``: code and files for other tools."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from flexid.cli.assignments import parse_names, parse_values
from flexid.cli.options import Columns, directory
from flexid.cli.output import print_warnings
from flexid.errors import SettingError
from flexid.exports.targets import TARGETS

EXAMPLES = (
    "export results/estimate.json --to c99 --sample-time 0.001 --out drive",
    "export flexible-joint --to c99 --log run.csv --out drive",
    "export results/estimate.json --to mjcf --out scene",
    "export results/estimate.json --to fmu --sample-time 0.001 --out units",
)


class Target(StrEnum):
    """What is written; as in `TARGETS`."""

    C99 = "c99"
    MJCF = "mjcf"
    FMU = "fmu"


class Hold(StrEnum):
    """The input between samples."""

    ZERO = "zero"
    LINEAR = "linear"


def export(
    what: Annotated[
        str,
        typer.Argument(
            metavar="ESTIMATE|MODEL",
            help="The estimate.json of flexid identify, a TOML model file, or flexible-joint.",
            show_default=False,
        ),
    ],
    to: Annotated[
        Target,
        typer.Option(
            help="; ".join(f"{name}: {target.summary}" for name, target in TARGETS.items()) + "."
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", parser=directory, help="Write the files here.")
    ],
    sample_time: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Time between samples; the log's if there is one."),
    ] = None,
    hold: Annotated[
        Hold | None,
        typer.Option(help="The input between samples; as identified, else zero."),
    ] = None,
    velocities: Annotated[
        bool, typer.Option("--velocities", help="Take measured velocities, too.")
    ] = False,
    gain: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Constant gain of a row or coefficient, as in the paper; needs --velocities. "
            "Not given: least squares. May be repeated.",
        ),
    ] = None,
    filter_rate: Annotated[
        float | None,
        typer.Option(
            metavar="1/S", help="Rate of the filter of positions; as identified, else 20."
        ),
    ] = None,
    memory_time: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Time after which a sample weighs 1/e as much; 60 if not given; inf: for ever.",
        ),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Make the test vector of this log.")
    ] = None,
    columns: Columns = None,
    terms: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Terms of flexible-joint, between commas."),
    ] = None,
) -> None:
    """Write an estimate or a model as code or files for another tool.

    c99 is the online estimator as one header and one source in C, with an example and a test
    vector. mjcf is the joint of an estimate as a scene for MuJoCo; what MuJoCo has no word for is
    left out, with a warning. fmu is the plant of an estimate and, with a sample time, the online
    estimator as FMUs for co-simulation, with sources and, where there is a compiler, compiled.

    Exit status: 0 when it is done, 2 for bad input.
    """
    from rich.console import Console

    from flexid.library.export import export as run

    if columns is not None and log is None:
        raise SettingError("--columns", "is for a log: name one with --log")
    options: dict[str, Any] = {
        "sample_time": sample_time,
        "hold": hold and hold.value,
        "velocities": velocities,
        "gain": parse_values("--gain", gain) if gain else None,
        "filter_rate": filter_rate,
        "memory_time": memory_time,
        "log": log,
        "columns": columns,
        "terms": None if terms is None else parse_names(terms),
    }
    errors = Console(stderr=True)
    with errors.status("exporting (the first run on a machine compiles for up to a minute)"):
        files = run(what, to=to.value, out=out, **options)
    print_warnings(files.warnings, errors)
    for path in files.paths:
        typer.echo(str(path))
