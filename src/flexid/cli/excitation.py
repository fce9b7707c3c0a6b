"""``flexid excitation LOG...``: what a log determines, and what to add."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.options import AsJson, Columns, Logs, Strict, out_option, with_settings
from flexid.cli.output import hand_over, output, print_warnings

if TYPE_CHECKING:
    from flexid.identification.preparation.settings import Settings

EXAMPLES = (
    "excitation examples/flexible_joint.csv",
    "excitation run1.csv --known motor_inertia=0.3 --out results",
)


@with_settings
def excitation(
    logs: Logs,
    settings: "Settings",
    columns: Columns = None,
    strict: Strict = False,
    out: Annotated[Path | None, out_option("excitation.json and excitation.png")] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a log determines, and what motion to add.

    The log is identified as flexid identify does it, with the same answers. Added is what each
    coefficient is confused with, and which sine would help.

    Exit status: as of flexid identify.
    """
    from rich.console import Console

    from flexid.experiment_design.excitation_report import examine
    from flexid.recording.read import read_log
    from flexid.report.design_documents import excitation_document
    from flexid.report.excitation_table import print_excitation

    errors = Console(stderr=True)
    with output(out) as directory:
        with errors.status(
            "reading (the first run on a machine compiles for up to a minute)"
        ) as status:
            report = examine(
                [read_log(log, columns) for log in logs],
                settings,
                lambda step: status.update(f"examining: {step}"),
            )
        document = excitation_document(report)

        def write(directory: Path) -> None:
            from flexid.report.charts.figure import save_charts
            from flexid.report.documents import to_json
            from flexid.report.excitation_report_chart import excitation_report_chart

            (directory / "excitation.json").write_text(to_json(document), encoding="utf-8")
            save_charts([excitation_report_chart(report)], directory)

        print_warnings(report.identification.warnings, errors, "flexid identify --explain")
        hand_over(
            document,
            lambda: print_excitation(report),
            write,
            as_json=as_json,
            directory=directory,
        )
    if not report.identification.supports(strict=strict):
        raise typer.Exit(ExitStatus.LACKING)
