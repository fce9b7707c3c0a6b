"""What is exported: a model with the values that are known of it, from a file or an estimate."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.models.flexible_joint import CONSTANT_UNITS, SQUARES
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.models.terms import SMOOTHING

if TYPE_CHECKING:
    from flexid.identification.preparation.joint import Joint
    from flexid.identification.result.identification import Identification


@dataclass(frozen=True, eq=False)
class ExportSource:
    """A model and what is known of it.

    Parameters
    ----------
    system : ParametricSystem
        The model with the terms that it has; what is given is a constant of it. Coulomb friction
        is smoothed.
    values : mapping of str to float, optional
        Values of its coefficients, where there are any.
    units : mapping of str to str, optional
        Units of its coefficients, constants and inputs, where they are known.
    identification : Identification, optional
        Where all that comes from, if it was estimated.
    """

    system: ParametricSystem
    values: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    identification: "Identification | None" = None

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is to be said of the values, in sentences."""
        found = {} if self.identification is None else self.identification.coefficients
        guessed = [name for name, c in found.items() if c.verdict == "undetermined"]
        return (f"the estimate leaves {', '.join(guessed)} undetermined",) if guessed else ()


def source_of_identification(result: "Identification") -> ExportSource:
    """The model of an identification, with the terms that were kept, and its values.

    Offsets that differ from log to log have the value of the first one. What the log says nothing
    of has no value.

    Parameters
    ----------
    result : Identification
        What was found.

    Raises
    ------
    SettingError
        If the joint remembers its path.
    """
    from flexid.identification.preparation.joint import joint_of
    from flexid.stored_estimates.rebuilt import described, given_coefficients, input_unit_of

    found = described(result, 0).coefficients
    values = {name: v for name, v in found.items() if "[" not in name}
    given = (given_coefficients(result) | SQUARES) & {*values}
    joint = joint_of(result.model)
    for name in joint.grips.keys() & values.keys():
        term = joint.of_coefficient(name) or name
        raise SettingError(
            term,
            "remembers the path of the spring, and what is exported remembers nothing: identify "
            f"with --terms {','.join(t for t in result.choices.terms if t != term)}, and export "
            "that estimate",
        )
    without = sorted(name for name in given if not isfinite(values[name]))
    if without:
        raise SettingError(without[0], "has no value in the estimate: identify once more")
    constants = {name: values[name] for name in sorted(given)} | {**result.choices.shapes}
    if result.choices.coulomb_velocity is not None:
        constants[SMOOTHING] = result.choices.coulomb_velocity
    system = _with_terms(joint, values, given, constants)
    units = {name.partition("[")[0]: c.unit for name, c in result.coefficients.items()}
    units |= {name: unit for name, unit in CONSTANT_UNITS.items() if name in system.constants}
    if result.model == "link":  # the motor's motion is its input
        units |= dict(zip(system.inputs, ("rad", "rad/s"), strict=True))
    else:
        units |= dict.fromkeys(system.inputs, input_unit_of(result))
    return ExportSource(
        system,
        {name: values[name] for name in system.coefficients if isfinite(values[name])},
        units,
        result,
    )


def _with_terms(
    joint: "Joint",
    values: Mapping[str, float],
    given: frozenset[str],
    constants: Mapping[str, float],
) -> ParametricSystem:
    """The joint with the terms that have a value, what is given in its known parts."""
    rows = []
    for smooth, extended in zip(joint.smooth.rows, joint.extended.rows, strict=True):
        regressors = {
            name: smooth.regressors.get(name, text)
            for name, text in extended.regressors.items()
            if name in values
        }
        known = [f"{name}*({text})" for name, text in regressors.items() if name in given]
        known += [smooth.known] * (smooth.known != "0")
        rows.append(
            Row(
                smooth.name,
                smooth.coordinate,
                smooth.velocity,
                {name: text for name, text in regressors.items() if name not in given},
                " + ".join(known) or "0",
            )
        )
    texts = [text for row in rows for text in (*row.regressors.values(), row.known)]
    every = {**joint.extended.constants, **joint.smooth.constants, **constants}
    used = {name: v for name, v in every.items() if any(name in text for text in texts)}
    inputs = joint.smooth.inputs
    return ParametricSystem(joint.smooth.name, tuple(rows), inputs, used)
