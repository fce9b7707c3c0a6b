"""The parts of a closed loop, made from the tables of an experiment file."""

from collections.abc import Collection, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from flexid.control.computed_torque import COEFFICIENTS, computed_torque
from flexid.control.controller import Controller
from flexid.control.pd_gravity import pd_gravity
from flexid.control.references import Multisine, constant, sinusoid
from flexid.control.robust import NOMINAL, robust_law
from flexid.errors import ExpressionError, ModelError, SettingError
from flexid.models.flexible_joint import TERMS, flexible_joint
from flexid.models.model_file import read_model
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import JOINT_PARAMETERS, joint_coefficients
from flexid.toml_file import Refuse

Table = Mapping[str, Any]

_INERTIAS = ("link_inertia", "motor_inertia")
_POSITIVE = ("theta2", "alpha1", "beta1")  # without spring or inertia it is no flexible joint


def declared_system(model: Table, folder: Path, refuse: Refuse) -> ParametricSystem:
    """The model, with the values of its constants as declared; of known coefficients 1."""
    if "file" in model:
        try:
            return read_model(folder / model["file"])
        except (ModelError, ExpressionError) as error:
            raise refuse("model.file", f"names a model that cannot be used, {error}") from None
    for place, term in enumerate(model["terms"], start=1):
        if term not in TERMS:
            raise refuse(f"model.terms.{place}", f"is {term!r}: take one of {', '.join(TERMS)}")
    known = dict.fromkeys(model["known"], 1.0)
    try:
        return flexible_joint(model["terms"], known, model["coulomb_velocity"])
    except SettingError as error:
        raise refuse("model.known", f"does not fit: {error.reason}") from None
    except ModelError as error:
        raise refuse("model", f"does not fit: {error.reason}") from None


def plant_values(
    plant: Table, names: Collection[str], joint: bool, refuse: Refuse
) -> dict[str, float]:
    """Values of the plant's coefficients and constants."""
    values = lumped("plant", plant, names, joint, refuse)
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
            raise refuse(f"plant.{_source(name, plant)}", "must be positive: correct it")
    return values


def estimate_values(
    estimates: Table,
    unknown: Collection[str],
    names: Collection[str],
    joint: bool,
    refuse: Refuse,
) -> dict[str, float]:
    """p̂ at the start of every unknown coefficient, 0 for those left out.

    Written like the plant; among physical parameters, a guess of what is known serves the others.
    """
    values = lumped("initial_estimates", estimates, unknown, joint, refuse)
    for name in values:
        if name not in names:
            raise refuse(
                f"initial_estimates.{_source(name, estimates)}",
                "belongs to a term that the model does not have: remove it",
            )
    return {name: values.get(name, 0.0) for name in unknown}


def lumped(
    table: str, values: Table, names: Collection[str], joint: bool, refuse: Refuse
) -> dict[str, float]:
    """The values of a table by coefficient, from physical parameters if it has those."""
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
                "stands beside physical parameters: give either those or coefficients",
            )
    for name in _INERTIAS:
        if not values.get(name, 0.0) > 0.0:
            raise refuse(f"{table}.{name}", "must be there and positive: correct it")
    coefficients = joint_coefficients(values)
    for name, value in coefficients.items():
        if not isfinite(value):
            raise refuse(table, f"makes {name} infinite: choose larger inertias")
    return coefficients


def _source(coefficient: str, values: Table) -> str:
    """The key that a coefficient comes from: its own, or the physical parameter's."""
    if coefficient in values:
        return coefficient
    inertias = dict.fromkeys(_INERTIAS, 1.0)
    return next(n for n in values if coefficient in joint_coefficients({**inertias, n: 1.0}))


def declared_controller(controller: Table, refuse: Refuse) -> Controller:
    """The law with its values."""
    law = controller["law"]
    if law == "expressions":
        return Controller(
            "own law",
            controller["tracked"],
            controller["inputs"],
            controller["parameters"],
            controller["definitions"],
            controller["coordinates"],
        )
    if law == "computed-torque":
        nominal = lumped("controller.nominal", controller["nominal"], COEFFICIENTS, True, refuse)
        _exactly("controller.nominal", nominal, COEFFICIENTS, refuse)
        return computed_torque(nominal, controller["poles"])
    nominal = controller["nominal"]
    if law == "pd-gravity":
        _exactly("controller.nominal", nominal, ("gravity_torque", "joint_stiffness"), refuse)
        _not_zero(nominal["joint_stiffness"], refuse)
        return pd_gravity(controller["proportional"], controller["derivative"], nominal)
    _exactly("controller.nominal", nominal, NOMINAL, refuse)
    _not_zero(nominal["joint_stiffness"], refuse)
    a, b, c = controller["exponents"]
    return robust_law(
        controller["k"],
        (a, b, c),
        nominal,
        controller["largest_link_inertia"],
        controller["largest_motor_inertia"],
        controller["smallest_joint_stiffness"],
    )


def _exactly(table: str, values: Table, names: Collection[str], refuse: Refuse) -> None:
    for name in values:
        if name not in names:
            raise refuse(f"{table}.{name}", f"is unknown: this law has {', '.join(names)}")
    for name in names:
        if name not in values:
            raise refuse(f"{table}.{name}", "is missing: add it")


def _not_zero(stiffness: float, refuse: Refuse) -> None:
    if stiffness == 0.0:
        raise refuse("controller.nominal.joint_stiffness", "is zero: the law divides by it")


def declared_reference(reference: Table, refuse: Refuse) -> Multisine:
    """The reference with its values."""
    if reference["kind"] == "constant":
        return constant(reference["value"])
    if reference["kind"] == "sine":
        return sinusoid(
            reference["amplitude"],
            reference["angular_frequency"],
            reference["phase"],
            reference["offset"],
        )
    try:
        return Multisine(
            reference["amplitudes"],
            reference["angular_frequencies"],
            reference["phases"],
            reference["offset"],
        )
    except ModelError as error:
        raise refuse("reference", error.reason) from None
