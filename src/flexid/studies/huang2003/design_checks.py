"""Claims about the observer's design, decided on the derived equations rather than on a run."""

from flexid.errors import AccelerationError
from flexid.models.physical import physical_parameters
from flexid.studies.huang2003.evidence import Claim, Finding
from flexid.studies.huang2003.readings import SteadyRun
from flexid.studies.huang2003.table1 import PHYSICAL, TRUE, UNKNOWN, table1_loop

ROUNDING = 1e-12
"""Relative error that floating-point arithmetic explains."""


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
                Finding("any", f"{worst}, exact coefficients", exact, "<=", ROUNDING),
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
