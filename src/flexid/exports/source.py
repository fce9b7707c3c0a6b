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
    """A model and what is known of it."""

    system: ParametricSystem  # given coefficients are its constants, Coulomb friction is smoothed
    values: Mapping[str, float] = field(default_factory=dict)  # of its coefficients, where known
    units: Mapping[str, str] = field(default_factory=dict)  # of coefficients, constants and inputs
    identification: "Identification | None" = None

    @property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about the values, in sentences."""
        found = {} if self.identification is None else self.identification.coefficients
        guessed = [name for name, c in found.items() if c.verdict == "undetermined"]
        return (f"the estimate leaves {', '.join(guessed)} undetermined",) if guessed else ()


def source_of_identification(
    result: "Identification", *, with_memory: bool = False
) -> ExportSource:
    """The model of an identification with the terms that were kept, and its values.

    Offsets that differ from log to log have the value of the first one. A coefficient that the log
    does not show has no value. A friction that remembers its path is refused, or left out of the
    system where it is represented otherwise (`with_memory`).
    """
    from flexid.identification.preparation.joint import joint_of
    from flexid.stored_estimates.rebuilt import described, given_coefficients, input_unit_of

    found = described(result, 0).coefficients
    values = {name: v for name, v in found.items() if "[" not in name}
    given = (given_coefficients(result) | SQUARES) & {*values}
    joint = joint_of(result.model)
    _check_possible(result)
    for name in () if with_memory else joint.grips.keys() & values.keys():
        term = joint.of_coefficient(name) or name
        raise SettingError(
            term,
            "remembers the path of the spring, which this export cannot: identify with --terms "
            f"{','.join(t for t in result.choices.terms if t != term)}, and export that estimate",
        )
    without = sorted(name for name in given if not isfinite(values[name]))
    if without:
        raise SettingError(
            without[0], "has no value in the estimate: identify a log that determines it"
        )
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


def _check_possible(result: "Identification") -> None:
    from flexid.identification.vocabulary.intervals import POSITIVE

    for name, found in result.coefficients.items():
        if name in POSITIVE and found.value <= 0.0:
            raise SettingError(
                name,
                f"is {found.value:g} {found.unit} in this estimate, and every spring and inertia "
                "makes it positive: identify a log that determines it",
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
