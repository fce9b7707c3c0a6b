"""The printed answer for an arm: one table per joint."""

from collections.abc import Iterator

from rich.text import Text

from flexid.arms.result import ArmIdentification, ArmParameter
from flexid.identification.vocabulary.evidence import Verdict
from flexid.report.digits import value_cells
from flexid.report.terminal import Cell, Column, Part, Table, numbers

_COLOURS: dict[Verdict, str] = {"determined": "green", "weak": "yellow", "undetermined": "red"}


def arm_parts(result: ArmIdentification) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    for joint in range(1, result.arm.joints + 1):
        yield joint_table(result, joint)
        yield from reasons(result.of_joint(joint))
    yield free_run_table(result)
    yield from map(Text, timing_lines(result))


def joint_table(result: ArmIdentification, joint: int) -> Table:
    """The parameters of one joint."""
    columns = (
        Column("name"),
        *numbers("value", "95 % interval"),
        Column("unit"),
        Column("verdict"),
    )
    table = Table(f"Joint {joint}", columns)
    for p in result.of_joint(joint):
        cells = value_cells(p.value, *p.interval)
        table.add(
            p.name.removesuffix(f"_{joint}"),
            *cells,
            p.unit,
            Cell((p.verdict,), _COLOURS[p.verdict]),
        )
    return table


def reasons(parameters: list[ArmParameter]) -> Iterator[Text]:
    """Why parameters are not determined, a line each."""
    for p in parameters:
        if p.verdict != "determined":
            yield Text(f"  {p.name}: {p.reason}", style=_COLOURS[p.verdict])


def free_run_table(result: ArmIdentification) -> Table:
    """How much of the last third a free run explains, joint by joint."""
    title = "Free run over the last third, from a fit to the rest (% explained)"
    table = Table(title, (Column("joint"), *numbers("motor", "link", "deflection")))
    for joint in range(1, result.arm.joints + 1):
        shares = (result.free_run.get(f"{c}_{joint}") for c in ("motor", "link", "deflection"))
        table.add(str(joint), *("not tested" if s is None else f"{s:.2f}" for s in shares))
    return table


def timing_lines(result: ArmIdentification) -> Iterator[str]:
    """How the input lies in time, what is left over, and how alike parameters look."""
    held = "held between samples" if result.hold == "zero" else "on straight lines between samples"
    late = f", {1e3 * result.input_delay:.3g} ms late" if result.input_delay else ""
    yield f"Input: {held}{late}. Segments of {result.segment_duration:.2g} s."
    left = ", ".join(f"{name} {x:.2f}" for name, x in result.residual_excess.items())
    yield f"Residual over the encoders' noise: {left}"
    yield f"Excitation: condition number {result.condition_number:.3g}"
