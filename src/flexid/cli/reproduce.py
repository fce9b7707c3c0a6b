"""``flexid reproduce``: the paper, run and checked claim by claim."""

from pathlib import Path
from typing import Annotated

from flexid.cli.options import AsJson, out_option
from flexid.cli.output import hand_over, output

EXAMPLES = ("reproduce --out results",)


def reproduce(
    out: Annotated[Path | None, out_option("report.html, result.json and the figures")] = None,
    as_json: AsJson = False,
) -> None:
    """Reproduce the paper, and check its claims.

    Huang (2003): Table I, Figures 1 to 5, both readings of its control law, and every claim.

    Exit status: 0 whatever the claims come to, 2 where the directory cannot be written.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from flexid.report.huang2003_document import reproduction_document
    from flexid.report.huang2003_table import print_reproduction
    from flexid.studies.huang2003.reproduction import STEPS
    from flexid.studies.huang2003.reproduction import reproduce as run

    errors = Console(stderr=True)
    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with output(out) as directory:
        with Progress(
            *columns, console=errors, transient=True, disable=not errors.is_terminal
        ) as progress:
            task = progress.add_task("loading", total=STEPS)
            result = run(lambda name: progress.update(task, advance=1, description=name))
        document = reproduction_document(result)

        def write(directory: Path) -> None:
            from flexid.report.charts.figure import save_charts
            from flexid.report.documents import to_json
            from flexid.report.huang2003_charts import FORMATS, reproduction_charts
            from flexid.report.page.render import save_page
            from flexid.report.page.reproduction_page import reproduction_page

            with errors.status("drawing"):
                (directory / "result.json").write_text(to_json(document), encoding="utf-8")
                charts = reproduction_charts(result)
                save_charts(charts, directory, FORMATS)
                save_page(reproduction_page(result, charts), directory)

        hand_over(
            document,
            lambda: print_reproduction(result),
            write,
            as_json=as_json,
            directory=directory,
        )
