"""Table I of Huang (2003), and the readings of the printed feedback gains.

The print leaves open how the factor k enters the three gains of eq. (11). Four readings make sense;
two of them give an unstable loop at once, the other two each support some of the paper's claims.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.estimators.excitation import Excitation, excitation
from flexid.models.flexible_joint import flexible_joint
from flexid.models.physical import joint_coefficients
from flexid.paper.laws import robust_law
from flexid.paper.loop import Multisine
from flexid.simulation.closed_loop import ClosedLoop, Run, loop_kernel, simulate
from flexid.simulation.lyapunov import LyapunovMonitor, monitor_run, row_histories

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
EARLIER_ATTENUATION = 1000.0  # k of the work that the paper takes its control law from
OBSERVER_GAIN = 1.0  # c1 = c2
INITIAL_ESTIMATES = {"theta1": 2.5, "theta2": 50.0, "alpha1": 166.7, "alpha2": 0.167}
DURATION = 30.0  # s, of the runs in Figures 1 to 5
TRUE = joint_coefficients(PHYSICAL)  # theta1, theta2, alpha1, alpha2 and beta1
UNKNOWN = tuple(INITIAL_ESTIMATES)  # the coefficients that the observer estimates


def sine(amplitude: float, offset: float = 0.0) -> Multisine:
    """The reference offset + amplitude sin ωt; with amplitude 0 it stands still."""
    return Multisine((amplitude,), (FREQUENCY,), offset=offset)


def table1_loop(
    exponents: Exponents,  # reading of the feedback gains
    k: float = ATTENUATION,
    reference: Multisine | None = None,
    observer_gains: tuple[float, float] = (OBSERVER_GAIN, OBSERVER_GAIN),  # c1 and c2
    initial_state: Sequence[float] = (),
    physical: Mapping[str, float] = PHYSICAL,
) -> ClosedLoop:
    """Build the closed loop of the paper's simulation."""
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


TOLERANCE = 1e-8  # relative, of every run; parameter errors at 30 s then have 7 digits or more
STEADY_FROM = 20.0  # s, from which the motion counts as its steady state
HALF_PERIOD = np.pi / FREQUENCY  # s, after which r rᵀ repeats, r being odd in the reference

MEANINGS: dict[Exponents, str] = {
    (1, 1, 0): "literal: k³ cancels",
    (1, 1, 1): "one gain k throughout",
    (1, 1, 3): "smallest edit of the print",
    (1, 2, 3): "inner loops k times faster",
}
# The loop of these stays bounded long enough for Figures 1 to 5.
SIMULATED: tuple[Exponents, ...] = ((1, 2, 3), (1, 1, 3))

_SAMPLE_TIME = 1e-3
_TRANSIENT = 0.02  # s; the largest velocities and torques occur within the first milliseconds
_TRANSIENT_SAMPLE_TIME = 1e-6
_EARLY = 0.3  # s; later an unstable reading leaves what an integrator can follow
_SETTLING = 5.0  # s, four periods of the reference


@dataclass(frozen=True, eq=False)
class SteadyRun:
    """A reading simulated with Table I over 30 s."""

    run: Run  # sampled at 1 kHz
    monitor: LyapunovMonitor  # Theorem 1 along it; limits over the last 5 s
    excitation: dict[str, Excitation]  # (A4) of each row over the last 10 s
    peak_torque: float  # largest |u| in N m; the first instants are resolved
    peak_motor_velocity: float  # largest |x4| in rad/s, likewise

    @property
    def parameter_errors(self) -> dict[str, float]:
        """θ̂ - θ and α̂ - α at the end, signed."""
        return self.run.final_errors()

    @property
    def relative_errors(self) -> dict[str, float]:
        """Magnitudes of the errors at the end, in shares of the true values."""
        return {name: abs(error) / TRUE[name] for name, error in self.parameter_errors.items()}

    @property
    def max_tracking_error(self) -> float:
        """Largest |x1 - qd| of the steady state, in rad."""
        return self.run.largest_tracking_error(STEADY_FROM, DURATION)

    @property
    def estimates(self) -> dict[str, float]:
        """Estimates of the coefficients at the end."""
        return {name: TRUE[name] + self.parameter_errors[name] for name in UNKNOWN}


@dataclass(frozen=True, eq=False)
class Reading:
    """One reading of the feedback gains."""

    exponents: Exponents  # powers of k in the three gains
    meaning: str  # how it comes about
    # (4,), poles in 1/s of the loop linearised about rest at qd = 0, rightmost first
    poles: NDArray[np.complex128]
    early_tracking_error: float  # largest |x1 - qd| of Table I in rad within the first 0.3 s
    simulated: SteadyRun | None  # its run with Table I over 30 s, where there is one

    @property
    def name(self) -> str:
        """The exponents as text, for example ``"1,2,3"``."""
        return reading_name(self.exponents)

    @property
    def rightmost(self) -> complex:
        """The pole with the largest real part, in 1/s; of a pair the upper one."""
        return complex(self.poles[0])


def reading_name(exponents: Exponents) -> str:
    """Text of a reading, for example ``"1,2,3"``."""
    return ",".join(map(str, exponents))


def simulated_runs(readings: Mapping[str, Reading]) -> dict[str, SteadyRun]:
    """Runs of those readings that were simulated over 30 s, by name, (1,2,3) first."""
    chosen = (readings[reading_name(exponents)] for exponents in SIMULATED)
    return {reading.name: reading.simulated for reading in chosen if reading.simulated}


def study_reading(exponents: Exponents) -> Reading:
    """Find the poles of a reading, and simulate it if it is one of `SIMULATED`."""
    return Reading(
        exponents,
        MEANINGS[exponents],
        closed_loop_poles(exponents),
        _early_tracking_error(exponents),
        simulate_reading(exponents) if exponents in SIMULATED else None,
    )


def closed_loop_poles(exponents: Exponents, k: float = ATTENUATION) -> NDArray[np.complex128]:
    """Poles of the closed loop, linearised about rest at qd = 0."""
    loop = table1_loop(exponents, k, reference=sine(0.0))
    kernel = loop_kernel(loop.declaration)
    z = np.zeros(kernel.SIZE)  # rest at qd = 0 is the origin of the law's error coordinates
    rates, slope = np.empty(kernel.SIZE), np.empty(kernel.SIZE)
    jacobian = np.zeros((kernel.SIZE, kernel.SIZE))
    kernel.rates_and_jacobian(0.0, z, loop.parameters, rates, jacobian, slope)
    # The parameter errors do not act back on the motion, so its block stands alone.
    states = kernel.N_STATES
    poles = np.linalg.eigvals(jacobian[:states, :states])
    return np.array(sorted(map(complex, poles), key=lambda pole: (-pole.real, -pole.imag)))


def _early_tracking_error(exponents: Exponents) -> float:
    run = simulate(table1_loop(exponents), _EARLY, _SAMPLE_TIME, TOLERANCE)
    return run.largest_tracking_error(0.0, _EARLY)


def simulate_reading(exponents: Exponents) -> SteadyRun:
    """Simulate Table I under a reading and look at the run."""
    loop = table1_loop(exponents)
    run = simulate(loop, DURATION, _SAMPLE_TIME, TOLERANCE)
    first = simulate(loop, _TRANSIENT, _TRANSIENT_SAMPLE_TIME, TOLERANCE)
    steady = run.between(STEADY_FROM, DURATION)
    return SteadyRun(
        run,
        monitor_run(run, _SETTLING),
        {
            history.row: excitation(history.row, history.coefficients, history.regressors[steady])
            for history in row_histories(run)
        },
        _largest(first.inputs, run.inputs),
        _largest(first.states[:, 3], run.states[:, 3]),
    )


def _largest(*signals: NDArray[np.float64]) -> float:
    return float(max(np.abs(signal).max() for signal in signals))
