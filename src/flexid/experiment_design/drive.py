"""What is believed of a drive, and within which limits it may move."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from scipy.optimize import root

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import joint_coefficients

Kind = Literal["multisine", "trajectory"]
Criterion = Literal["E", "D"]

DOUBT = 0.3
"""Relative error of every parameter that a design must bear."""

HIGHEST = 1.5
"""Frequency of the fastest tone over the resonance, where none is given."""

_RANDOM_CASES = 16

_TERMS = {
    "gravity_torque": "gravity",
    "motor_viscous_friction": "motor_viscous",
    "link_viscous_friction": "link_viscous",
    "joint_damping": "joint_damping",
    "motor_coulomb_friction": "motor_coulomb",
    "link_coulomb_friction": "link_coulomb",
    "cubic_joint_stiffness": "cubic_stiffness",
    "link_offset_torque": "link_offset",
    "motor_offset_torque": "motor_offset",
}
"""The term of the model that each optional parameter switches on."""


@dataclass(frozen=True)
class Limits:
    """Largest magnitudes: torque in N m, velocity in rad/s, position and deflection in rad.

    Velocity and position hold for link and motor.
    """

    torque: float
    velocity: float
    position: float
    deflection: float


@dataclass(frozen=True)
class Drive:
    """A drive as it is believed to be, and the experiment wanted on it."""

    parameters: Mapping[str, float]  # physical, SI units; those given make up the model
    known: tuple[str, ...]  # known exactly; only motor_inertia can be
    limits: Limits
    position_noise: float  # rad, standard deviation of each encoder
    duration: float  # s
    sample_time: float  # s
    kind: Kind  # a torque to play, or a motor position to follow
    criterion: Criterion  # the worst direction's information, or all directions'
    harmonics: int  # number of tones
    highest_frequency: float | None  # rad/s, of the tones; None: 1.5 times the resonance
    ramp: float  # s, over which the motion grows at the start and fades at the end
    bandwidth: float | None  # rad/s, of the position loop; None: the resonance

    def __post_init__(self) -> None:
        for name in self.known:
            if name != "motor_inertia":
                raise SettingError("known", f"{name!r} cannot be known alone; motor_inertia can")
        for name, value in self.parameters.items():
            if value == 0.0:
                raise SettingError(
                    f"parameters.{name}",
                    "is zero, and no share of zero can be known: leave it out, or give "
                    "the size that matters",
                )

    @property
    def resonance(self) -> float:
        """Angular frequency in rad/s of the joint's two inertias on its spring."""
        p = self.parameters
        inverse = 1.0 / p["link_inertia"] + 1.0 / p["motor_inertia"]
        return float(np.sqrt(p["joint_stiffness"] * inverse))

    @property
    def coefficients(self) -> dict[str, float]:
        """All coefficients of the model, those known among them."""
        return joint_coefficients(self.parameters)

    def case(self, parameters: Mapping[str, float], name: str = "nominal") -> "Case":
        """The model with some values of its parameters."""
        believed = replace(self, parameters=dict(parameters))
        coefficients = believed.coefficients
        terms = tuple(term for parameter, term in _TERMS.items() if parameter in parameters)
        known = {"beta1": coefficients["beta1"]} if self.known else {}
        system = flexible_joint(terms, known)
        return Case(name, system, {c: coefficients[c] for c in system.coefficients})

    @property
    def nominal(self) -> "Case":
        """The drive as it is believed to be."""
        return self.case(self.parameters)

    def cases(self, seed: int) -> Iterator["Case"]:
        """Drives whose parameters are wrong: each alone both ways, all at once at random corners.

        What is known exactly stays.
        """
        doubtful = [name for name in self.parameters if name not in self.known]
        for name, sign in product(doubtful, (-1.0, 1.0)):
            changed = {**self.parameters, name: self.parameters[name] * (1.0 + sign * DOUBT)}
            yield self.case(changed, f"{name} {100 * sign * DOUBT:+.0f} %")
        generator = np.random.default_rng(seed)
        for place in range(_RANDOM_CASES):
            signs = generator.choice([-1.0, 1.0], len(doubtful))
            corner = {
                name: self.parameters[name] * (1.0 + sign * DOUBT)
                for name, sign in zip(doubtful, signs.tolist(), strict=True)
            }
            yield self.case({**self.parameters, **corner}, f"random corner {place + 1}")


@dataclass(frozen=True, eq=False)
class Case:
    """A model with values, and where it rests."""

    name: str  # what is different about it
    system: ParametricSystem
    coefficients: Mapping[str, float]  # the unknown ones

    @property
    def values(self) -> FloatArray:
        """The coefficients' values in the model's order, shape (k,)."""
        return np.array([self.coefficients[name] for name in self.system.coefficients])

    def rest(self) -> FloatArray:
        """State of rest without torque, shape (4,); zero if constant torques leave none."""
        state = np.zeros(4)
        if not any(name.endswith("_offset") for name in self.coefficients):
            return state
        p = self.coefficients

        def torques(q: FloatArray) -> list[float]:
            twist = q[0] - q[1]
            link = p.get("theta_offset", 0.0) - p.get("theta1", 0.0) * np.sin(q[0])
            link -= p["theta2"] * twist + p.get("theta_cubic", 0.0) * twist**3
            motor = p.get("alpha_offset", 0.0) + p["alpha1"] * twist
            return [link, motor + p.get("alpha_cubic", 0.0) * twist**3]

        found = root(torques, np.zeros(2))
        if found.success:
            state[::2] = found.x
        return state
