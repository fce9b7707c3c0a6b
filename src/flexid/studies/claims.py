"""The claims of Huang (2003), each with the number that decides it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexid.analysis.excitation import WEAK_CONDITION
from flexid.analysis.lyapunov import ALLOWED_RISE
from flexid.errors import AccelerationError
from flexid.models.physical import physical_parameters
from flexid.studies.cases import (
    AttenuationPoint,
    RatePoint,
    TheoremCase,
    steady_condition,
)
from flexid.studies.readings import (
    ATTENUATION,
    EARLIER_ATTENUATION,
    PHYSICAL,
    TRUE,
    UNKNOWN,
    Reading,
    SteadyRun,
    table1_loop,
)

Relation = Literal["<=", ">="]

Verdict = Literal["holds", "does not hold", "depends on the reading"]


@dataclass(frozen=True)
class Finding:
    """One number that decides a claim for one subject."""

    # what was looked at: a reading such as "1,2,3"; "any" where readings do not matter
    subject: str
    quantity: str  # what was measured
    value: float  # what came out
    relation: Relation  # how the value has to compare for the claim to hold
    limit: float  # with what
    unit: str = "1"  # unit of value and limit; dimensionless if left out

    @property
    def holds(self) -> bool:
        """Whether the claim holds for this subject; never for a value that is not a number."""
        return self.value <= self.limit if self.relation == "<=" else self.value >= self.limit


def findings(
    quantity: str, values: Mapping[str, float], relation: Relation, limit: float, unit: str = "1"
) -> tuple[Finding, ...]:
    """The same quantity of several subjects."""
    return tuple(Finding(name, quantity, x, relation, limit, unit) for name, x in values.items())


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and what decides it."""

    key: str  # short name
    source: str  # where the paper makes it
    statement: str  # what it says, in our words
    findings: tuple[Finding, ...]  # one per subject

    @property
    def verdict(self) -> Verdict:
        """Whether all findings, none, or only some bear the claim out."""
        outcomes = {finding.holds for finding in self.findings}
        if len(outcomes) > 1:
            return "depends on the reading"
        return "holds" if outcomes == {True} else "does not hold"


_ROUNDING = 1e-12  # relative error that floating-point arithmetic explains


def design_claims(best: SteadyRun) -> list[Claim]:
    """Decide the claims about accelerations, eq. (7) and physical parameters."""
    worst = "worst relative error"
    exact, found = physical_error(TRUE), physical_error({**TRUE, **best.estimates})
    return [
        Claim(
            "no acceleration",
            "Abstract; remark in section 2",
            "The observer of the flexible joint needs no acceleration",
            (Finding("any", "derivatives of velocities in (6)", accelerations_needed(), "<=", 0),),
        ),
        Claim(
            "error dynamics",
            "Eq. (7)",
            "The rate of each row's errors is -c r rᵀ times them, whatever the motion",
            (Finding("any", "rates that differ from (7), in symbols", different_rates(), "<=", 0),),
        ),
        Claim(
            "physical parameters",
            "Section 3",
            "Given the motor inertia, all other physical parameters follow from the coefficients",
            (
                Finding("any", f"{worst}, exact coefficients", exact, "<=", _ROUNDING),
                Finding("1,1,3", f"{worst}, estimates at 30 s", found, "<=", 1e-3),
            ),
        ),
    ]


def accelerations_needed() -> int:
    """Number of signals beyond states and input that the derived observer asks for."""
    from flexid.derivation.observer import derive_observer

    try:
        return len(derive_observer(table1_loop((1, 2, 3)).system).input_rates)
    except AccelerationError:
        return 1


def different_rates() -> int:
    """Number of coefficients whose error rate, derived again, differs from eq. (7)."""
    from flexid.derivation.observer import derive_observer, error_dynamics

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


def physical_error(coefficients: dict[str, float]) -> float:
    """Largest relative error of the physical parameters that follow from coefficients."""
    found = {
        p.name: p.value(coefficients)
        for p in physical_parameters((*UNKNOWN, "beta1"), input_is_torque=True)
    }
    return max(abs(found[name] / true - 1.0) for name, true in PHYSICAL.items())


ZERO_SHARE = 0.01
"""Share of the true value below which a parameter error passes for zero in a figure."""

NO_INFLUENCE = 0.05
"""Change of the relative errors at 30 s up to which a factor counts as without influence."""


def decide_claims(
    readings: Mapping[str, Reading],
    runs: Mapping[str, SteadyRun],
    attenuation: Mapping[str, list[AttenuationPoint]],
    peak_torques: Mapping[float, float],
    rates: Mapping[str, list[RatePoint]],
    cases: tuple[TheoremCase, ...],
    other_controller_error: float,
) -> tuple[Claim, ...]:
    """Decide every claim."""
    return (
        *design_claims(runs["1,1,3"]),
        *_theorem_claims(runs, cases),
        *_rate_claims(rates),
        *_excitation_claims(runs),
        *_controller_claims(readings, attenuation, peak_torques),
        *_result_claims(runs, attenuation, other_controller_error),
    )


def _theorem_claims(runs: Mapping[str, SteadyRun], cases: tuple[TheoremCase, ...]) -> list[Claim]:
    excited, standstill, small = cases
    rises = {name: run.monitor.rise_in_tolerances for name, run in runs.items()}
    squares = {
        name: float(2.0 * run.monitor.value.max() / run.monitor.value[0])
        for name, run in runs.items()
    }
    rates = {"(A4) holds": _late_rate(excited), "standstill": _late_rate(standstill)}
    left = "worst error over its first value"
    kept = {"standstill": _worst_remaining(standstill), "0.1 rad sine": _worst_remaining(small)}
    return [
        Claim(
            "V never rises",
            "Eq. (9)",
            "V of eq. (8) never rises along a run",
            findings("largest rise, in integration tolerances", rises, "<=", ALLOWED_RISE),
        ),
        Claim(
            "printed bound",
            "Proof of Theorem 1",
            "The squared parameter errors stay below the first value of V",
            findings("largest squared error over V(0)", squares, "<=", 1.0),
        ),
        Claim(
            "rates vanish",
            "Theorem 1",
            "The rates of the parameter errors tend to zero",
            findings("largest late rate over first error", rates, "<=", 1e-5, "1/s"),
        ),
        Claim(
            "errors vanish",
            "Theorem 1",
            "Where (A4) holds and the errors settle, they settle at zero",
            findings(left, {"1,2,3, 300 s": _worst_remaining(excited)}, "<=", 1e-3),
        ),
        Claim(
            "only boundedness",
            "Remark after Theorem 1",
            "Without (A4) the errors stay bounded but need not vanish",
            findings(left, kept, ">=", 0.1),
        ),
    ]


def _rate_claims(rates: Mapping[str, list[RatePoint]]) -> list[Claim]:
    least = {
        f"{row} row": min(point.measured / point.guaranteed for point in points)
        for row, points in rates.items()
    }
    return [
        Claim(
            "exponential rate",
            "Section 3, on persistent excitation",
            "Under persistent excitation the errors vanish exponentially",
            findings("least measured rate over guaranteed rate", least, ">=", 1.0),
        )
    ]


def _excitation_claims(runs: Mapping[str, SteadyRun]) -> list[Claim]:
    quantity = "condition number of the Gram matrix"
    rows = {
        functions: {name: run.excitation[row].condition_number for name, run in runs.items()}
        for functions, row in (("f", "link"), ("φ", "motor"))
    }
    return [
        *(
            Claim(
                f"(A4) for {functions}",
                "Section 4, eqs. (12)-(14)",
                f"The functions in {functions} are independent along the steady state",
                findings(quantity, conditions, "<=", WEAK_CONDITION),
            )
            for functions, conditions in rows.items()
        ),
        Claim(
            "(A4) at any amplitude",
            "Section 4: A at disposal",
            "A single sinusoid separates θ1 from θ2 whatever its amplitude",
            findings(quantity, {"0.3 rad": steady_condition(0.3)}, "<=", WEAK_CONDITION),
        ),
    ]


def _controller_claims(
    readings: Mapping[str, Reading],
    attenuation: Mapping[str, list[AttenuationPoint]],
    peak_torques: Mapping[float, float],
) -> list[Claim]:
    real = "largest real part of the poles"
    parts = {name: reading.rightmost.real for name, reading in readings.items()}
    slope = {"1,2,3": _slope(attenuation["1,2,3"])}
    last = {"1,1,3": attenuation["1,1,3"][-1].largest_real_part}
    small, large = (
        _at(attenuation["1,2,3"], k).max_tracking_error for k in (ATTENUATION, EARLIER_ATTENUATION)
    )
    torques = {"1,2,3": peak_torques[ATTENUATION] / peak_torques[EARLIER_ATTENUATION]}
    return [
        Claim(
            "bounded signals",
            "Section 4, below eq. (11)",
            "The control law keeps all signals bounded",
            findings(real, parts, "<=", 0.0, "1/s"),
        ),
        Claim(
            "arbitrarily small tracking errors",
            "Section 4, below eq. (11)",
            "A larger k makes the tracking errors as small as one likes",
            (
                *findings("slope of log error over log k", slope, "<=", -1.0),
                *findings(f"{real} at the largest k", last, "<=", 0.0, "1/s"),
            ),
        ),
        Claim(
            "price of a small k",
            "Section 4",
            "With k = 50 the tracking errors are larger than with k = 1000",
            findings("ratio of the errors over 20-30 s", {"1,2,3": small / large}, ">=", 1.0),
        ),
        Claim(
            "less torque",
            "Section 4",
            "k = 50 instead of 1000 reduces the control torque",
            findings("ratio of the peak torques", torques, "<=", 1.0),
        ),
    ]


def _result_claims(
    runs: Mapping[str, SteadyRun],
    attenuation: Mapping[str, list[AttenuationPoint]],
    other_controller_error: float,
) -> list[Claim]:
    return [
        Claim(
            "zero within 30 s",
            "Section 4, Figures 2-5",
            "All parameter errors have gone to zero within 30 s",
            tuple(_worst_finding(name, run.relative_errors) for name, run in runs.items()),
        ),
        Claim(
            "k leaves the estimates alone",
            "Section 4",
            "The attenuation factor does not influence the accuracy of the estimates",
            tuple(_spread_finding(name, points) for name, points in attenuation.items()),
        ),
        Claim(
            "any controller",
            "Abstract",
            "The observer works with any control that sustains an exciting motion",
            findings(
                "worst relative error at 30 s", {"PD": other_controller_error}, "<=", ZERO_SHARE
            ),
        ),
    ]


def _worst_finding(reading: str, errors: Mapping[str, float]) -> Finding:
    worst = max(errors, key=lambda name: errors[name])
    quantity = f"worst relative error at 30 s, {worst}"
    return Finding(reading, quantity, errors[worst], "<=", ZERO_SHARE)


def _spread_finding(reading: str, points: list[AttenuationPoint]) -> Finding:
    ends = f"k = {points[0].k:g} to {points[-1].k:g}"
    spread = float(np.ptp([point.largest_relative_error for point in points]))
    quantity = f"spread of the worst relative error, {ends}"
    return Finding(reading, quantity, spread, "<=", NO_INFLUENCE)


def _late_rate(case: TheoremCase) -> float:
    """The largest rate that is left, over the largest first error."""
    initial = max(abs(limit.first) for limit in case.limits)
    return max(limit.largest_rate for limit in case.limits) / initial


def _worst_remaining(case: TheoremCase) -> float:
    return max(abs(limit.last / limit.first) for limit in case.limits)


def _slope(points: list[AttenuationPoint]) -> float:
    """Slope of the logarithm of the tracking error over that of k."""
    errors = [point.max_tracking_error for point in points]
    return float(np.polyfit(np.log([point.k for point in points]), np.log(errors), 1)[0])


def _at(points: list[AttenuationPoint], k: float) -> AttenuationPoint:
    return next(point for point in points if point.k == k)
