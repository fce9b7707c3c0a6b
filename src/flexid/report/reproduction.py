"""The reproduction of Huang (2003) as tables and JSON."""

from collections.abc import Iterator
from typing import Any

from rich.text import Text

import flexid
from flexid.arrays import plain
from flexid.estimators.excitation import Excitation
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.report.page import Presenter
from flexid.report.reproduction_charts import reproduction_charts
from flexid.report.terminal import Column, Part, Table, number, numbers
from flexid.studies.cases import TheoremCase
from flexid.studies.readings import (
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
)
from flexid.studies.reproduction import Claim, Reproduction, Verdict

_COLOURS: dict[Verdict, str] = {
    "holds": "green",
    "does not hold": "red",
    "depends on the reading": "yellow",
}
_SHORT = {"depends on the reading": "depends"}


def parts(result: Reproduction) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield _claims(result.claims)
    yield _readings(result)
    yield _parameter_errors(result)
    yield _cases(result.cases)


def _readings(result: Reproduction) -> Table:
    columns = (
        Column("reading"),
        Column(""),
        *numbers("rightmost pole (1/s)", "|x1 - qd| to 0.3 s (rad)", "20-30 s (rad)"),
    )
    title = f"Readings (a,b,c) of the gains k^a JlM/kem, k^b, k^c JrM, with k = {ATTENUATION:g}"
    table = Table(title, columns)
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
    table = Table("Parameter errors at 30 s", (Column("coefficient"), *numbers("true", *headings)))
    for name in UNKNOWN:
        cells: list[str] = []
        for run in runs.values():
            share = 100 * run.relative_errors[name]
            cells += [number(run.parameter_errors[name], 6), number(share, 2, "%")]
        table.add(f"{name} ({COEFFICIENT_UNITS[name]})", number(TRUE[name], 6), *cells)
    return table


def _cases(cases: tuple[TheoremCase, ...]) -> Table:
    columns = (
        Column("case"),
        Column("reference"),
        Column("rows"),
        *numbers("condition number", "settled", "largest error left"),
    )
    table = Table("Theorem 1 in three cases, gains (1,2,3)", columns)
    for case in cases:
        left = max(abs(limit.last / limit.first) for limit in case.limits)
        table.add(
            case.name,
            f"{case.reference}, {case.duration:g} s",
            ", ".join(case.judged),
            number(case.worst_condition, 2),
            "yes" if case.settled else "no",
            number(100 * left, 3, "%"),
        )
    return table


def _claims(claims: tuple[Claim, ...]) -> Table:
    columns = (Column("claim, and what decides it"), *numbers("value", "wanted"))
    table = Table("Claims of the paper", (*columns, Column("", right=True)))
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


def document(result: Reproduction) -> dict[str, Any]:
    """Everything of the reproduction but its time series; SI units."""
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
    """What is reproduced."""
    return "Huang (2003), reproduced", _PAPER


PRESENTER = Presenter(heading, parts, document, reproduction_charts)
