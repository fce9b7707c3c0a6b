"""Arguments and options that several commands have in common."""

from pathlib import Path
from typing import Annotated

import typer

Logs = Annotated[list[Path], typer.Argument(help="CSV or Parquet files of one drive.")]

Columns = Annotated[
    Path | None, typer.Option(help="TOML map that renames, scales and combines raw columns.")
]

Known = Annotated[
    list[str] | None,
    typer.Option(help="What is known, e.g. motor_inertia=0.3 or 0.3+-0.01; may be repeated."),
]

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
