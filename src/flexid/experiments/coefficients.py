"""Values of a joint's coefficients, from physical parameters where a table gives those."""

from collections.abc import Collection, Mapping
from math import isfinite

from flexid.models.physical import JOINT_PARAMETERS, joint_coefficients
from flexid.toml_file import Refuse

Values = Mapping[str, float]

_INERTIAS = ("link_inertia", "motor_inertia")
_POSITIVE = ("theta2", "alpha1", "beta1")  # without spring or inertia it is no flexible joint


def plant_values(
    plant: Values, names: Collection[str], joint: bool, refuse: Refuse
) -> dict[str, float]:
    """Values of the plant's coefficients and constants, of which `names` need one."""
    values = _lumped("plant", plant, names, joint, refuse)
    for name in values:
        if name not in names:
            raise refuse(
                f"plant.{_source(name, plant)}",
                "belongs to a term that the model does not have: add that to model.terms, or "
                "remove this",
            )
    for name in names:
        if name not in values:
            raise refuse("plant", f"gives no value for the coefficient {name!r}: add one")
    for name in _POSITIVE if joint else ():
        if not values.get(name, 1.0) > 0.0:
            source = _source(name, plant)
            raise refuse(f"plant.{source}", f"is {plant[source]:g}: give a positive number")
    return values


def estimate_values(
    estimates: Values,
    unknown: Collection[str],
    names: Collection[str],
    joint: bool,
    refuse: Refuse,
) -> dict[str, float]:
    """p̂ at the start of every unknown coefficient, 0 for those left out.

    Written like the plant; among physical parameters, a guess of what is known serves the others.
    """
    values = _lumped("initial_estimates", estimates, unknown, joint, refuse)
    for name in values:
        if name not in names:
            raise refuse(
                f"initial_estimates.{_source(name, estimates)}",
                "belongs to a term that the model does not have: remove it",
            )
    return {name: values.get(name, 0.0) for name in unknown}


def exact_coefficients(
    table: str, values: Values, names: Collection[str], refuse: Refuse
) -> dict[str, float]:
    """Values of exactly these coefficients of a joint."""
    coefficients = _lumped(table, values, names, True, refuse)
    for name in coefficients:
        if name not in names:
            raise refuse(f"{table}.{name}", f"is unknown: take {', '.join(names)}")
    for name in names:
        if name not in coefficients:
            raise refuse(f"{table}.{name}", "is missing: add it")
    return coefficients


def _lumped(
    table: str, values: Values, names: Collection[str], joint: bool, refuse: Refuse
) -> dict[str, float]:
    """The values of a table by coefficient; it may hold physical parameters of a joint instead."""
    if all(name in names for name in values):
        return dict(values)
    physical = JOINT_PARAMETERS if joint else ()
    for name in values:
        if name not in names and name not in physical:
            others = f", or instead {', '.join(physical)}" if physical else ""
            raise refuse(f"{table}.{name}", f"is unknown: take {', '.join(names)}{others}")
    for name in values:
        if name in names:
            raise refuse(
                f"{table}.{name}",
                "is mixed with physical parameters: give either those or coefficients",
            )
    for name in _INERTIAS:
        if not values.get(name, 0.0) > 0.0:
            raise refuse(f"{table}.{name}", "must be there and positive: correct it")
    coefficients = joint_coefficients(values)
    for name, value in coefficients.items():
        if not isfinite(value):
            raise refuse(table, f"makes {name} infinite: choose larger inertias")
    return coefficients


def _source(coefficient: str, values: Values) -> str:
    """The key that a coefficient comes from: its own, or the physical parameter's."""
    if coefficient in values:
        return coefficient
    inertias = dict.fromkeys(_INERTIAS, 1.0)
    return next(n for n in values if coefficient in joint_coefficients({**inertias, n: 1.0}))
