"""The rigid joint: link and motor turn as one, and one encoder shows all there is to see.

    x1' = x2
    x2' = -gamma1 sin x1 - gamma_viscous x2 - gamma_coulomb tanh(x2/w) + gamma_offset + beta1 u
          - gamma_asymmetry |x2|

x1, x2 are position and velocity at the link side of the gear. This is the flexible joint of Huang
(2003), eq. (4), for a stiffness without bound; beta1 is then the inverse of the inertia of motor
and link *together*, not of the motor alone. Viscous friction is gamma_viscous + gamma_asymmetry
forwards and gamma_viscous - gamma_asymmetry backwards.

A row of a joint may stand alone, too, driven by the measured motion of the other side. The spring
couples the two rows. Where the other side's position and velocity are measured, they are inputs
like any other, and one row needs nothing of the other row's friction, inertia or input:

    x1' = x2
    x2' = -theta1 sin x1 - theta2 (x1 - x3)

is the link of Huang (2003), eq. (4), with the motor's position x3 as its input.
"""

import re
from collections.abc import Collection, Mapping

from flexid.models.parametric_system import ParametricSystem
from flexid.models.terms import (
    COULOMB_VELOCITY,
    DECLARED,
    check_terms,
    declared_row,
    model_constants,
)

RIGID_TERMS: dict[str, dict[str, str]] = {
    term: {name: regressor for name, (regressor, _) in content.items()}
    for term, content in DECLARED["rigid"].items()
}
"""Terms that can be switched on besides the inertia, which is always there, with regressors."""

RIGID_UNITS: dict[str, str] = {
    name: unit for content in DECLARED["rigid"].values() for name, (_, unit) in content.items()
} | {"beta1": "rad/s^2/{input}"}
"""Unit of every coefficient; ``{input}`` stands for the unit of the input."""


def rigid_joint(
    terms: Collection[str],
    known: Mapping[str, float] | None = None,
    coulomb_velocity: float = COULOMB_VELOCITY["revolute"],
) -> ParametricSystem:
    """Declare a rigid joint.

    Parameters
    ----------
    terms : collection of str
        Names out of `RIGID_TERMS`; their order does not matter.
    known : mapping of str to float, optional
        Coefficients whose value is known, for example ``{"beta1": 1 / total_inertia}``.
    coulomb_velocity : float, optional
        Velocity in rad/s over which Coulomb friction changes sign; a constant of the model.

    Returns
    -------
    ParametricSystem
        One row ``rigid``, states x1 and x2, input u.

    Raises
    ------
    SettingError
        If a term or a known coefficient does not exist, or the velocity is not positive.
    """
    known = dict(known or {})
    check_terms(terms, RIGID_TERMS)
    chosen = [regressors for name, regressors in RIGID_TERMS.items() if name in terms]
    regressors = {c: r for term in chosen for c, r in term.items()} | {"beta1": "u"}
    return ParametricSystem(
        "rigid joint",
        (declared_row("rigid", "x1", "x2", regressors, known),),
        constants=model_constants(regressors, known, coulomb_velocity),
    )


def rigid_terms(flexible_terms: Collection[str]) -> tuple[str, ...]:
    """Terms of the rigid joint that a flexible joint with the given terms has in common with it.

    >>> rigid_terms(("gravity", "motor_viscous", "link_viscous", "joint_damping"))
    ('gravity', 'viscous')
    """
    found = {DECLARED["terms"].get(term, {}).get("rigid") for term in flexible_terms}
    return tuple(term for term in RIGID_TERMS if term in found)


def row_alone(system: ParametricSystem, name: str) -> ParametricSystem:
    """One row of a system, with the states of the other rows as inputs.

    >>> from flexid.models.flexible_joint import flexible_joint
    >>> row_alone(flexible_joint(), "link").inputs
    ('x3', 'x4')
    >>> row_alone(flexible_joint(), "motor").inputs
    ('x1', 'x2', 'u')
    """
    row = next(row for row in system.rows if row.name == name)
    others = [state for state in system.states if state not in (row.coordinate, row.velocity)]
    used = {*re.findall(r"[^\W\d]\w*", " ".join([*row.regressors.values(), row.known]))}
    return ParametricSystem(
        f"{system.name}, {name} alone",
        (row,),
        (*others, *(u for u in system.inputs if u in used)),
        {c: value for c, value in system.constants.items() if c in used},
        nonlinear=tuple(name for name in system.nonlinear if name in used),
    )
