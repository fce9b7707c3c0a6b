"""Chart of what a log can tell: widths of intervals, and where the input has its power."""

from collections.abc import Sequence

import numpy as np

from flexid.experiment_design.assessment import CoefficientAssessment
from flexid.experiment_design.excitation_report import ExcitationReport
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.report.charts.description import (
    VERDICT_COLOURS,
    Axis,
    Chart,
    Level,
    Line,
    Mark,
    Panel,
    Points,
)
from flexid.report.charts.limits import whole_decades

_UNKNOWN = 10.0  # drawn for a width that is infinite
_FLOOR = 1e-3  # of the spectrum, over its largest amplitude
_HEIGHT = 1.5


def excitation_report_chart(report: ExcitationReport) -> Chart:
    """Widths of intervals on the left, the input's tones on the right."""
    coefficients = [c for c in report.assessment.coefficients.values() if c.std > 0.0]
    panels = _widths(coefficients), _spectrum(report)
    title = "What the log determines, and the tones of its input"
    return Chart("excitation", title, _says(coefficients), panels, columns=2, linked=False)


def _says(coefficients: Sequence[CoefficientAssessment]) -> str:
    says = (
        "Each line ends at a coefficient's interval, and begins where it would be if all others "
        "were known: a long line means correlation with another coefficient."
    )
    if coefficients:
        order = [*VERDICT_COLOURS]  # from the best verdict to the worst
        worst = max(coefficients, key=lambda c: (order.index(c.verdict), c.width))
        partner = f", most with {worst.partner}" if worst.partner else ""
        says += f" The worst is {worst.name}, {worst.verdict}{partner}."
    return says


def _widths(coefficients: Sequence[CoefficientAssessment]) -> Panel:
    """Half the interval of each coefficient over its value, and what it would be alone."""
    places = np.arange(float(len(coefficients)))
    shown = np.minimum([c.width for c in coefficients], _UNKNOWN)
    alone = np.array([c.width_alone for c in coefficients])
    alone = np.where(np.isnan(alone), shown, np.minimum(alone, _UNKNOWN))
    gaps = np.full(len(places), np.nan)
    between = np.column_stack([alone, shown, gaps]).ravel()
    marks: list[Mark] = [
        Line("", between, np.repeat(places, 3), "grey", 1.5),
        Points("if all others were known", alone, places, "grey", 4.5),
    ]
    for verdict, colour in VERDICT_COLOURS.items():
        such = np.array([c.verdict == verdict for c in coefficients], dtype=bool)
        if such.any():
            marks.append(Points(f"as it is: {verdict}", shown[such], places[such], colour, 6.5))
    limits = THRESHOLDS.determined_width, THRESHOLDS.weak_width
    marks.append(Level("weak from here", limits[0], "x", "orange", "dashed"))
    marks.append(Level("undetermined from here", limits[1], "x", "red", "dashed"))
    clipped = "; cut off at 10" if (shown >= _UNKNOWN).any() else ""
    lowest, _ = whole_decades(np.concatenate([alone, shown, limits]))
    ends = lowest, 2.0 * float(max(shown.max(initial=0.0), limits[1]))
    return Panel(
        f"Intervals{clipped}",
        Axis("half the 95 % interval over the value", "–", logarithmic=True, limits=ends),
        Axis("", categories=tuple(c.name for c in coefficients)),
        tuple(marks),
        _HEIGHT,
    )


def _spectrum(report: ExcitationReport) -> Panel:
    """Amplitudes of the input over angular frequency, and the tone to add."""
    rates, amplitudes = report.spectrum
    largest = float(amplitudes.max())
    last = int(np.flatnonzero(amplitudes > _FLOOR * largest).max(initial=0)) + 1
    marks: list[Mark] = [Line("input of the log", rates[:last], amplitudes[:last], "blue")]
    ends = [rates[:last]]
    tone = _tone(report)
    if tone is not None:
        size, rate = (np.array([value]) for value in tone)
        marks.append(Points("add this", rate, size, "ink", 7.0))
        ends.append(rate)
    rate_limits = whole_decades(np.concatenate(ends))
    return Panel(
        "Tones of the input",
        Axis("angular frequency", "rad/s", logarithmic=True, limits=rate_limits),
        Axis(
            "amplitude",
            report.input_unit,
            logarithmic=True,
            limits=(_FLOOR * largest, 3.0 * largest),
        ),
        tuple(marks),
        _HEIGHT,
    )


def _tone(report: ExcitationReport) -> tuple[float, float] | None:
    """Amplitude and angular frequency of what is advised, if a tone is."""
    advice = report.advice
    if advice is not None and advice.sine is not None:
        return advice.sine.amplitude, advice.sine.angular_frequency
    return None if advice is None else advice.rule
