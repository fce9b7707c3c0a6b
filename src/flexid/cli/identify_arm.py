"""``flexid identify LOG --model arm.toml``: an arm of several elastic joints."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.output import as_typed, hand_over, output, print_warnings

if TYPE_CHECKING:
    from rich.console import Console


def identify_arm(
    log: Path,
    arm: Path,
    columns: Path | None,
    errors: "Console",
    *,
    strict: bool,
    out: Path | None,
    as_json: bool,
) -> None:
    """Identify an arm, print its tables, and write its files."""
    from flexid.arms.identify import identify_arm as run
    from flexid.models.arm_file import read_arm
    from flexid.report.arm_document import arm_document
    from flexid.report.arm_table import print_arm

    with output(out) as directory:
        with errors.status("reading (the first arm on a machine compiles for a minute)") as status:
            known = read_arm(arm)
            result = run(log, known, columns, lambda step: status.update(f"identifying: {step}"))
        document = arm_document(result)

        def write(directory: Path) -> None:
            from flexid.report.documents import to_json
            from flexid.report.page.arm_page import arm_page
            from flexid.report.page.render import save_page

            (directory / "estimate.json").write_text(to_json(document), encoding="utf-8")
            save_page(arm_page(result, as_typed()), directory)

        print_warnings(result.warnings, errors)
        hand_over(document, lambda: print_arm(result), write, as_json=as_json, directory=directory)
    if not result.supports(strict=strict):
        raise typer.Exit(ExitStatus.LACKING)
