"""The reproduction of Huang (2003) as tables, JSON and charts: Figures 1 to 5, Theorem 1."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from rich.text import Text

import flexid
from flexid.arrays import plain
from flexid.estimators.excitation import Excitation
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.report.chart import (
    Axis,
    Chart,
    Colour,
    Level,
    Line,
    Mark,
    Panel,
    peaks,
    whole_decades,
    with_margin,
)
from flexid.report.terminal import Part, Table, number, numbers
from flexid.studies.reproduction import Claim, Reproduction, Verdict
from flexid.studies.runs import (
    AMPLITUDE,
    ATTENUATION,
    DURATION,
    FREQUENCY,
    INITIAL_ESTIMATES,
    OBSERVER_GAIN,
    PHYSICAL,
    TOLERANCE,
    TRUE,
    UNKNOWN,
    Reading,
    SteadyRun,
    TheoremCase,
)

_COLOURS: dict[Verdict, str] = {
    "holds": "green",
    "does not hold": "red",
    "depends on the reading": "yellow",
}
_SHORT = {"depends on the reading": "depends"}


def parts(result: Reproduction) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    yield _claims(result.claims)
    yield _readings(result)
    yield _parameter_errors(result)
    yield _cases(result.cases)


def _readings(result: Reproduction) -> Table:
    measured = numbers("rightmost pole (1/s)", "|x1 - qd| to 0.3 s (rad)", "20-30 s (rad)")
    title = f"Readings (a,b,c) of the gains k^a JlM/kem, k^b, k^c JrM, with k = {ATTENUATION:g}"
    table = Table(title, ("reading", "", *measured))
    for reading in result.readings.values():
        pole, run = reading.rightmost, reading.simulated
        table.add(
            f"({reading.name})",
            reading.meaning,
            Text(f"{pole.real:+.3g} ± {abs(pole.imag):.3g}j", "green" if pole.real < 0 else "red"),
            number(reading.early_tracking_error, 4),
            number(run.max_tracking_error, 4) if run else "not simulated",
        )
    return table


def _parameter_errors(result: Reproduction) -> Table:
    runs = result.runs
    headings = (text for name in runs for text in (f"({name})", "share"))
    table = Table("Parameter errors at 30 s", ("coefficient", *numbers("true", *headings)))
    for name in UNKNOWN:
        cells: list[str] = []
        for run in runs.values():
            share = 100 * run.relative_errors[name]
            cells += [number(run.parameter_errors[name], 6), number(share, 2, "%")]
        table.add(f"{name} ({COEFFICIENT_UNITS[name]})", number(TRUE[name], 6), *cells)
    return table


def _cases(cases: tuple[TheoremCase, ...]) -> Table:
    measured = numbers("condition number", "settled", "largest remaining error")
    rows = (
        (
            case.name,
            f"{case.reference}, {case.duration:g} s",
            ", ".join(case.judged),
            number(case.worst_condition, 2),
            "yes" if case.settled else "no",
            number(100 * case.remaining, 3, "%"),
        )
        for case in cases
    )
    title = "Theorem 1 in three cases, gains (1,2,3)"
    return Table(title, ("case", "reference", "rows", *measured), rows)


def _claims(claims: tuple[Claim, ...]) -> Table:
    columns = ("claim, with its tests", *numbers("value", "required", ""))
    table = Table("Claims of the paper", columns)
    for claim in claims:
        verdict = Text(_SHORT.get(claim.verdict, claim.verdict), _COLOURS[claim.verdict])
        table.add(f"{claim.statement} [{claim.source}]", "", "", verdict)
        for finding in claim.findings:
            relation = {"<=": "≤", ">=": "≥"}[finding.relation]
            subject = "" if finding.subject == "any" else f"{finding.subject}: "
            table.add(
                Text(f"  {subject}{finding.quantity}", "dim"),
                number(finding.value, 4, "" if finding.unit == "1" else finding.unit),
                f"{relation} {finding.limit:g}",
                Text("yes", "green") if finding.holds else Text("no", "red"),
            )
    return table


SYMBOLS = {"theta1": "θ₁", "theta2": "θ₂", "alpha1": "α₁", "alpha2": "α₂"}
NOISE = 1e-3 * TOLERANCE
"""The integrator's absolute tolerance: smaller parameter errors count as zero."""

_OF_READINGS: Mapping[str, Colour] = {"1,2,3": "blue", "1,1,3": "orange"}

_LAST = 0.5  # s
_PEAKS = 0.1  # s per point, which shows the largest parameter error in them
_UNITS = {"theta1": "1/s²", "theta2": "1/s²", "alpha1": "1/s²", "alpha2": "1/s"}
_MARGIN = 0.08  # share of a parameter error's range after 50 ms, left free above and below


def charts(result: Reproduction) -> tuple[Chart, ...]:
    """Return figure1 to figure5 and theorem1."""
    runs = result.runs
    errors = [error_chart(runs, name, number) for number, name in enumerate(UNKNOWN, start=2)]
    return tracking_chart(runs), *errors, theorem_chart(runs)


def tracking_chart(runs: Mapping[str, SteadyRun]) -> Chart:
    """Return Figure 1: the tracking error over the run and over its last half second."""
    panels = []
    for name, run in runs.items():
        time, error = run.run.time, run.run.tracking_error
        limit = 1.25 * run.max_tracking_error
        largest = float(np.abs(error).max())
        swing = f"; first swing {largest:.2g} rad" if largest > limit else ""
        end = run.run.between(DURATION - _LAST, DURATION)
        y = Axis("tracking error", "rad", limits=(-limit, limit))
        most = _number(run.max_tracking_error)
        title = f"gains ({name}): at most {most} rad over 20–30 s{swing}"
        whole = Line("", time, error, _OF_READINGS[name], 0.6)
        last = Line("", time[end], error[end], _OF_READINGS[name])
        panels.append(Panel(title, Axis("time", "s", limits=(0.0, DURATION)), y, (whole,), span=3))
        at_end = Axis("time", "s", limits=(DURATION - _LAST, DURATION))
        panels.append(Panel("last half second", at_end, y, (last,)))
    found = ", ".join(f"{_number(run.max_tracking_error)} rad" for run in runs.values())
    names = " and ".join(f"({name})" for name in runs)
    says = f"Over the last ten seconds the tracking errors of readings {names} are at most {found}."
    return Chart("figure1", "Figure 1: tracking error", says, tuple(panels), columns=4)


def error_chart(runs: Mapping[str, SteadyRun], coefficient: str, number: int) -> Chart:
    """Return one of Figures 2 to 5: a parameter error over time, and its magnitude."""
    column = UNKNOWN.index(coefficient)
    symbol, unit = SYMBOLS[coefficient], _UNITS[coefficient]
    time = Axis("time", "s", limits=(0.0, DURATION))
    whole: list[Mark] = [Level("", 0.0, "y", "ink")]
    magnitude: list[Mark] = []
    sizes = []
    for name, run in runs.items():
        error = run.run.parameter_errors[:, column]
        label, colour = f"gains ({name})", _OF_READINGS[name]
        whole.append(Line(label, run.run.time, error, colour, 1.0))
        width = round(_PEAKS / (run.run.time[1] - run.run.time[0]))
        places, largest = peaks(run.run.time, np.abs(error), width)
        magnitude.append(Line(label, places, largest, colour))
        sizes.append(largest)
    lowest, highest = whole_decades(np.concatenate(sizes))
    if lowest < NOISE:
        lowest = 0.1 * NOISE
        magnitude.append(Level("integrator's tolerance", NOISE, "y", "grey", "dashed"))
    at_end = ", ".join(
        f"{_number(run.parameter_errors[coefficient])} with ({name})" for name, run in runs.items()
    )
    limits, cut_off = _late_values(runs, column)
    peak = Axis(f"{_PEAKS} s peaks", unit, logarithmic=True, limits=(lowest, highest))
    error_axis = Axis(f"error of {symbol}", unit, limits=limits)
    panels = (
        Panel(f"error of {symbol} at 30 s: {at_end}{cut_off}", time, error_axis, tuple(whole)),
        Panel("its size", time, peak, tuple(magnitude)),
    )
    title = f"Figure {number}: error of {symbol}"
    says = f"After 30 s the error of {symbol} in {unit} is {at_end}."
    return Chart(f"figure{number}", title, says, panels)


def _number(value: float) -> str:
    """Return three digits, or a bound for values below the integrator's error."""
    return f"{value:.3g}".replace("-", "−") if abs(value) > 10 * NOISE else "|·| < 1e−10"


def _late_values(runs: Mapping[str, SteadyRun], column: int) -> tuple[tuple[float, float], str]:
    """Return limits for all but the first 50 ms, and a note on the first value if cut off."""
    late = np.concatenate([run.run.parameter_errors[50:, column] for run in runs.values()])
    limits = with_margin(float(late.min()), float(late.max()), _MARGIN)
    first = float(next(iter(runs.values())).run.parameter_errors[0, column])
    return limits, f"; from {_number(first)} at 0 s" if first < limits[0] else ""


def theorem_chart(runs: Mapping[str, SteadyRun]) -> Chart:
    """Return the Lyapunov function V along both runs."""
    values = tuple(
        Line(f"gains ({name})", run.monitor.time, run.monitor.value, _OF_READINGS[name])
        for name, run in runs.items()
    )
    decades = whole_decades(np.concatenate([line.y for line in values]))
    time = Axis("time", "s", limits=(0.0, DURATION))
    lyapunov = Panel(
        "Lyapunov function, eq. (8): it never rises",
        time,
        Axis("V", "SI", logarithmic=True, limits=decades),
        values,
    )
    ends = " and ".join(f"{line.y[-1]:.2g}" for line in values)
    return Chart("theorem1", "Theorem 1", f"V falls to {ends} in 30 s.", (lyapunov,))


def document(result: Reproduction) -> dict[str, Any]:
    """Return everything but the time series for JSON, in SI units."""
    return {
        "readings": {
            name: _reading_document(result.readings[name]) | _run_document(run)
            for name, run in result.runs.items()
        },
        "unstable_readings": {
            name: _reading_document(reading)
            for name, reading in result.readings.items()
            if reading.simulated is None
        },
        "claims": [_claim_document(claim) for claim in result.claims],
        "theorem1": [_case_document(case) for case in result.cases],
        "attenuation": result.attenuation,
        "provenance": {
            "flexid_version": flexid.__version__,
            "integrator": "Rodas5P",
            "relative_tolerance": TOLERANCE,
            "duration": DURATION,
            "table1": {
                "parameters": PHYSICAL,
                "coefficients": TRUE,
                "initial_estimates": INITIAL_ESTIMATES,
                "observer_gain": OBSERVER_GAIN,
                "attenuation_factor": ATTENUATION,
                "amplitude": AMPLITUDE,
                "frequency": FREQUENCY,
            },
        },
    }


def _reading_document(reading: Reading) -> dict[str, Any]:
    return {
        "meaning": reading.meaning,
        "poles": [[float(pole.real), float(pole.imag)] for pole in reading.poles],
        "largest_real_part": reading.rightmost.real,
        "early_tracking_error": reading.early_tracking_error,
    }


def _run_document(run: SteadyRun) -> dict[str, Any]:
    return {
        "parameter_errors_at_30s": run.parameter_errors,
        "max_tracking_error_20_30": run.max_tracking_error,
        "peak_torque": run.peak_torque,
        "peak_motor_velocity": run.peak_motor_velocity,
        "excitation": _excitation_document(run.excitation),
        "lyapunov": {
            "first": float(run.monitor.value[0]),
            "last": float(run.monitor.value[-1]),
            "rise_in_tolerances": run.monitor.rise_in_tolerances,
        },
        "steps": run.run.statistics,
    }


def _excitation_document(rows: dict[str, Excitation]) -> dict[str, Any]:
    return {
        row: {"condition_number": e.condition_number, "level": e.level} for row, e in rows.items()
    }


def _claim_document(claim: Claim) -> dict[str, Any]:
    findings = [plain(finding) | {"holds": finding.holds} for finding in claim.findings]
    return plain(claim) | {"verdict": claim.verdict, "findings": findings}


def _case_document(case: TheoremCase) -> dict[str, Any]:
    limits = {limit.coefficient: plain(limit) for limit in case.monitor.limits}
    numbers = ("first", "last", "drift", "largest_rate")
    return {
        "name": case.name,
        "reference": case.reference,
        "duration": case.duration,
        "judged_rows": case.judged,
        "settled": case.settled,
        "vanished": case.vanished,
        "limits": {name: {n: limit[n] for n in numbers} for name, limit in limits.items()},
        "excitation": _excitation_document(case.excitation),
        "rise_in_tolerances": case.monitor.rise_in_tolerances,
    }


_PAPER = (
    "J. T. Huang, A New Approach to Parametric Identification of a Single-Link Flexible-Joint "
    "Manipulator, Journal of Intelligent and Robotic Systems 37 (2003) 273–284"
)


def heading(_result: Reproduction) -> tuple[str, str]:
    """Return the title, and the paper."""
    return "Huang (2003), reproduced", _PAPER
