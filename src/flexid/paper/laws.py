"""Declaration of controllers, and control laws for the flexible joint."""

import hashlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from flexid.models.expression import evaluate

MAXIMUM_REFERENCE_ORDER = 4  # highest derivative of the reference that a controller may use

REFERENCE_NAMES = ("qd", *(f"qd_{order}" for order in range(1, MAXIMUM_REFERENCE_ORDER + 1)))
"""Names of the reference and its derivatives in a controller's expressions."""


@dataclass(frozen=True)
class Controller:
    """A static feedback law."""

    name: str  # name of the law
    tracked: str  # the state that follows the reference
    # each input of the system, as a function of states, reference, parameters and definitions
    inputs: Mapping[str, str]
    # names and values; a new value needs no new derivation
    parameters: Mapping[str, float] = field(default_factory=dict)
    # auxiliary quantities in the order of computation; each may use earlier ones. Quantities
    # without a state are kept as symbols; if the time derivative of one equals another, the
    # derivation recognises this and cancels them.
    definitions: Mapping[str, str] = field(default_factory=dict)
    # coordinates in which the closed loop is well conditioned, one per state of the system, in
    # the same order; each is its state plus a function of earlier states, so that the map can be
    # inverted one by one. The plain states if left out.
    coordinates: Mapping[str, str] = field(default_factory=dict)
    # parameters computed from the others, in the order of computation; each may use earlier
    # ones. They are computed once per loop, not at every step.
    derived: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def values(self) -> dict[str, float]:
        """All parameters by name, derived ones last."""
        values = dict(self.parameters)
        for name, text in self.derived.items():
            values[name] = evaluate(text, values, f"{self.name}: {name}")
        return values

    @cached_property
    def digest(self) -> str:
        """Hash of everything that a derivation depends on, so without the parameters' values."""
        content = [
            self.name,
            self.tracked,
            list(self.inputs.items()),
            [*self.parameters, *self.derived],
            list(self.definitions.items()),
            list(self.coordinates.items()),
        ]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


NOMINAL = {
    "gravity_torque": 4.5,
    "link_inertia": 0.8,
    "joint_stiffness": 75.0,
    "motor_inertia": 0.18,
    "motor_viscous_friction": 0.07,
}
"""Nominal values of Huang (2003), Table I: N m, kg m², N m/rad, kg m², N m s/rad."""

LARGEST_LINK_INERTIA = 1.4
LARGEST_MOTOR_INERTIA = 0.42
SMALLEST_JOINT_STIFFNESS = 60.0

_DECLARED = tomllib.loads(Path(__file__).with_name("laws.toml").read_text("utf-8"))


# Huang (2003), eq. (11), whose feedback gains are ambiguous as printed. Here gain1 = k^a JlM/kem,
# gain2 = k^b, gain3 = k^c JrM; M marks the largest, m the smallest value. (1, 2, 3) makes
# each inner loop k times faster than the next outer one.
def robust_law(
    k: float = 50.0,  # gain in 1/s
    exponents: tuple[float, float, float] = (1.0, 2.0, 3.0),  # of k in the three feedback gains
    nominal: Mapping[str, float] = NOMINAL,
    largest_link_inertia: float = LARGEST_LINK_INERTIA,  # kg m²
    largest_motor_inertia: float = LARGEST_MOTOR_INERTIA,  # kg m²
    smallest_joint_stiffness: float = SMALLEST_JOINT_STIFFNESS,  # N m/rad
) -> Controller:
    """Declare the robust law (11) for the flexible joint, by default with Table I."""
    a, b, c = map(float, exponents)
    return Controller(
        **_DECLARED["robust"],
        parameters={f"nominal_{name}": nominal[name] for name in NOMINAL}
        | {
            "k": k,
            "largest_link_inertia": largest_link_inertia,
            "largest_motor_inertia": largest_motor_inertia,
            "smallest_joint_stiffness": smallest_joint_stiffness,
        },
        derived={
            "gain1": f"k**{a!r}*largest_link_inertia/smallest_joint_stiffness",
            "gain2": f"k**{b!r}",
            "gain3": f"k**{c!r}*largest_motor_inertia",
        },
    )


# P. Tomei, IEEE Transactions on Automatic Control 36 (1991) 1208. A constant reference is globally
# stable if the stiffness of joint and position loop exceeds the gradient of gravity.
def pd_gravity(
    proportional: float = 50.0,  # stiffness of the motor's position loop in N m/rad
    derivative: float = 10.0,  # its damping in N m s/rad
    nominal: Mapping[str, float] = NOMINAL,  # gravity_torque in N m, joint_stiffness in N m/rad
) -> Controller:
    """Declare a PD law with gravity compensation for the flexible joint."""
    parameters = {
        "nominal_gravity_torque": nominal["gravity_torque"],
        "nominal_joint_stiffness": nominal["joint_stiffness"],
        "proportional": proportional,
        "derivative": derivative,
    }
    return Controller(**_DECLARED["pd-gravity"], parameters=parameters)
