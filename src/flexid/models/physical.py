"""Physical parameters of the flexible joint from its lumped coefficients, and back.

Every physical parameter is a product of powers of the coefficients, for example

    joint_stiffness ke = alpha1 / beta1,    link_inertia Jl = ke / theta2,

so that the map, its inverse and its derivative all follow from one table of exponents.
`Huang (2003)`, section 3, with the motor inertia 1/beta1 known; here beta1 may be unknown too.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from math import prod

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PhysicalParameter:
    """A product of powers of coefficients.

    Parameters
    ----------
    name, unit : str
        Name and SI unit; ``{input}`` in the unit stands for the unit of the input.
    exponents : mapping of str to int
        Coefficient name to exponent.
    """

    name: str
    unit: str
    exponents: Mapping[str, int]

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value of the parameter; infinite where a denominator is zero."""
        try:
            return prod(coefficients[c] ** power for c, power in self.exponents.items())
        except ZeroDivisionError:
            return float("inf")

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative of the value with respect to the named coefficients, shape (n_names,)."""
        return np.array([self._derivative(name, coefficients) for name in names])

    def _derivative(self, name: str, coefficients: Mapping[str, float]) -> float:
        power = self.exponents.get(name, 0)
        if power == 0:
            return 0.0
        lowered = PhysicalParameter(self.name, self.unit, {**self.exponents, name: power - 1})
        return power * lowered.value(coefficients)


_JOINT_STIFFNESS = {"alpha1": 1, "beta1": -1}
_LINK_INERTIA = {"alpha1": 1, "beta1": -1, "theta2": -1}

_WITH_TORQUE = (
    PhysicalParameter("gravity_torque", "N m", {"theta1": 1, **_LINK_INERTIA}),
    PhysicalParameter("link_inertia", "kg m^2", _LINK_INERTIA),
    PhysicalParameter("joint_stiffness", "N m/rad", _JOINT_STIFFNESS),
    PhysicalParameter("motor_inertia", "kg m^2", {"beta1": -1}),
    PhysicalParameter("motor_viscous_friction", "N m s/rad", {"alpha2": 1, "beta1": -1}),
    PhysicalParameter("motor_coulomb_friction", "N m", {"alpha_coulomb": 1, "beta1": -1}),
    PhysicalParameter("motor_offset_torque", "N m", {"alpha_offset": 1, "beta1": -1}),
    PhysicalParameter("joint_damping", "N m s/rad", {"alpha_damping": 1, "beta1": -1}),
    PhysicalParameter("cubic_joint_stiffness", "N m/rad^3", {"alpha_cubic": 1, "beta1": -1}),
    PhysicalParameter("link_viscous_friction", "N m s/rad", {"theta_viscous": 1, **_LINK_INERTIA}),
    PhysicalParameter("link_coulomb_friction", "N m", {"theta_coulomb": 1, **_LINK_INERTIA}),
    PhysicalParameter("link_offset_torque", "N m", {"theta_offset": 1, **_LINK_INERTIA}),
)
"""What the coefficients give when the input is a torque, so that beta1 = 1 / motor inertia."""

_RATIOS = (
    PhysicalParameter("gravity_torque_per_link_inertia", "1/s^2", {"theta1": 1}),
    PhysicalParameter("joint_stiffness_per_link_inertia", "1/s^2", {"theta2": 1}),
    PhysicalParameter("joint_stiffness_per_motor_inertia", "1/s^2", {"alpha1": 1}),
    PhysicalParameter("link_inertia_per_motor_inertia", "1", {"alpha1": 1, "theta2": -1}),
    PhysicalParameter(
        "gravity_torque_per_motor_inertia", "1/s^2", {"theta1": 1, "alpha1": 1, "theta2": -1}
    ),
    PhysicalParameter("viscous_friction_per_motor_inertia", "1/s", {"alpha2": 1}),
    PhysicalParameter("coulomb_friction_per_motor_inertia", "1/s^2", {"alpha_coulomb": 1}),
    PhysicalParameter("joint_damping_per_motor_inertia", "1/s", {"alpha_damping": 1}),
    PhysicalParameter("viscous_friction_per_link_inertia", "1/s", {"theta_viscous": 1}),
    PhysicalParameter("coulomb_friction_per_link_inertia", "1/s^2", {"theta_coulomb": 1}),
    PhysicalParameter("input_gain_per_motor_inertia", "rad/s^2/{input}", {"beta1": 1}),
)
"""What is left when the input is no torque: nothing absolute, only ratios."""


def physical_parameters(
    coefficients: Collection[str], input_is_torque: bool
) -> tuple[PhysicalParameter, ...]:
    """Physical parameters that a set of coefficients determines.

    Parameters
    ----------
    coefficients : collection of str
        Names of all coefficients whose value is estimated or known.
    input_is_torque : bool
        Whether the input is a torque in N m. If not, only ratios are known.

    Returns
    -------
    tuple of PhysicalParameter
    """
    table = _WITH_TORQUE if input_is_torque else _RATIOS
    return tuple(p for p in table if set(p.exponents) <= set(coefficients))


def lumped_coefficients(
    *,
    gravity_torque: float,
    link_inertia: float,
    joint_stiffness: float,
    motor_inertia: float,
    motor_viscous_friction: float,
) -> dict[str, float]:
    """Coefficients of the paper's flexible joint from its physical parameters.

    Parameters
    ----------
    gravity_torque : float
        mgl in N m.
    link_inertia, motor_inertia : float
        Jl and Jr in kg m².
    joint_stiffness : float
        ke in N m/rad.
    motor_viscous_friction : float
        μ in N m s/rad.

    Returns
    -------
    dict
        theta1, theta2, alpha1, alpha2 and beta1.  # Huang (2003), below eq. (4)

    Examples
    --------
    >>> table1 = lumped_coefficients(
    ...     gravity_torque=5, link_inertia=1, joint_stiffness=100, motor_inertia=0.25,
    ...     motor_viscous_friction=0.1,
    ... )
    >>> table1["theta1"], table1["alpha1"], table1["beta1"]
    (5.0, 400.0, 4.0)
    """
    return {
        "theta1": gravity_torque / link_inertia,
        "theta2": joint_stiffness / link_inertia,
        "alpha1": joint_stiffness / motor_inertia,
        "alpha2": motor_viscous_friction / motor_inertia,
        "beta1": 1 / motor_inertia,
    }
