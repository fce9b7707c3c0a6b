"""The result of an arm as tables, JSON and a figure."""

from collections.abc import Iterator

from flexid.arms.result import ArmIdentification
from flexid.models.motion import unit_of
from flexid.report.chart import Chart
from flexid.report.identification import estimates_table, verdict_reasons
from flexid.report.page import logs_of
from flexid.report.response_charts import free_run_chart
from flexid.report.terminal import Part
from flexid.report.validation import fits_table
from flexid.stored_estimates.estimate_file import estimate_document


def parts(result: ArmIdentification) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    for joint in range(1, result.arm.joints + 1):
        own = result.of_joint(joint)
        of_joint = {name.removesuffix(f"_{joint}"): p for name, p in own.items()}
        yield estimates_table(f"Joint {joint}", of_joint)
        yield from verdict_reasons(own)
    if result.validation.fit_percent:
        yield fits_table(result.validation)
    held = "held between samples" if result.hold == "zero" else "on straight lines between samples"
    delay = f", delayed by {1e3 * result.input_delay:.3g} ms" if result.input_delay else ""
    if result.disturbances is None:
        yield f"Input: {held}{delay}. Segments of {result.segment_duration:.2g} s."
    else:
        shares = ", ".join(f"{name} {100.0 * s:.2g} %" for name, s in result.disturbances.items())
        yield f"Input: {held}{delay}. Unexplained acceleration: {shares}."
        yield f"Fits without disturbances were rejected: {result.disturbed_because}."
    if result.encoder_delays:
        each = ", ".join(f"{row} {1e3 * x:.3g} ms" for row, x in result.encoder_delays.items())
        yield f"Delays of encoders relative to the others: {each}."
    for joint, (fall, exponent) in enumerate(result.arm.stribeck, 1):
        if f"motor_stribeck_friction_{joint}" in result.parameters:
            unit = unit_of("rad/s", result.arm.types[joint - 1])
            law = f"over {fall:.2g} {unit}, exponent {exponent:g}"
            yield f"Stribeck friction of motor {joint}: {law}."
    left = ", ".join(f"{name} {x:.2f}" for name, x in result.residual_excess.items())
    yield f"Residual over sensor noise (ideal: 1): {left}"
    yield f"Excitation: condition number {result.condition_number:.3g}"


def charts(result: ArmIdentification) -> list[Chart]:
    """Return the free run over the held-out data; none for a loaded estimate."""
    if not result.validation.runs:
        return []
    title = "Free run over the held-out data"
    return [free_run_chart("fit", title, result.validation, {}, result.arm.types)]


document = estimate_document


def heading(result: ArmIdentification) -> tuple[str, str]:
    """Return the number of joints, and the files."""
    joints = result.arm.joints
    title = f"Planar arm of {joints} joint{'s' if joints > 1 else ''}"
    return title, logs_of(result.provenance)
