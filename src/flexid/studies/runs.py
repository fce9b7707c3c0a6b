"""Simulations of Huang (2003): Table I, readings of (11), a sweep of k, cases of Theorem 1."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.estimators.excitation import Excitation, decay_rate, excitation
from flexid.models.flexible_joint import flexible_joint
from flexid.models.physical import joint_coefficients
from flexid.paper.laws import robust_law
from flexid.paper.loop import Multisine
from flexid.simulation.closed_loop import ClosedLoop, Run, loop_kernel, simulate
from flexid.simulation.lyapunov import (
    Limit,
    LyapunovMonitor,
    monitor_run,
    row_excitation,
    row_histories,
)

Exponents = tuple[int, int, int]  # powers of k in the three feedback gains: a reading of (11)

# Table I and section 5, in SI units.
PHYSICAL = {
    "gravity_torque": 5.0,
    "link_inertia": 1.0,
    "joint_stiffness": 100.0,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.1,
}
AMPLITUDE, FREQUENCY = 3.0, 5.0  # of the reference A sin ωt
ATTENUATION = 50.0  # k
EARLIER_ATTENUATION = 1000.0  # k in the paper's source of the control law
OBSERVER_GAIN = 1.0  # c1 = c2
INITIAL_ESTIMATES = {"theta1": 2.5, "theta2": 50.0, "alpha1": 166.7, "alpha2": 0.167}
DURATION = 30.0  # s, of the runs in Figures 1 to 5
TRUE = joint_coefficients(PHYSICAL)  # theta1, theta2, alpha1, alpha2 and beta1
UNKNOWN = tuple(INITIAL_ESTIMATES)  # the coefficients that the observer estimates


def sine(amplitude: float, offset: float = 0.0) -> Multisine:
    """Return the reference offset + amplitude sin ωt, which is constant for amplitude 0."""
    return Multisine((amplitude,), (FREQUENCY,), offset=offset)


def table1_loop(
    exponents: Exponents,  # reading of the feedback gains
    k: float = ATTENUATION,
    reference: Multisine | None = None,
    observer_gains: tuple[float, float] = (OBSERVER_GAIN, OBSERVER_GAIN),  # c1 and c2
    initial_state: Sequence[float] = (),
    physical: Mapping[str, float] = PHYSICAL,
) -> ClosedLoop:
    """Return the closed loop of the paper's simulation."""
    true = joint_coefficients(physical)
    return ClosedLoop(
        flexible_joint(known={"beta1": true["beta1"]}),
        {name: true[name] for name in UNKNOWN},
        robust_law(k, exponents),
        reference or sine(AMPLITUDE),
        dict(zip(("link", "motor"), observer_gains, strict=True)),
        INITIAL_ESTIMATES,
        initial_state,
    )


TOLERANCE = 1e-8  # relative, of every run; gives parameter errors at 30 s 7 digits or more
STEADY_FROM = 20.0  # s, beginning of the steady state
HALF_PERIOD = np.pi / FREQUENCY  # s, period of r rᵀ, since r is odd in the reference

MEANINGS: dict[Exponents, str] = {
    (1, 1, 0): "literal: k³ cancels",
    (1, 1, 1): "one gain k throughout",
    (1, 1, 3): "smallest edit of the print",
    (1, 2, 3): "inner loops k times faster",
}
# Readings whose loop stays bounded long enough for Figures 1 to 5.
SIMULATED: tuple[Exponents, ...] = ((1, 2, 3), (1, 1, 3))

_SAMPLE_TIME = 1e-3
_TRANSIENT = 0.02  # s; the largest velocities and torques occur within the first milliseconds
_TRANSIENT_SAMPLE_TIME = 1e-6
_EARLY = 0.3  # s; later an unstable reading diverges beyond any integrator
_SETTLING = 5.0  # s, four periods of the reference


@dataclass(frozen=True, eq=False)
class SteadyRun:
    """Simulation of a reading with Table I over 30 s, and its measures."""

    run: Run  # sampled at 1 kHz
    monitor: LyapunovMonitor  # Theorem 1 along it; limits over the last 5 s
    excitation: dict[str, Excitation]  # (A4) of each row over the last 10 s
    peak_torque: float  # largest |u| in N m, with a resolved initial transient
    peak_motor_velocity: float  # largest |x4| in rad/s, also with the initial transient

    @property
    def parameter_errors(self) -> dict[str, float]:
        """θ̂ - θ and α̂ - α at the end, signed."""
        return self.run.final_errors()

    @property
    def relative_errors(self) -> dict[str, float]:
        """Magnitudes of the errors at the end over the true values."""
        return {name: abs(error) / TRUE[name] for name, error in self.parameter_errors.items()}

    @property
    def max_tracking_error(self) -> float:
        """Largest |x1 - qd| in the steady state, in rad."""
        return self.run.largest_tracking_error(STEADY_FROM, DURATION)

    @property
    def estimates(self) -> dict[str, float]:
        """Estimates of the coefficients at the end."""
        return {name: TRUE[name] + self.parameter_errors[name] for name in UNKNOWN}


@dataclass(frozen=True, eq=False)
class Reading:
    """One interpretation of the feedback gains printed in (11)."""

    exponents: Exponents  # powers of k in the three gains
    meaning: str  # description
    # (4,), poles in 1/s of the loop linearised about rest at qd = 0, rightmost first
    poles: NDArray[np.complex128]
    early_tracking_error: float  # largest |x1 - qd| of Table I in rad within the first 0.3 s
    simulated: SteadyRun | None  # run with Table I over 30 s, if any

    @property
    def name(self) -> str:
        """Exponents as text, for example ``"1,2,3"``."""
        return reading_name(self.exponents)

    @property
    def rightmost(self) -> complex:
        """Pole with the largest real part, in 1/s; of a complex pair the upper one."""
        return complex(self.poles[0])


def reading_name(exponents: Exponents) -> str:
    """Return the text for a reading, for example ``"1,2,3"``."""
    return ",".join(map(str, exponents))


def study_reading(exponents: Exponents) -> Reading:
    """Compute the poles of a reading, and simulate it over 30 s if it is one of `SIMULATED`."""
    early = simulate(table1_loop(exponents), _EARLY, _SAMPLE_TIME, TOLERANCE)
    return Reading(
        exponents,
        MEANINGS[exponents],
        closed_loop_poles(exponents),
        early.largest_tracking_error(0.0, _EARLY),
        simulate_reading(exponents) if exponents in SIMULATED else None,
    )


def closed_loop_poles(exponents: Exponents, k: float = ATTENUATION) -> NDArray[np.complex128]:
    """Return the poles of the closed loop, linearised about rest at qd = 0."""
    loop = table1_loop(exponents, k, reference=sine(0.0))
    kernel = loop_kernel(loop.declaration)
    z = np.zeros(kernel.SIZE)  # rest at qd = 0 is the origin of the law's error coordinates
    rates, slope = np.empty(kernel.SIZE), np.empty(kernel.SIZE)
    jacobian = np.zeros((kernel.SIZE, kernel.SIZE))
    kernel.rates_and_jacobian(0.0, z, loop.parameters, rates, jacobian, slope)
    # The parameter errors do not affect the motion, so its block alone gives the poles.
    states = kernel.N_STATES
    poles = np.linalg.eigvals(jacobian[:states, :states])
    return np.array(sorted(map(complex, poles), key=lambda pole: (-pole.real, -pole.imag)))


def simulate_reading(exponents: Exponents) -> SteadyRun:
    """Simulate Table I with a reading and compute the measures of the run."""
    loop = table1_loop(exponents)
    run = simulate(loop, DURATION, _SAMPLE_TIME, TOLERANCE)
    first = simulate(loop, _TRANSIENT, _TRANSIENT_SAMPLE_TIME, TOLERANCE)
    steady = run.between(STEADY_FROM, DURATION)
    return SteadyRun(
        run,
        monitor_run(run, _SETTLING),
        row_excitation(run, steady),
        _largest(first.inputs, run.inputs),
        _largest(first.states[:, 3], run.states[:, 3]),
    )


def _largest(*signals: NDArray[np.float64]) -> float:
    return float(max(np.abs(signal).max() for signal in signals))


ATTENUATIONS = (15.0, 25.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # k in 1/s
_SWEEP_TOLERANCE = 1e-6  # relative; the sweeps need three digits

_FLOOR = 1e-8  # over the first parameter error; below it integration errors matter


@dataclass(frozen=True)
class AttenuationPoint:
    """Simulation of a reading with one attenuation factor."""

    k: float  # in 1/s
    max_tracking_error: float  # largest |x1 - qd| over 20 to 30 s, in rad
    parameter_errors: dict[str, float]  # errors of the estimates at 30 s, signed
    largest_real_part: float  # of the closed loop's poles, in 1/s

    @property
    def largest_relative_error(self) -> float:
        """Largest error of an estimate at 30 s, over the true value."""
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
    """Return the largest |u| in N m with an attenuation factor, from the first 0.02 s."""
    loop = table1_loop(exponents, k)
    run = simulate(loop, 0.02, 1e-3 / k, TOLERANCE)
    return float(np.abs(run.inputs).max())


def steady_condition(amplitude: float = AMPLITUDE) -> float:
    """Return the condition number of f's Gram matrix along an exactly tracked sinusoid."""
    time = np.linspace(0.0, 2 * HALF_PERIOD, 4000, endpoint=False)
    reference = sine(amplitude)
    position, acceleration = reference.evaluate(time), reference.evaluate(time, 2)
    deflection = -(acceleration + TRUE["theta1"] * np.sin(position)) / TRUE["theta2"]
    f = np.column_stack((-np.sin(position), -deflection))
    return excitation("link", UNKNOWN[:2], f).condition_number


_SMALL_AMPLITUDE = 0.1  # rad: amplitude at which the functions in f are nearly dependent

_STANDSTILL = 1.0  # constant reference in rad


@dataclass(frozen=True, eq=False)
class TheoremCase:
    """Run that demonstrates one case of Theorem 1."""

    name: str
    reference: str  # as text
    duration: float  # length of the run in s
    judged: tuple[str, ...]  # rows to which the case applies
    monitor: LyapunovMonitor  # V, and limits of the errors in the last 5 % of the run
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
        """Whether all judged errors have vanished."""
        return all(limit.vanished for limit in self.limits)

    @property
    def remaining(self) -> float:
        """Largest ratio of the last to the first error."""
        return max(abs(limit.last / limit.first) for limit in self.limits)

    @property
    def worst_condition(self) -> float:
        """Largest condition number of the judged rows' normalised Gram matrices."""
        return max(self.excitation[row].condition_number for row in self.judged)


# If (A4) fails, errors must settle at the part of p̃(0) that is orthogonal to the regressors.
CASES = (
    # Table I, ten times as long as in the paper: all errors vanish
    ("(A4) holds", AMPLITUDE, 0.0, 300.0, ("link", "motor")),
    # Every regressor is constant, so the error of each row keeps one direction
    ("(A4) fails: standstill", 0.0, _STANDSTILL, 6000.0, ("link", "motor")),
    # sin x1 and x1 - x3 are proportional except for terms in x1³
    ("(A4) nearly fails", _SMALL_AMPLITUDE, 0.0, 1500.0, ("link",)),
)
"""Cases in the order of the theorem: name, amplitude and offset, duration, judged rows."""


def theorem_case(
    name: str, amplitude: float, offset: float, duration: float, judged: tuple[str, ...]
) -> TheoremCase:
    """Run one of `CASES`."""
    reference = f"{amplitude:g} sin {FREQUENCY:g}t rad" if amplitude else f"{offset:g} rad"
    # At standstill the run starts in the equilibrium of spring and gravity, so that no transient
    # excites the observer.
    held = offset + TRUE["theta1"] / TRUE["theta2"] * np.sin(offset)
    loop = table1_loop(
        (1, 2, 3), reference=sine(amplitude, offset), initial_state=(offset, 0.0, held, 0.0)
    )
    run = simulate(loop, duration, duration / 15_000, TOLERANCE)
    half = run.between(0.5 * duration, duration)
    return TheoremCase(
        name,
        reference,
        duration,
        judged,
        monitor_run(run, 0.05 * duration),
        row_excitation(run, half),
        {
            history.row: decay_rate(
                run.time,
                history.errors,
                4 * HALF_PERIOD,
                _FLOOR * float(np.linalg.norm(history.errors[0])),
            )
            for history in row_histories(run)
        },
    )
