"""What a log determines, as a table, advice and JSON."""

from collections.abc import Iterator, Mapping
from math import isfinite, isnan, pi
from typing import Any

from rich.text import Text

from flexid.experiment_design.advice import Addition, Advice
from flexid.experiment_design.excitation_report import CoefficientAssessment, ExcitationReport
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.report.identification import excitation_lines, negligible_line, verdict_reasons
from flexid.report.page import Presenter, logs_of
from flexid.report.terminal import VERDICT_STYLES, Column, Part, Table, numbers, value_texts

_MANY = 99  # times, beyond which a factor is no more than large
_LITTLE = 1e-4  # share below which one is no more than small


def parts(report: ExcitationReport) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield _table(report.coefficients)
    yield from verdict_reasons(report.coefficients)
    yield from negligible_line(report.coefficients.values())
    yield ""
    yield from excitation_lines(report.identification.excitation)
    noise = ", ".join(f"{name} {std:.3g} rad" for name, std in report.noise.items())
    yield f"Residuals: {noise}"
    yield from report.identification.summary
    yield ""
    yield from advice_lines(report.advice, report.input_unit)


def _table(coefficients: Mapping[str, CoefficientAssessment]) -> Table:
    columns = (
        Column("name"),
        *numbers("value"),
        Column("unit", whole=True),
        *numbers("±", "factor"),
        Column("partner"),
        Column("verdict"),
    )
    title = "Half-widths (±) of 95 % intervals, and the factor by which the partner widens them"
    table = Table(title, columns)
    for name, c in coefficients.items():
        table.add(
            name,
            value_texts(c.value, *c.interval)[0],
            c.unit,
            c.reason if c.std == 0.0 else format_percent(c.width),
            _cost(c),
            f"{c.partner} {c.correlation:+.2f}" if c.partner else "",
            Text(c.verdict, VERDICT_STYLES[c.verdict]),
        )
    return table


def _cost(c: CoefficientAssessment) -> str:
    """How much wider the others make an interval; empty where that does not apply."""
    if c.std == 0.0 or (isnan(c.width_alone) and isfinite(c.width)):
        return ""
    if not isfinite(c.inflation):
        return "unknown"
    return _two_digits(c.inflation) if c.inflation < _MANY else f">{_MANY}"


def format_percent(share: float) -> str:
    """A share as text, in percent."""
    if not isfinite(share):
        return "unknown"
    return f"{_two_digits(100 * share)} %" if share >= _LITTLE else f"<{100 * _LITTLE:g} %"


def _two_digits(number: float) -> str:
    return f"{float(f'{number:.2g}'):g}"


def advice_lines(advice: Advice | None, unit: str) -> Iterator[str]:
    """What to add, in sentences."""
    if advice is None:
        yield "Nothing needs to be added: every coefficient is determined."
        return
    yield from _additions(advice, unit)
    if advice.caution:
        yield f"{advice.caution}."


def _additions(advice: Advice, unit: str) -> Iterator[str]:
    if advice.sine is not None:
        sine = advice.sine
        yield (
            f"Add a sine of {sine.amplitude:.3g} {unit} at {_frequency(sine.angular_frequency)}. "
            f"{_outcome(sine, unit)}"
        )
    elif advice.largest > 0.0:
        yield (
            f"No single sine of up to {advice.largest:.3g} {unit} added to this input is enough "
            f"within ten times this motion: see flexid design."
        )
    elif not advice.caution:
        yield "The input never moves: play one that does (see flexid design)."
    if advice.multiple is not None:
        multiple = advice.multiple
        yield (
            f"Or play the same input {multiple.amplitude:.3g} times as large. "
            f"{_outcome(multiple, unit)}"
        )
    if advice.longer is not None:
        yield f"Or record about {_two_digits(advice.longer)} s of the same motion."


def _frequency(rate: float) -> str:
    return f"{rate:.3g} rad/s ({rate / (2 * pi):.3g} Hz)"


def _outcome(addition: Addition, unit: str) -> str:
    goal = THRESHOLDS.determined_width
    kept = f", below {100 * goal:.0f} %" if addition.width <= goal else ", which is negligible"
    deflection = (
        f", deflection {addition.peak_deflection:.3g} rad" if addition.peak_deflection else ""
    )
    return (
        f"Then the worst, {addition.weakest}, is known within {format_percent(addition.width)}"
        f"{kept}; peaks: input {addition.peak_input:.3g} {unit}, position "
        f"{addition.peak_position:.3g} rad{deflection}."
    )


def heading(report: ExcitationReport) -> tuple[str, str]:
    """What is looked at, and the files."""
    return "What a log determines", logs_of(report.identification.provenance)


def document(report: ExcitationReport) -> dict[str, Any]:
    """What a log determines, and what to add, for JSON."""
    found = report.identification
    alignment = found.choices.alignment
    return {
        "model": found.model,
        "coefficients": report.coefficients,
        "excitation": {row: e.document for row, e in found.excitation.items()},
        "correlations": report.correlations,
        "advice": report.advice,
        "noise": report.noise,
        "residual_excess": found.residual_excess,
        "terms": found.choices.terms,
        "hold": found.choices.hold,
        "input_delay": alignment.input_delay,
        "link_delay": alignment.link_delay,
        "supported": found.supports(),
        "warnings": found.warnings,
        "provenance": found.provenance,
    }


PRESENTER = Presenter(heading, parts, document)
