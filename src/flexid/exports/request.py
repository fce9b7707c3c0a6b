"""What is exported: a model with what is known of it, its online estimator, and the target."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.estimators.state_variable_filter import check_filter_rate
from flexid.models.flexible_joint import CONSTANT_UNITS, POSITIVE, SMOOTHING, SQUARES, declared_row
from flexid.models.motion import JointType, unit_of
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.sampling import check_sample_time

if TYPE_CHECKING:
    from jinja2 import Environment

    from flexid.arms.result import ArmIdentification
    from flexid.estimators.recursive_least_squares import RecursiveLeastSquares
    from flexid.estimators.samples import Samples
    from flexid.identification.preparation.joint import Joint
    from flexid.identification.result import Identification
    from flexid.identification.vocabulary.evidence import ValueEstimate
    from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class ExportRequest:
    """What is to be exported: a model with what is known of it, and its online estimator."""

    system: ParametricSystem  # given coefficients are its constants, Coulomb friction is smoothed
    values: Mapping[str, float] = field(default_factory=dict)  # of its coefficients, where known
    # of coefficients, constants, inputs and states; empty where the model has none
    units: Mapping[str, str] = field(default_factory=dict)
    identification: "Identification | None" = None
    settings: "EstimatorSettings | None" = None  # of the online estimator
    samples: "Samples | None" = None  # motion to test it with

    @property
    def joint(self) -> JointType:
        """How the joint moves."""
        return "revolute" if self.identification is None else self.identification.joint

    @property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about the values, in sentences."""
        return () if self.identification is None else doubts_of(self.identification.coefficients)


def doubts_of(values: Mapping[str, "ValueEstimate"]) -> tuple[str, ...]:
    """A warning where some values are undetermined, in a sentence."""
    guessed = [name for name, value in values.items() if value.verdict == "undetermined"]
    return (f"the estimate leaves {', '.join(guessed)} undetermined",) if guessed else ()


def request_of_identification(
    result: "Identification", *, with_memory: bool = False
) -> ExportRequest:
    """The identified model with its kept terms and values; offsets are those of the first log."""
    from flexid.identification.preparation.joint import joint_of
    from flexid.stored_estimates.structure import values_of

    values = values_of(result, 0)
    given = (result.given | SQUARES) & {*values}
    joint = joint_of(result.model, result.joint)
    _check_possible(result)
    for name in () if with_memory else sorted(joint.remembered & values.keys()):
        term = joint.of_coefficient(name) or name
        raise SettingError(
            term,
            "remembers the path of the spring, which this export cannot: identify with --terms "
            f"{','.join(t for t in result.choices.terms if t != term)}, and export that estimate",
        )
    check_known({name: values[name] for name in sorted(given)})
    constants = {name: values[name] for name in sorted(given)} | {**result.choices.shapes}
    if result.choices.coulomb_velocity is not None:
        constants[SMOOTHING] = result.choices.coulomb_velocity
    system = _with_terms(joint, values, given, constants)
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
    """Raise `SettingError` for the first that an estimate leaves without a value."""
    for name, value in values.items():
        if not isfinite(value):
            raise SettingError(
                name, "has no value in the estimate: identify a log that determines it"
            )


def impossible(name: str, value: str, why: str) -> SettingError:
    """The error of a value that no drive has."""
    return SettingError(
        name, f"is {value} in this estimate, {why}: identify a log that determines it"
    )


def _check_possible(result: "Identification") -> None:
    for name, found in result.coefficients.items():
        if name in POSITIVE and found.value <= 0.0:
            value = f"{found.value:g} {found.unit}"
            raise impossible(name, value, "and every spring and inertia makes it positive")


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
        row = declared_row(smooth.name, smooth.coordinate, smooth.velocity, regressors, given)
        known = [text for text in (row.known, smooth.known) if text != "0"]
        rows.append(replace(row, known=" + ".join(known) or "0"))
    texts = [text for row in rows for text in (*row.regressors.values(), row.known)]
    every = {**joint.constants, **joint.smooth.constants, **constants}
    used = {name: v for name, v in every.items() if any(name in text for text in texts)}
    inputs = joint.smooth.inputs
    return ParametricSystem(joint.smooth.name, tuple(rows), inputs, used)


_MEMORY = 60.0  # s; a drive runs for years, and sums in float do not grow for ever


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings of an online estimator."""

    sample_time: float  # s
    hold: "Hold" = "zero"  # the input between samples
    filter_rate: float = 20.0  # 1/s, of the filter that positions pass
    memory: float = _MEMORY  # s, after which a sample weighs 1/e as much
    start: Mapping[str, float] = field(default_factory=dict)  # 0 where no value is given

    def __post_init__(self) -> None:
        check_sample_time(self.sample_time)
        check_filter_rate(self.filter_rate, self.sample_time)

    def twin(self, system: ParametricSystem) -> "RecursiveLeastSquares":
        """The same estimator in Python."""
        from flexid.estimators.recursive_least_squares import recursive_least_squares

        return recursive_least_squares(
            system, self.sample_time, self.filter_rate, self.hold, self.memory
        )

    @property
    def summary(self) -> str:
        """What is estimated from what, in a line."""
        memory = "" if self.memory == inf else f", memory {self.memory:g} s"
        return (
            f"Least-squares gain{memory}, from positions and inputs through a filter of "
            f"{self.filter_rate:g} 1/s."
        )


TARGETS = ("c99", "mjcf", "fmu")
"""The online estimator, the scene, the plant; each has a module of that name here."""


def export_to(
    target: str, what: "ExportRequest | ArmIdentification", directory: Path
) -> tuple[str, ...]:
    """Write the files of a target into an empty directory; return what they do not hold."""
    module = target
    if not isinstance(what, ExportRequest):
        if target != "mjcf":
            raise SettingError(
                target, "is for one joint, and the estimate is of an arm: export it to mjcf"
            )
        module = "mjcf_arm"
    return tuple(import_module(f"flexid.exports.{module}").write(what, directory))


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
    """A template such as ``"c99/drive.h"``, filled."""
    return _templates().get_template(name).render(values)
