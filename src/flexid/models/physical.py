"""Physical parameters of a joint from its lumped coefficients, and back.

Nearly every physical parameter is a product of powers of the coefficients, for example

    joint_stiffness ke = alpha1 / beta1,    link_inertia Jl = ke / theta2,

so that the map, its inverse and its derivative all follow from a table of exponents. The tables
stand in ``joint.toml``, by kind of joint; where the input is no torque, only ratios are known.
`Huang (2003)`, section 3, with the motor inertia 1/beta1 known; here beta1 may be unknown too.
Gravity that has a sine and a cosine is the exception: an amplitude and an angle.
"""

from collections.abc import Collection, Mapping
from math import pi
from typing import Any, Literal

from flexid.models.parameter_kinds import (
    Amplitude,
    Directional,
    PhysicalParameter,
    Product,
    ZeroAngle,
)
from flexid.models.terms import CONTENTS, DECLARED

_KINDS = {
    "product": Product,
    "amplitude": Amplitude,
    "zero_angle": ZeroAngle,
    "directional": Directional,
}


def _declared(kind: str = "product", **content: Any) -> PhysicalParameter:
    return _KINDS[kind](**content)


_TABLES: Mapping[str, tuple[PhysicalParameter, ...]] = {
    name: tuple(_declared(**content) for content in table)
    for name, table in DECLARED["parameters"].items()
}

ANGLES = frozenset(p.name for table in _TABLES.values() for p in table if isinstance(p, ZeroAngle))
"""Parameters of which a difference is taken round the circle, and no percentage makes sense."""

PARAMETER_NAMES = tuple(dict.fromkeys(p.name for table in _TABLES.values() for p in table))
"""Names of all physical parameters, of whichever joint and input."""


def physical_parameters(
    coefficients: Collection[str],
    input_is_torque: bool,
    kind: Literal["flexible", "rigid", "link"] = "flexible",
) -> tuple[PhysicalParameter, ...]:
    """Physical parameters of a joint that a set of coefficients determines.

    If the input is no torque in N m, only ratios are known; those of the link alone are relative to
    its inertia. The inertia of a rigid joint is that of motor and link together. With
    ``gravity_cosine`` among the terms, gravity is the amplitude of both its parts, and
    ``gravity_angle`` the link encoder's reading where the link hangs straight down.
    """
    known = "with_torque" if input_is_torque and kind != "link" else "ratios"
    table = _TABLES[known if kind == "flexible" else f"{kind}_{known}"]
    # Of two entries with one name the later one heeds more coefficients, and takes the place.
    found = {p.name: p for p in table if set(p.coefficients) <= set(coefficients)}
    return tuple(found.values())


def difference(name: str, a: float, b: float) -> float:
    """B's value minus A's, of an angle the shorter way round.

    Examples
    --------
    >>> round(difference("gravity_angle", 3.1, -3.1), 3)
    0.083
    >>> difference("gravity_torque", 3.0, -3.0)
    -6.0
    """
    value = b - a
    return (value + pi) % (2.0 * pi) - pi if name in ANGLES else value


TERM_PARAMETERS: Mapping[str, str] = {
    name: content["parameter"]
    for name, content in DECLARED["terms"].items()
    if "parameter" in content
}
"""The physical parameter of each term that has one."""

_LINK, _MOTOR = (
    {
        c: content["parameter"]
        for content in CONTENTS
        if "parameter" in content
        for c in content.get(side, {})
    }
    for side in ("link", "motor")
)
"""The parameter that, over its side's inertia, gives each coefficient."""


def joint_coefficients(parameters: Mapping[str, float]) -> dict[str, float]:
    """Coefficients of a flexible joint from physical parameters, both inertias among them.

    >>> table1 = joint_coefficients(
    ...     {"gravity_torque": 5, "link_inertia": 1, "joint_stiffness": 100, "motor_inertia": 0.25}
    ... )
    >>> table1["theta1"], table1["alpha1"], table1["beta1"]
    (5.0, 400.0, 4.0)
    """  # Huang (2003), below eq. (4)
    link = {
        c: parameters[n] / parameters["link_inertia"] for c, n in _LINK.items() if n in parameters
    }
    motor = {
        c: parameters[n] / parameters["motor_inertia"] for c, n in _MOTOR.items() if n in parameters
    }
    return link | motor | {"beta1": 1 / parameters["motor_inertia"]}
