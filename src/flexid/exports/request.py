"""Request for an export: a model with its values, and settings of an online estimator."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from math import inf, isfinite
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.estimators.state_variable_filter import check_filter_rate
from flexid.models.flexible_joint import (
    CONSTANT_UNITS,
    COULOMB_VELOCITY,
    POSITIVE,
    SQUARES,
    joint_model,
)
from flexid.models.motion import JointType, unit_of
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.sampling import check_sample_time

if TYPE_CHECKING:
    from jinja2 import Environment

    from flexid.identification.result import Identification
    from flexid.identification.vocabulary.evidence import ValueEstimate
    from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class ExportRequest:
    """Model to export, with its values."""

    system: ParametricSystem  # with known coefficients as constants and smooth friction
    values: Mapping[str, float] = field(default_factory=dict)  # of its coefficients
    # of coefficients, constants, inputs and states; empty for a model without units
    units: Mapping[str, str] = field(default_factory=dict)
    identification: "Identification | None" = None

    @property
    def joint(self) -> JointType:
        """Type of the joint."""
        return "revolute" if self.identification is None else self.identification.joint


def doubts_of(values: Mapping[str, "ValueEstimate"]) -> tuple[str, ...]:
    """Return a warning if some values are undetermined."""
    guessed = [name for name, value in values.items() if value.verdict == "undetermined"]
    return (f"the estimate leaves {', '.join(guessed)} undetermined",) if guessed else ()


def request_of_identification(result: "Identification") -> ExportRequest:
    """Return a request for the identified model and its values, with the first log's offsets."""
    from flexid.identification.preparation.joint import joint_of
    from flexid.stored_estimates.structure import values_of

    values, choices = values_of(result, 0), result.choices
    check_possible(result)
    joint = joint_of(result.model, result.joint)
    for name in sorted(joint.remembered & values.keys()):
        term = joint.of_coefficient(name) or name
        raise SettingError(
            term,
            "depends on the past motion, which this export does not model: identify with --terms "
            f"{','.join(t for t in choices.terms if t != term)}, and export that estimate",
        )
    given = {name: values[name] for name in sorted((result.given | SQUARES) & {*values})}
    check_known(given)
    velocity = choices.coulomb_velocity or COULOMB_VELOCITY[result.joint]
    whole = joint_model(result.model, choices.terms, given, velocity, choices.shapes)
    rows = (
        replace(row, regressors={c: text for c, text in row.regressors.items() if c in values})
        for row in whole.rows
    )
    system = replace(whole, rows=tuple(rows))
    units = {name.partition("[")[0]: c.unit for name, c in result.coefficients.items()}
    motion = [*system.states, *(system.inputs if result.model == "link" else ())]
    declared = {name: unit for name, unit in CONSTANT_UNITS.items() if name in system.constants}
    declared |= dict.fromkeys(motion[::2], "rad") | dict.fromkeys(motion[1::2], "rad/s")
    units |= dict.fromkeys(system.inputs, result.input_unit)
    units |= {name: unit_of(unit, result.joint) for name, unit in declared.items()}
    return ExportRequest(
        system,
        {name: values[name] for name in system.coefficients if isfinite(values[name])},
        units,
        result,
    )


def check_known(values: Mapping[str, float]) -> None:
    """Raise `SettingError` for the first value that is not finite."""
    for name, value in values.items():
        if not isfinite(value):
            raise SettingError(
                name, "has no value in the estimate: identify a log that determines it"
            )


def impossible(name: str, value: str, why: str) -> SettingError:
    """Return the error for a value that is physically impossible."""
    return SettingError(
        name, f"is {value} in this estimate, {why}: identify a log that determines it"
    )


def check_possible(result: "Identification") -> None:
    """Raise `SettingError` if a stiffness or an inertia is zero or negative."""
    for name, found in result.coefficients.items():
        if name in POSITIVE and found.value <= 0.0:
            value = f"{found.value:g} {found.unit}"
            raise impossible(name, value, "but must be positive with any spring and inertia")


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings of an online estimator."""

    sample_time: float  # s
    hold: "Hold" = "zero"  # of the input between samples
    filter_rate: float = 20.0  # 1/s, of the filter of positions and inputs
    # s, after which a sample weighs 1/e as much; keeps sums in float finite over years of samples
    memory: float = 60.0

    def __post_init__(self) -> None:
        check_sample_time(self.sample_time)
        check_filter_rate(self.filter_rate, self.sample_time)

    @property
    def summary(self) -> str:
        """One line on the method and the signals of the estimator."""
        memory = "" if self.memory == inf else f", memory {self.memory:g} s"
        return (
            f"Least-squares gain{memory}, from positions and inputs through a filter of "
            f"{self.filter_rate:g} 1/s."
        )


@cache
def _templates() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from flexid.derivation.drive_source import comment, literal

    made = Environment(
        loader=PackageLoader("flexid.exports"),
        autoescape=lambda name: str(name).endswith(".xml"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        line_statement_prefix="%%",
    )
    made.filters |= {
        "comment": comment,
        "real": literal,
        "value": lambda number: f"V({number!r})",
        "unsigned": lambda number: f"{number}U",
        "boolean": lambda value: "true" if value else "false",
    }
    return made


def rendered(name: str, **values: object) -> str:
    """Render a template such as ``"c99/drive.h"``."""
    return _templates().get_template(name).render(values)
