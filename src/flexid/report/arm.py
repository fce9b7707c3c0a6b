"""The result of an arm as tables, JSON and a page."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from flexid.arms.result import ArmIdentification
from flexid.report.chart import Chart
from flexid.report.identification import estimates_table, verdict_reasons
from flexid.report.page import Answer, Page, Presenter, Section, drawn, sections_of
from flexid.report.response_charts import free_run_chart
from flexid.report.terminal import Part, Table
from flexid.report.validation import fits_table
from flexid.stored_estimates.estimate_file import estimate_document


def parts(result: ArmIdentification) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    for joint in range(1, result.arm.joints + 1):
        yield joint_table(result, joint)
        yield from verdict_reasons(result.of_joint(joint))
    yield from prediction_parts(result)


def joint_table(result: ArmIdentification, joint: int) -> Table:
    """The parameters of one joint."""
    own = result.of_joint(joint).items()
    return estimates_table(f"Joint {joint}", {n.removesuffix(f"_{joint}"): p for n, p in own})


def prediction_parts(result: ArmIdentification) -> Iterator[Part]:
    """How the held-out data are predicted, and what that rests on."""
    if result.validation.fit_percent:
        yield fits_table(result.validation)
    yield from timing_lines(result)


def timing_lines(result: ArmIdentification) -> Iterator[str]:
    """How the input lies in time, what is left over, and how alike parameters look."""
    held = "held between samples" if result.hold == "zero" else "on straight lines between samples"
    late = f", {1e3 * result.input_delay:.3g} ms late" if result.input_delay else ""
    if result.disturbances is None:
        yield f"Input: {held}{late}. Segments of {result.segment_duration:.2g} s."
    else:
        shares = ", ".join(f"{name} {100.0 * s:.2g} %" for name, s in result.disturbances.items())
        yield f"Input: {held}{late}. Fitted with disturbances: of the acceleration, {shares}."
        yield f"Fits without disturbances were left out: {result.disturbed_because}."
    if result.encoder_delays:
        each = ", ".join(f"{row} {1e3 * x:.3g} ms" for row, x in result.encoder_delays.items())
        yield f"Link encoders later than the motors': {each}."
    left = ", ".join(f"{name} {x:.2f}" for name, x in result.residual_excess.items())
    yield f"Residual over the encoders' noise: {left}"
    yield f"Excitation: condition number {result.condition_number:.3g}"


def charts(result: ArmIdentification) -> list[Chart]:
    """The free run over the held-out data, of an arm that was identified just now."""
    if not result.validation.runs:
        return []
    return [free_run_chart("fit", "Free run over the held-out data", result.validation, {})]


def page(
    result: ArmIdentification, charts: Sequence[Chart], command: str = "", _out: str = ""
) -> Page:
    """What there is to say of an arm."""
    joints = range(1, result.arm.joints + 1)
    sections = [
        Section(
            f"joint-{joint}",
            f"Joint {joint}",
            [joint_table(result, joint), *verdict_reasons(result.of_joint(joint))],
        )
        for joint in joints[1:]
    ]
    predicted = [*prediction_parts(result), *drawn(charts, "fit")]
    sections.append(Section("prediction", "Prediction", predicted))
    logs = [Path(log["file"]).name for log in result.provenance["inputs"]]
    return Page(
        "identification",
        f"Planar arm of {result.arm.joints} joint{'s' if len(joints) > 1 else ''}",
        ", ".join(logs),
        joint_table(result, 1),
        (_trust(result, joints),),
        sections_of(result.warnings, sections, command),
    )


def _trust(result: ArmIdentification, joints: Iterable[int]) -> Answer:
    lacking = [p.name for p in result.parameters.values() if p.verdict != "determined"]
    word = "Not all of them" if lacking else "Yes"
    said = [f"Not determined or weak: {', '.join(lacking)}."] if lacking else []
    for joint in joints:
        share = result.validation.fit_percent.get(f"deflection_{joint}")
        if share is not None:
            said.append(f"A free run explains {share:.1f} % of deflection {joint}.")
    return Answer("Can these numbers be trusted?", word, "fair" if lacking else "good", said)


PRESENTER = Presenter(parts, estimate_document, charts, page=page)
