"""All runs of the study, in order, and what they amount to."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

from flexid.control.laws import pd_gravity
from flexid.simulation.closed_loop import simulate
from flexid.studies.cases import (
    ATTENUATIONS,
    CASES,
    AttenuationPoint,
    RatePoint,
    TheoremCase,
    attenuation_point,
    late_tracking_errors,
    peak_torque,
    rate_points,
    theorem_case,
)
from flexid.studies.claims import Claim, decide_claims
from flexid.studies.readings import (
    ATTENUATION,
    DURATION,
    EARLIER_ATTENUATION,
    MEANINGS,
    TRUE,
    Exponents,
    Reading,
    SteadyRun,
    reading_name,
    simulated_runs,
    study_reading,
    table1_loop,
)

_T = TypeVar("_T")

LATE = (60.0, 120.0)
"""Ends in s of the longer runs under (1,1,3), whose oscillation grows."""

# The ringing of (1,1,3) costs steps in proportion to k: above 400 a million and more.
_SWEEPS: dict[Exponents, float] = {(1, 2, 3): EARLIER_ATTENUATION, (1, 1, 3): 100.0}


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Huang (2003) reproduced."""

    readings: dict[str, Reading]  # the four readings of the feedback gains by name
    # tracking and parameter errors over k, by reading
    attenuation: dict[str, list[AttenuationPoint]]
    # largest tracking error in rad under (1,1,3) over the 10 s before each time in s
    late_tracking_errors: dict[float, float]
    rates: dict[str, list[RatePoint]]  # exponential rate over the observer's gain, by row
    cases: tuple[TheoremCase, ...]  # Theorem 1 in three cases
    claims: tuple[Claim, ...]  # the paper's claims, decided

    @property
    def runs(self) -> dict[str, SteadyRun]:
        """Runs of the readings that were simulated over 30 s, by name."""
        return simulated_runs(self.readings)


def reproduce(finished: Callable[[str], None]) -> Reproduction:
    """Run the whole study; `finished` is called with the name of each part."""

    def done(name: str, result: _T) -> _T:
        finished(name)
        return result

    readings = {
        reading_name(e): done(f"reading ({reading_name(e)})", study_reading(e)) for e in MEANINGS
    }
    runs = simulated_runs(readings)
    attenuation = {
        reading_name(e): done(
            f"attenuation factor ({reading_name(e)})",
            [attenuation_point(e, k) for k in ATTENUATIONS if k <= largest],
        )
        for e, largest in _SWEEPS.items()
    }
    peaks = {k: peak_torque((1, 2, 3), k) for k in (ATTENUATION, EARLIER_ATTENUATION)}
    late = done("longer run", late_tracking_errors((1, 1, 3), LATE))
    cases = tuple(done("case of Theorem 1", theorem_case(*case)) for case in CASES)
    rates = done("rates of convergence", rate_points())
    other = done("another controller", error_under_pd())
    claims = done("claims", decide_claims(readings, runs, attenuation, peaks, rates, cases, other))
    return Reproduction(readings, attenuation, late, rates, cases, claims)


def error_under_pd() -> float:
    """Worst relative error of the estimates at 30 s if a PD law follows Table I's reference."""
    loop = replace(table1_loop((1, 2, 3)), controller=pd_gravity())
    run = simulate(loop, DURATION, 0.01, 1e-8)
    return max(abs(error) / TRUE[name] for name, error in run.final_errors().items())
