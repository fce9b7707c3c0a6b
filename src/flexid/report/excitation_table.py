"""The printed answer to what a log determines."""

from collections.abc import Iterator
from math import isfinite, isnan, pi

from rich.text import Text

from flexid.experiment_design.advice import Addition, Advice
from flexid.experiment_design.assessment import Assessment, CoefficientAssessment
from flexid.experiment_design.excitation_report import ExcitationReport
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.report.digits import value_cells
from flexid.report.style import STATUS_COLOURS
from flexid.report.terminal import Cell, Column, Part, Table

_MANY = 99  # times, beyond which a factor is no more than large
_LITTLE = 1e-4  # share below which one is no more than small


def excitation_parts(report: ExcitationReport) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield _table(report.assessment)
    for name, c in report.assessment.coefficients.items():
        if c.verdict != "determined":
            yield Text(f"  {name}: {c.reason}", style=STATUS_COLOURS[c.verdict])
    yield Text()
    for row, excitation in report.assessment.excitation.items():
        pair = " and ".join(excitation.correlated)
        detail = f"; {pair} correlate by {excitation.correlation:.3f}" if pair else ""
        yield Text(
            f"Excitation, {row} row: condition number {excitation.condition_number:.3g}{detail}"
        )
    noise = ", ".join(f"{name} {std:.3g} rad" for name, std in report.noise.items())
    yield Text(f"Residuals: {noise}")
    yield from map(Text, report.identification.summary)
    yield Text()
    for line in advice_lines(report.advice, report.input_unit):
        yield Text(line)


def _table(assessment: Assessment) -> Table:
    columns = (
        Column("coefficient"),
        Column("value", right=True),
        Column("unit"),
        Column("within", right=True),
        Column("alone", right=True, spare=2),
        Column("times", right=True, spare=1),
        Column("partner", spare=1),
        Column("verdict"),
    )
    table = Table("What this log says: 95 % intervals, and what the partner costs", columns)
    for name, c in assessment.coefficients.items():
        table.add(
            name,
            value_cells(c.value, *c.interval)[0],
            c.unit,
            c.reason if c.std == 0.0 else format_percent(c.width),
            "" if c.std == 0.0 or isnan(c.width_alone) else format_percent(c.width_alone),
            _cost(c),
            f"{c.partner} {c.correlation:+.2f}" if c.partner else "",
            Cell((c.verdict,), STATUS_COLOURS[c.verdict]),
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
    """A share as text, in percent.

    Examples
    --------
    >>> format_percent(0.01234), format_percent(3.7), format_percent(float("inf"))
    ('1.2 %', '370 %', 'unknown')
    """
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
    if advice.rule is not None:
        amplitude, rate = advice.rule
        yield (
            f"By rule of thumb, add a sine of {amplitude:.3g} {unit} at {_frequency(rate)}: the "
            f"log yields no model to try others on. Then look again."
        )
    else:
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
            f"No single sine of up to {advice.largest:.3g} {unit} added to this input is enough: "
            f"see flexid design."
        )
    elif advice.caution:
        yield "Another input does not remedy this:"
    else:
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
