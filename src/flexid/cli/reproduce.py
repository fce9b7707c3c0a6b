"""``flexid reproduce``: the paper, run and checked claim by claim."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer


def reproduce(
    out: Annotated[
        Path | None, typer.Option(help="Directory for result.json and the figures.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Reproduce Huang (2003): Table I, Figures 1 to 5, the readings, every claim.

    Exit status 0 whatever the claims come to; 2: the directory cannot be written.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from flexid.report.documents import output_directory, to_json
    from flexid.report.huang2003_document import reproduction_document
    from flexid.report.huang2003_table import print_reproduction
    from flexid.studies.huang2003.reproduction import STEPS
    from flexid.studies.huang2003.reproduction import reproduce as run

    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with (
        nullcontext() if out is None else output_directory(out) as directory,
        Progress(*columns, console=Console(stderr=True), transient=True) as progress,
    ):
        task = progress.add_task("loading", total=STEPS + (directory is not None))

        def finished(name: str) -> None:
            progress.update(task, advance=1, description=name)

        result = run(finished)
        document = to_json(reproduction_document(result))
        if directory is not None:
            from flexid.report.huang2003_figures import save_reproduction_figures

            (directory / "result.json").write_text(document, encoding="utf-8")
            save_reproduction_figures(result, directory)
            finished("figures")
    if as_json:
        typer.echo(document, nl=False)
    else:
        print_reproduction(result)
