"""Theorem 1 of Huang (2003) in three cases: (A4) holds, fails altogether, nearly fails.

In each case the observer runs in the closed loop of the paper under gains (1,2,3); only the
reference differs. Where (A4) fails, the errors must settle on the directions that the motion does
not excite: the part of p̃(0) orthogonal to the regressors.
"""

from dataclasses import dataclass

import numpy as np

from flexid.analysis.excitation import Excitation, excitation
from flexid.analysis.histories import row_histories
from flexid.analysis.lyapunov import Limit, LyapunovMonitor, monitor_run
from flexid.simulation.closed_loop import simulate
from flexid.studies.huang2003.table1 import AMPLITUDE, FREQUENCY, TRUE, sine, table1_loop

SMALL_AMPLITUDE = 0.1
"""Amplitude in rad at which one sinusoid leaves f nearly dependent."""

STANDSTILL = 1.0
"""Constant reference in rad."""

_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class TheoremCase:
    """One run that shows one case of the theorem."""

    name: str
    reference: str  # in words
    duration: float  # length of the run in s
    judged: tuple[str, ...]  # rows whose excitation the reference was chosen for
    monitor: LyapunovMonitor  # V, and the limits of the errors over the last twentieth of the run
    excitation: dict[str, Excitation]  # (A4) by row, over the last half of the run

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Limits of the coefficients of the judged rows."""
        names = {name for row in self.judged for name in self.excitation[row].coefficients}
        return tuple(limit for limit in self.monitor.limits if limit.coefficient in names)

    @property
    def settled(self) -> bool:
        """Whether all judged errors have become constant."""
        return all(limit.settled for limit in self.limits)

    @property
    def vanished(self) -> bool:
        """Whether all judged errors are gone."""
        return all(limit.vanished for limit in self.limits)

    @property
    def worst_condition(self) -> float:
        """Largest condition number of the judged rows' normalised Gram matrices."""
        return max(self.excitation[row].condition_number for row in self.judged)


def excited_case() -> TheoremCase:
    """Table I, run ten times as long as in the paper: (A4) holds, all errors vanish."""
    reference = f"{AMPLITUDE:g} sin {FREQUENCY:g}t rad"
    return _case("(A4) holds", reference, AMPLITUDE, 0.0, 300.0, ("link", "motor"))


def standstill_case() -> TheoremCase:
    """A constant reference: every regressor is constant, so each row keeps one unseen direction."""
    return _case(
        "(A4) fails: standstill", f"{STANDSTILL:g} rad", 0.0, STANDSTILL, 6000.0, ("link", "motor")
    )


def small_case() -> TheoremCase:
    """One sinusoid of small amplitude: sin x1 and x1 - x3 are proportional but for terms in x1³."""
    reference = f"{SMALL_AMPLITUDE:g} sin {FREQUENCY:g}t rad"
    return _case("(A4) nearly fails", reference, SMALL_AMPLITUDE, 0.0, 1500.0, ("link",))


CASES = (excited_case, standstill_case, small_case)
"""The three cases, in the order of the theorem."""


def _case(
    name: str,
    reference: str,
    amplitude: float,
    offset: float,
    duration: float,
    judged: tuple[str, ...],
) -> TheoremCase:
    # Where nothing moves, the motor starts where the spring holds the link against gravity, so
    # that no transient teaches the observer anything.
    held = offset + TRUE["theta1"] / TRUE["theta2"] * np.sin(offset)
    loop = table1_loop(
        (1, 2, 3), reference=sine(amplitude, offset), initial_state=(offset, 0.0, held, 0.0)
    )
    run = simulate(loop, duration, duration / 15_000, _TOLERANCE)
    half = run.between(0.5 * duration, duration)
    return TheoremCase(
        name,
        reference,
        duration,
        judged,
        monitor_run(run, 0.05 * duration),
        {
            history.row: excitation(history.row, history.coefficients, history.regressors[half])
            for history in row_histories(run)
        },
    )
