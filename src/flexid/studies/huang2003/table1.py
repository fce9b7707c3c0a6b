"""Table I of Huang (2003) and the closed loop of its section 4, as data."""

from collections.abc import Sequence

from flexid.control.laws import robust_law
from flexid.control.references import Multisine
from flexid.models.flexible_joint import flexible_joint
from flexid.models.physical import joint_coefficients
from flexid.simulation.loop import ClosedLoop

Exponents = tuple[int, int, int]
"""Powers (a, b, c) of k in the three feedback gains: a reading of the printed law (11)."""

PHYSICAL = {
    "gravity_torque": 5.0,
    "link_inertia": 1.0,
    "joint_stiffness": 100.0,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.1,
}
"""True values of Table I: N m, kg m², N m/rad, kg m², N m s/rad."""

AMPLITUDE = 3.0
"""A of the reference A sin ωt, in rad."""

FREQUENCY = 5.0
"""ω of the reference, in rad/s."""

ATTENUATION = 50.0
"""k, in 1/s."""

EARLIER_ATTENUATION = 1000.0
"""k of the work that the paper takes its control law from."""

OBSERVER_GAIN = 1.0
"""c1 = c2."""

INITIAL_ESTIMATES = {"theta1": 2.5, "theta2": 50.0, "alpha1": 166.7, "alpha2": 0.167}
"""θ̂(0) and α̂(0): half of the true values, rounded; 1/s², 1/s², 1/s², 1/s."""

DURATION = 30.0
"""Length in s of the runs in Figures 1 to 5."""

TRUE = joint_coefficients(PHYSICAL)
"""True coefficients theta1, theta2, alpha1, alpha2 and beta1."""

UNKNOWN = tuple(INITIAL_ESTIMATES)
"""Names of the coefficients that the observer estimates."""


def sine(amplitude: float, offset: float = 0.0) -> Multisine:
    """The reference offset + amplitude sin ωt; with amplitude 0 it stands still."""
    return Multisine((amplitude,), (FREQUENCY,), offset=offset)


def table1_loop(
    exponents: Exponents,  # reading of the feedback gains
    k: float = ATTENUATION,
    reference: Multisine | None = None,
    observer_gains: tuple[float, float] = (OBSERVER_GAIN, OBSERVER_GAIN),  # c1 and c2
    initial_state: Sequence[float] = (),
) -> ClosedLoop:
    """Build the closed loop of the paper's simulation."""
    return ClosedLoop(
        flexible_joint(known={"beta1": TRUE["beta1"]}),
        {name: TRUE[name] for name in UNKNOWN},
        robust_law(k, exponents),
        reference or sine(AMPLITUDE),
        dict(zip(("link", "motor"), observer_gains, strict=True)),
        INITIAL_ESTIMATES,
        initial_state,
    )
