"""Reproduction of Huang (2003): all runs, and verdicts on the claims in ``claims.toml``."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from typing import Any, Literal, TypeVar

import numpy as np

from flexid.errors import AccelerationError
from flexid.estimators.excitation import WEAK_CONDITION
from flexid.models.physical import physical_parameters
from flexid.paper.laws import pd_gravity
from flexid.simulation.closed_loop import simulate
from flexid.simulation.lyapunov import ALLOWED_RISE
from flexid.studies.runs import (
    ATTENUATION,
    ATTENUATIONS,
    CASES,
    DURATION,
    EARLIER_ATTENUATION,
    MEANINGS,
    PHYSICAL,
    SIMULATED,
    TRUE,
    UNKNOWN,
    AttenuationPoint,
    Exponents,
    Reading,
    SteadyRun,
    TheoremCase,
    attenuation_point,
    peak_torque,
    reading_name,
    steady_condition,
    study_reading,
    table1_loop,
    theorem_case,
)

Relation = Literal["<=", ">="]

Verdict = Literal["holds", "does not hold", "depends on the reading"]


@dataclass(frozen=True)
class Finding:
    """Measured value that decides a claim for one subject."""

    # a reading such as "1,2,3", or "any" if the readings do not matter
    subject: str
    quantity: str  # name of the measured quantity
    value: float  # measured value
    relation: Relation  # of value to limit, if the claim holds
    limit: float
    unit: str = "1"  # of value and limit

    @property
    def holds(self) -> bool:
        """Whether the claim holds for this subject; false for NaN."""
        return self.value <= self.limit if self.relation == "<=" else self.value >= self.limit


@dataclass(frozen=True)
class Claim:
    """Statement of the paper, and the findings that decide it."""

    key: str  # short name
    source: str  # section or equation of the paper
    statement: str  # paraphrased
    findings: tuple[Finding, ...]  # one per subject

    @property
    def verdict(self) -> Verdict:
        """Verdict from all findings."""
        outcomes = {finding.holds for finding in self.findings}
        if len(outcomes) > 1:
            return "depends on the reading"
        return "holds" if outcomes == {True} else "does not hold"


_LIMITS = {"weak condition": WEAK_CONDITION, "allowed rise": ALLOWED_RISE}

Values = Mapping[str, float | tuple[float, str]]
"""Values of a quantity by subject, with a word to insert into its name where it has one."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Results of the reproduction of Huang (2003)."""

    readings: dict[str, Reading]  # of the feedback gains, by name
    # tracking and parameter errors over k, by reading
    attenuation: dict[str, list[AttenuationPoint]]
    peak_torques: dict[float, float]  # largest torque in N m by k
    cases: tuple[TheoremCase, ...]  # Theorem 1 in three cases
    error_under_pd: float  # worst relative error at 30 s with another controller

    @property
    def runs(self) -> dict[str, SteadyRun]:
        """Runs over 30 s by the name of their reading, (1,2,3) first."""
        chosen = (self.readings[reading_name(exponents)] for exponents in SIMULATED)
        return {reading.name: reading.simulated for reading in chosen if reading.simulated}

    @cached_property
    def claims(self) -> tuple[Claim, ...]:
        """The paper's claims with verdicts."""
        estimates = {**TRUE, **self.runs["1,1,3"].estimates}
        values: dict[str, list[Values]] = {
            "no acceleration": [{"any": _accelerations_needed()}],
            "error dynamics": [{"any": _different_rates()}],
            "physical parameters": [
                {"any": _physical_error(TRUE)},
                {"1,1,3": _physical_error(estimates)},
            ],
            **_of_the_theorem(self.runs, self.cases),
            **_of_the_controller(self),
            **_of_the_results(self),
            "any controller": [{"PD": self.error_under_pd}],
        }
        text = (files("flexid.studies") / "claims.toml").read_text(encoding="utf-8")
        return tuple(_claim(key, table, values[key]) for key, table in tomllib.loads(text).items())


def _claim(key: str, table: Mapping[str, Any], values: Sequence[Values]) -> Claim:
    """Return a claim from its table and the measured values."""
    findings: list[Finding] = []
    for measured, by_subject in zip(table["measured"], values, strict=True):
        relation: Relation = "<=" if "at_most" in measured else ">="
        stated = measured["at_most" if relation == "<=" else "at_least"]
        limit = _LIMITS[stated] if isinstance(stated, str) else stated
        unit = measured.get("unit", "1")
        for subject, found in by_subject.items():
            value, word = found if isinstance(found, tuple) else (found, "")
            quantity = measured["quantity"].format(word)
            findings.append(Finding(subject, quantity, value, relation, limit, unit))
    return Claim(key, table["source"], table["statement"], tuple(findings))


def _accelerations_needed() -> int:
    """Return the number of signals that the observer needs besides states and input."""
    from flexid.paper.observer import derive_observer

    try:
        return len(derive_observer(table1_loop((1, 2, 3)).system).input_rates)
    except AccelerationError:
        return 1


def _different_rates() -> int:
    """Return the number of coefficients whose derived error rate differs from eq. (7)."""
    from flexid.paper.observer import derive_observer, error_dynamics

    observer = derive_observer(table1_loop((1, 2, 3)).system)
    differing = 0
    for row, rates in zip(observer.rows, error_dynamics(observer), strict=True):
        regressors = row.row.regressor
        mismatch = sum(r * e for r, e in zip(regressors, row.errors, strict=True))
        differing += sum(
            (rate + row.gain * r * mismatch).expand() != 0
            for rate, r in zip(rates, regressors, strict=True)
        )
    return differing


def _physical_error(coefficients: Mapping[str, float]) -> float:
    """Return the largest relative error of physical parameters computed from coefficients."""
    found = {
        p.name: p.value(coefficients)
        for p in physical_parameters((*UNKNOWN, "beta1"), input_is_torque=True)
    }
    return max(abs(found[name] / true - 1.0) for name, true in PHYSICAL.items())


def _of_the_theorem(
    runs: Mapping[str, SteadyRun], cases: tuple[TheoremCase, ...]
) -> dict[str, list[Values]]:
    """Return values for the claims on Theorem 1, its proof and its condition (A4)."""
    excited, standstill, small = cases
    v = {name: run.monitor.value for name, run in runs.items()}

    def conditions(row: str) -> Values:
        return {name: run.excitation[row].condition_number for name, run in runs.items()}

    return {
        "V never rises": [{name: run.monitor.rise_in_tolerances for name, run in runs.items()}],
        "printed bound": [{name: float(2.0 * x.max() / x[0]) for name, x in v.items()}],
        "rates vanish": [{"(A4) holds": _late_rate(excited), "standstill": _late_rate(standstill)}],
        "errors vanish": [{"1,2,3, 300 s": excited.remaining}],
        "only boundedness": [{"standstill": standstill.remaining, "0.1 rad sine": small.remaining}],
        "exponential rate": [{f"{row} row": x for row, x in excited.decay_rates.items()}],
        "(A4) for f": [conditions("link")],
        "(A4) for φ": [conditions("motor")],
        "(A4) at any amplitude": [{"0.3 rad": steady_condition(0.3)}],
    }


def _late_rate(case: TheoremCase) -> float:
    """Return the largest error rate at the end, over the largest first error."""
    initial = max(abs(limit.first) for limit in case.limits)
    return max(limit.largest_rate for limit in case.limits) / initial


def _of_the_controller(study: Reproduction) -> dict[str, list[Values]]:
    """Return values for the claims on the control law; errors are from 20 to 30 s."""
    points, peaks = study.attenuation["1,2,3"], study.peak_torques
    errors = {point.k: point.max_tracking_error for point in points}
    slope = np.polyfit(np.log([*errors]), np.log([*errors.values()]), 1)[0]
    small, large = ATTENUATION, EARLIER_ATTENUATION
    return {
        "bounded signals": [{name: r.rightmost.real for name, r in study.readings.items()}],
        "arbitrarily small tracking errors": [
            {"1,2,3": float(slope)},
            {"1,1,3": study.attenuation["1,1,3"][-1].largest_real_part},
        ],
        "price of a small k": [{"1,2,3": errors[small] / errors[large]}],
        "less torque": [{"1,2,3": peaks[small] / peaks[large]}],
    }


def _of_the_results(study: Reproduction) -> dict[str, list[Values]]:
    """Return values for the claims on the estimates at 30 s, and how they depend on k."""
    runs, attenuation = study.runs, study.attenuation
    errors = {name: run.relative_errors for name, run in runs.items()}
    worst = {name: max(each, key=each.__getitem__) for name, each in errors.items()}
    spreads = {
        name: float(np.ptp([point.largest_relative_error for point in points]))
        for name, points in attenuation.items()
    }
    ends = {name: f"{points[0].k:g} to {points[-1].k:g}" for name, points in attenuation.items()}
    return {
        "zero within 30 s": [{name: (errors[name][c], c) for name, c in worst.items()}],
        "k leaves the estimates alone": [{n: (spread, ends[n]) for n, spread in spreads.items()}],
    }


_T = TypeVar("_T")

# Largest k by reading. The ringing of (1,1,3) takes steps in proportion to k: a million at 400.
_SWEEPS: dict[Exponents, float] = {(1, 2, 3): EARLIER_ATTENUATION, (1, 1, 3): 100.0}


def reproduce(finished: Callable[[str], None]) -> Reproduction:
    """Run the whole study; `finished` is called with the name of each part."""

    def done(name: str, result: _T) -> _T:
        finished(name)
        return result

    readings = {
        reading_name(e): done(f"reading ({reading_name(e)})", study_reading(e)) for e in MEANINGS
    }
    attenuation = {
        reading_name(e): done(
            f"attenuation factor ({reading_name(e)})",
            [attenuation_point(e, k) for k in ATTENUATIONS if k <= largest],
        )
        for e, largest in _SWEEPS.items()
    }
    peaks = {k: peak_torque((1, 2, 3), k) for k in (ATTENUATION, EARLIER_ATTENUATION)}
    cases = tuple(done("case of Theorem 1", theorem_case(*case)) for case in CASES)
    loop = replace(table1_loop((1, 2, 3)), controller=pd_gravity())
    errors = simulate(loop, DURATION, 0.01, 1e-8).final_errors()
    worst = max(abs(error) / TRUE[name] for name, error in errors.items())
    finished("another controller")
    study = Reproduction(readings, attenuation, peaks, cases, worst)
    done("claims", study.claims)
    return study
