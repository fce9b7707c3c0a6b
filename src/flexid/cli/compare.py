"""``flexid compare A B``: two estimates side by side."""

from pathlib import Path
from typing import Annotated

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.options import AsJson, out_option
from flexid.cli.output import as_typed, hand_over, output, print_warnings

EXAMPLES = (
    "compare before/estimate.json after/estimate.json",
    "compare drive1 drive2 --out differences",
    "compare before after --json",
)


def compare(
    a: Annotated[
        Path,
        typer.Argument(
            metavar="A",
            help="An estimate.json of flexid identify, or the folder that holds it.",
            show_default=False,
        ),
    ],
    b: Annotated[
        Path,
        typer.Argument(metavar="B", help="Another, of which A is subtracted.", show_default=False),
    ],
    out: Annotated[
        Path | None, out_option("comparison.json, comparison.png and report.html")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare two estimates: what has changed, and how surely.

    Before and after a repair, two drives of a batch, two settings on one log. Each difference has
    an interval; what is called changed has to be so beside everything else that is compared.

    Exit status: 0 where everything was compared and nothing is seen to have changed; 1 where
    something has changed, or is not determined in both, and the answer says what; 2 for bad input.
    """
    from rich.console import Console

    from flexid.comparisons.comparison import compare_estimates
    from flexid.report.comparison_document import comparison_document
    from flexid.report.comparison_table import print_comparison
    from flexid.stored_estimates.estimate_file import read_estimate, stored_identification

    errors = Console(stderr=True)
    with output(out) as directory:
        files = read_estimate(a), read_estimate(b)
        first, second = (stored_identification(file) for file in files)
        comparison = compare_estimates(first, second, (files[0].name, files[1].name))
        document = comparison_document(comparison)

        def write(directory: Path) -> None:
            from flexid.report.charts.figure import save_charts
            from flexid.report.comparison_chart import comparison_chart
            from flexid.report.documents import to_json
            from flexid.report.page.comparison_page import comparison_page
            from flexid.report.page.render import save_page

            (directory / "comparison.json").write_text(to_json(document), encoding="utf-8")
            save_charts([comparison_chart(comparison)], directory)
            save_page(comparison_page(comparison, as_typed()), directory)

        print_warnings(comparison.warnings, errors)
        hand_over(
            document,
            lambda: print_comparison(comparison),
            write,
            as_json=as_json,
            directory=directory,
        )
    if not comparison.agree:
        raise typer.Exit(ExitStatus.LACKING)
