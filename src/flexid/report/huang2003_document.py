"""The reproduction of Huang (2003) as a plain document for JSON."""

from typing import Any

import flexid
from flexid.analysis.excitation import Excitation
from flexid.report.documents import plain
from flexid.studies.huang2003.evidence import Claim
from flexid.studies.huang2003.readings import TOLERANCE, Reading, SteadyRun
from flexid.studies.huang2003.reproduction import Reproduction
from flexid.studies.huang2003.table1 import (
    AMPLITUDE,
    ATTENUATION,
    DURATION,
    FREQUENCY,
    INITIAL_ESTIMATES,
    OBSERVER_GAIN,
    PHYSICAL,
    TRUE,
)
from flexid.studies.huang2003.theorem1 import TheoremCase


def reproduction_document(result: Reproduction) -> dict[str, Any]:
    """Everything of the reproduction but its time series; SI units."""
    return {
        "readings": {
            name: _reading(result.readings[name]) | _run(run) for name, run in result.runs.items()
        },
        "unstable_readings": {
            name: _reading(reading)
            for name, reading in result.readings.items()
            if reading.simulated is None
        },
        "claims": [_claim(claim) for claim in result.claims],
        "theorem1": [_case(case) for case in result.cases],
        "rates": result.rates,
        "attenuation": result.attenuation,
        "late_tracking_errors": {
            "1,1,3": {f"{end:g}": error for end, error in result.late_tracking_errors.items()}
        },
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


def _reading(reading: Reading) -> dict[str, Any]:
    return {
        "meaning": reading.meaning,
        "poles": [[float(pole.real), float(pole.imag)] for pole in reading.poles],
        "largest_real_part": reading.rightmost.real,
        "early_tracking_error": reading.early_tracking_error,
    }


def _run(run: SteadyRun) -> dict[str, Any]:
    return {
        "parameter_errors_at_30s": run.parameter_errors,
        "max_tracking_error_20_30": run.max_tracking_error,
        "peak_torque": run.peak_torque,
        "peak_motor_velocity": run.peak_motor_velocity,
        "excitation": _excitation(run.excitation),
        "lyapunov": {
            "first": float(run.monitor.value[0]),
            "last": float(run.monitor.value[-1]),
            "rise_in_tolerances": run.monitor.rise_in_tolerances,
        },
        "steps": run.run.statistics,
    }


def _excitation(rows: dict[str, Excitation]) -> dict[str, Any]:
    return {
        row: {"condition_number": e.condition_number, "level": e.level} for row, e in rows.items()
    }


def _claim(claim: Claim) -> dict[str, Any]:
    return {
        "key": claim.key,
        "source": claim.source,
        "statement": claim.statement,
        "verdict": claim.verdict,
        "findings": [plain(finding) | {"holds": finding.holds} for finding in claim.findings],
    }


def _case(case: TheoremCase) -> dict[str, Any]:
    return {
        "name": case.name,
        "reference": case.reference,
        "duration": case.duration,
        "judged_rows": case.judged,
        "settled": case.settled,
        "vanished": case.vanished,
        "limits": {
            limit.coefficient: {
                "first": limit.first,
                "last": limit.last,
                "drift": limit.drift,
                "largest_rate": limit.largest_rate,
            }
            for limit in case.monitor.limits
        },
        "excitation": _excitation(case.excitation),
        "rise_in_tolerances": case.monitor.rise_in_tolerances,
    }
