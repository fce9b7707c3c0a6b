"""The assessment of a log as a table, advice and JSON."""

from collections.abc import Iterator
from math import isfinite, isnan, pi
from typing import Any

from rich.text import Text

from flexid.experiment_design.excitation_report import (
    Advice,
    CoefficientAssessment,
    ExcitationReport,
)
from flexid.report.identification import excitation_lines, negligible_line, verdict_reasons
from flexid.report.page import logs_of
from flexid.report.terminal import UNIT, VERDICT_STYLES, Part, Table, number, numbers, value_texts

_LARGEST_FACTOR = 99  # larger factors are shown as ">99"
_SMALLEST_SHARE = 1e-4  # smaller shares are shown as "<0.01 %"


def parts(report: ExcitationReport) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    before, after = numbers("value"), numbers("±", "factor")
    columns = ("name", *before, UNIT, *after, "correlates with", "verdict")
    title = "Half-widths (±) of 95 % intervals; factors by which other unknowns widen them"
    table = Table(title, columns)
    for name, c in report.coefficients.items():
        table.add(
            name,
            value_texts(c.value, *c.interval)[0],
            c.unit,
            c.reason if c.std == 0.0 else format_percent(c.width),
            _inflation_text(c),
            f"{c.partner} {c.correlation:+.2f}" if c.partner else "",
            Text(c.verdict, VERDICT_STYLES[c.verdict]),
        )
    yield table
    yield from verdict_reasons(report.coefficients)
    yield from negligible_line(report.coefficients.values())
    yield ""
    yield from excitation_lines(report.identification.excitation)
    yield from report.identification.summary
    yield ""
    yield from advice_lines(report.advice)


def _inflation_text(c: CoefficientAssessment) -> str:
    """Return the factor by which other unknowns widen an interval; empty if undefined."""
    if c.std == 0.0 or (isnan(c.width_alone) and isfinite(c.width)):
        return ""
    if not isfinite(c.inflation):
        return "unknown"
    return number(c.inflation, 2) if c.inflation < _LARGEST_FACTOR else f">{_LARGEST_FACTOR}"


def format_percent(share: float) -> str:
    """Return a share as text, in per cent."""
    if not isfinite(share):
        return "unknown"
    return (
        number(100 * share, 2, "%") if share >= _SMALLEST_SHARE else f"<{100 * _SMALLEST_SHARE:g} %"
    )


def advice_lines(advice: Advice | None) -> Iterator[str]:
    """Return sentences on what the next motion should contain."""
    if advice is None:
        yield "The motion suffices: every coefficient is determined."
        return
    if advice.resonance is not None:
        hertz = advice.resonance / (2 * pi)
        yield (
            f"Add input near the joint's resonance, {advice.resonance:.3g} rad/s ({hertz:.3g} Hz), "
            f"with a small amplitude at first; or let flexid design --estimate find an input "
            f"within the limits of the drive."
        )
    elif not advice.caution:
        yield "Use a larger input, or one with more frequencies."
    if advice.longer is not None:
        yield f"Or record about {number(advice.longer, 2)} s of the same motion."
    if advice.caution:
        yield f"{advice.caution}."


def heading(report: ExcitationReport) -> tuple[str, str]:
    """Return the title, and the files."""
    return "What a log determines", logs_of(report.identification.provenance)


def document(report: ExcitationReport) -> dict[str, Any]:
    """Return the assessment of a log, for JSON."""
    found = report.identification
    alignment = found.choices.alignment
    return {
        "model": found.model,
        "coefficients": report.coefficients,
        "excitation": {row: e.document for row, e in found.excitation.items()},
        "correlations": report.correlations,
        "advice": report.advice,
        "residual_excess": found.residual_excess,
        "terms": found.choices.terms,
        "hold": found.choices.hold,
        "input_delay": alignment.input_delay,
        "link_delay": alignment.link_delay,
        "supported": found.supports(),
        "warnings": found.warnings,
        "provenance": found.provenance,
    }
