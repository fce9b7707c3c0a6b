"""``flexid identify LOG...``: the main job."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.options import AsJson, Columns, Logs, Strict, out_option, with_settings
from flexid.cli.output import as_typed, hand_over, output, print_warnings
from flexid.errors import SettingError

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.identification.preparation.settings import Settings
    from flexid.identification.result.identification import Identification
    from flexid.recording.recording import Log

EXAMPLES = (
    "identify examples/flexible_joint.csv --out results",
    "identify run1.csv run2.csv --known motor_inertia=0.3+-0.01",
    "identify arm.csv --columns map.toml --bounds joint_stiffness=50:200",
    "identify day.parquet --stream --strict",
    "identify run.csv --model arm.toml",
)


@with_settings
def identify(
    logs: Logs,
    settings: "Settings",
    columns: Columns = None,
    stream: Annotated[
        bool,
        typer.Option(
            "--stream",
            help="Take one Parquet log of any length in one pass and in bounded memory, by least "
            "squares, with choices made on its beginning.",
        ),
    ] = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Show the evidence for every choice.")
    ] = False,
    strict: Strict = False,
    out: Annotated[Path | None, out_option("report.html, estimate.json and the figures")] = None,
    as_json: AsJson = False,
    arm: Path | None = None,
) -> None:
    """Find a drive's parameters, with intervals and verdicts.

    The logs are of one drive with an elastic joint: two encoders and the motor's torque, voltage or
    current. With one encoder the joint is taken as rigid; without any input the link is identified
    alone, driven by the motor's motion. What is auto is chosen from the logs. A planar arm of
    several elastic joints is described by a TOML file after --model, and its channels are numbered.

    Exit status: 0 where every parameter is determined, be it weakly; 1 where one is not, and the
    answer says which and why; with --strict, 1 where one is weak, too; 2 for bad input.
    """
    from rich.console import Console

    from flexid.report.documents import identification_document
    from flexid.report.identification_table import print_identification

    errors = Console(stderr=True)
    if arm is not None:
        from flexid.cli.identify_arm import identify_arm

        _check_for_arm(logs, stream=stream, explain=explain)
        identify_arm(logs[0], arm, columns, errors, strict=strict, out=out, as_json=as_json)
        return
    with output(out) as directory:
        if stream:
            from flexid.cli.streaming import identify_with_bar

            result, read = identify_with_bar(logs, columns, settings, errors), []
        else:
            result, read = _identify_in_memory(logs, columns, settings, errors)
        document = identification_document(result)

        def show() -> None:
            print_identification(result, explain=explain)

        def write(directory: Path) -> None:
            from flexid.report.charts.figure import save_charts
            from flexid.report.documents import to_json
            from flexid.report.identification_charts import identification_charts
            from flexid.report.page.identification_page import identification_page
            from flexid.report.page.render import save_page

            with errors.status("drawing"):
                (directory / "estimate.json").write_text(to_json(document), encoding="utf-8")
                charts = identification_charts(result)
                save_charts(charts, directory)
                advice = _advice(result, read, settings)
                stored = shlex.quote(str(Path(str(out)) / "estimate.json"))
                page = identification_page(result, charts, as_typed(), stored, advice)
                save_page(page, directory)

        print_warnings(result.warnings, errors, "" if explain else "--explain")
        hand_over(document, show, write, as_json=as_json, directory=directory)
    if not result.supports(strict=strict):
        raise typer.Exit(ExitStatus.LACKING)


def _check_for_arm(logs: list[Path], *, stream: bool, explain: bool) -> None:
    """Raise `SettingError` for what is for one joint alone."""
    if len(logs) > 1:
        raise SettingError("LOG", f"an arm takes one log, and {len(logs)} were given: give one")
    for name, given in (("stream", stream), ("explain", explain)):
        if given:
            raise SettingError(name, "is for one joint, and --model names an arm: leave it out")


def _advice(result: "Identification", logs: "list[Log]", settings: "Settings") -> list[str]:
    """What motion would determine more, where something is lacking: it takes some seconds."""
    if result.verdict == "determined" or not logs:
        return []
    from flexid.experiment_design.excitation_report import look_into
    from flexid.report.excitation_table import advice_lines

    found = look_into(result, logs, settings)
    return [*advice_lines(found.advice, found.input_unit)]


def _identify_in_memory(
    logs: list[Path], columns: Path | None, settings: "Settings", errors: "Console"
) -> "tuple[Identification, list[Log]]":
    from flexid.identification.identify import identify as run
    from flexid.recording.read import read_log

    with errors.status(
        "reading (the first run on a machine compiles for up to a minute)"
    ) as status:
        read = [read_log(log, columns) for log in logs]
        return run(read, settings, lambda step: status.update(f"identifying: {step}")), read
