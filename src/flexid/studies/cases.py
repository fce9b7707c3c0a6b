"""Theorem 1 of Huang (2003) in three cases, and a sweep over the factor k.

The cases: (A4) holds, fails altogether, nearly fails. In each the observer runs in the closed loop
of the paper under gains (1,2,3); only the reference differs. Where (A4) fails, the errors must
settle on the directions that the motion does not excite: the part of p̃(0) orthogonal to the
regressors.
"""

from dataclasses import dataclass

import numpy as np

from flexid.estimators.excitation import Excitation, decay_rate, excitation
from flexid.simulation.closed_loop import simulate
from flexid.simulation.lyapunov import (
    Limit,
    LyapunovMonitor,
    RowHistory,
    monitor_run,
    row_histories,
)
from flexid.studies.readings import (
    AMPLITUDE,
    DURATION,
    FREQUENCY,
    HALF_PERIOD,
    STEADY_FROM,
    TOLERANCE,
    TRUE,
    UNKNOWN,
    Exponents,
    closed_loop_poles,
    sine,
    table1_loop,
)

ATTENUATIONS = (15.0, 25.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # k in 1/s
_SWEEP_TOLERANCE = 1e-6  # relative tolerance of the sweeps, whose numbers need three digits

_SAMPLE_TIME = 1e-3
_FLOOR = 1e-8  # of the first parameter error; below it the integrator's error may show


@dataclass(frozen=True)
class AttenuationPoint:
    """One reading at one attenuation factor."""

    k: float  # in 1/s
    max_tracking_error: float  # largest |x1 - qd| over 20 to 30 s, in rad
    parameter_errors: dict[str, float]  # errors of the estimates at 30 s, signed
    largest_real_part: float  # of the closed loop's poles, in 1/s

    @property
    def largest_relative_error(self) -> float:
        """Largest error of an estimate at 30 s, as a share of the true value."""
        return max(abs(self.parameter_errors[name]) / TRUE[name] for name in UNKNOWN)


def attenuation_point(exponents: Exponents, k: float) -> AttenuationPoint:
    """Simulate Table I with another attenuation factor."""
    run = simulate(table1_loop(exponents, k), DURATION, 2 * _SAMPLE_TIME, _SWEEP_TOLERANCE)
    return AttenuationPoint(
        k,
        run.largest_tracking_error(STEADY_FROM, DURATION),
        run.final_errors(),
        float(closed_loop_poles(exponents, k).real.max()),
    )


def peak_torque(exponents: Exponents, k: float) -> float:
    """Largest |u| in N m under Table I with another attenuation factor, in the first instants."""
    loop = table1_loop(exponents, k)
    run = simulate(loop, 0.02, 1e-3 / k, TOLERANCE)
    return float(np.abs(run.inputs).max())


def steady_condition(amplitude: float = AMPLITUDE) -> float:
    """Condition number of the normalised Gram matrix of f along a small or large sinusoid.

    Exact tracking is assumed: x1 = A sin ωt, and the deflection follows from the link's row.
    """
    time = np.linspace(0.0, 2 * HALF_PERIOD, 4000, endpoint=False)
    reference = sine(amplitude)
    position, acceleration = reference.evaluate(time), reference.evaluate(time, 2)
    deflection = -(acceleration + TRUE["theta1"] * np.sin(position)) / TRUE["theta2"]
    f = np.column_stack((-np.sin(position), -deflection))
    return excitation("link", UNKNOWN[:2], f).condition_number


_SMALL_AMPLITUDE = 0.1  # amplitude in rad at which one sinusoid leaves f nearly dependent

_STANDSTILL = 1.0  # constant reference in rad


@dataclass(frozen=True, eq=False)
class TheoremCase:
    """One run that shows one case of the theorem."""

    name: str
    reference: str  # in words
    duration: float  # length of the run in s
    judged: tuple[str, ...]  # rows whose excitation the reference was chosen for
    monitor: LyapunovMonitor  # V, and the limits of the errors over the last twentieth of the run
    excitation: dict[str, Excitation]  # (A4) by row, over the last half of the run
    decay_rates: dict[str, float]  # by row, of the errors in 1/s

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


CASES = (
    # Table I, run ten times as long as in the paper: all errors vanish
    ("(A4) holds", AMPLITUDE, 0.0, 300.0, ("link", "motor")),
    # Every regressor is constant, so each row keeps one unseen direction
    ("(A4) fails: standstill", 0.0, _STANDSTILL, 6000.0, ("link", "motor")),
    # sin x1 and x1 - x3 are proportional but for terms in x1³
    ("(A4) nearly fails", _SMALL_AMPLITUDE, 0.0, 1500.0, ("link",)),
)
"""The cases, in the order of the theorem: name, sinusoid about an offset, duration, judged rows."""


def theorem_case(
    name: str, amplitude: float, offset: float, duration: float, judged: tuple[str, ...]
) -> TheoremCase:
    """Run one of `CASES`."""
    reference = f"{amplitude:g} sin {FREQUENCY:g}t rad" if amplitude else f"{offset:g} rad"
    # Where nothing moves, the motor starts where the spring holds the link against gravity, so
    # that no transient teaches the observer anything.
    held = offset + TRUE["theta1"] / TRUE["theta2"] * np.sin(offset)
    loop = table1_loop(
        (1, 2, 3), reference=sine(amplitude, offset), initial_state=(offset, 0.0, held, 0.0)
    )
    run = simulate(loop, duration, duration / 15_000, TOLERANCE)
    half, histories = run.between(0.5 * duration, duration), row_histories(run)
    return TheoremCase(
        name,
        reference,
        duration,
        judged,
        monitor_run(run, 0.05 * duration),
        {
            history.row: excitation(history.row, history.coefficients, history.regressors[half])
            for history in histories
        },
        {
            history.row: decay_rate(run.time, history.errors, 4 * HALF_PERIOD, _floor(history))
            for history in histories
        },
    )


def _floor(history: RowHistory) -> float:
    return _FLOOR * float(np.linalg.norm(history.errors[0]))
