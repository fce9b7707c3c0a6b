"""Keys, types and ranges of an experiment file. A file of its own, so that pydantic loads late."""

import math
from typing import Annotated, Any, Generic, Literal, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
)

from flexid.experiments.variation import MEASURES, MOST_RUNS, Distribution, Kept, Kind, Plan
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.models.terms import COULOMB_VELOCITY

Name = Annotated[str, StringConstraints(min_length=1, max_length=60, pattern=r"^[\w-]+$")]

SMALLEST = 1e-30
LARGEST = 1e30
"""Beyond these, powers of a number overflow, and no drive has one."""


def _of_a_drive(value: float) -> float:
    if value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
        raise ValueError(f"a magnitude between {SMALLEST:g} and {LARGEST:g} is needed")
    return value


Number = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_of_a_drive)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), AfterValidator(_of_a_drive)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), AfterValidator(_of_a_drive)]
Negative = Annotated[float, Field(lt=0, allow_inf_nan=False), AfterValidator(_of_a_drive)]
Exponent = Annotated[float, Field(ge=-6, le=6)]


def _whole(value: Any) -> Any:
    # A campaign draws whole numbers as floats
    return int(value) if isinstance(value, float) and value.is_integer() else value


Whole = Annotated[int, BeforeValidator(_whole)]
Numbers = Annotated[list[Number], Field(max_length=50)]
Values = Annotated[dict[Name, Number], Field(max_length=100)]


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("one line of printable text is needed")
    return text


Title = Annotated[str, StringConstraints(max_length=200), AfterValidator(_printable)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class JointModel(_Table):
    """The flexible joint with some terms."""

    terms: list[Name] = list(PAPER_TERMS)
    known: list[Name] = ["beta1"]
    coulomb_velocity: Positive = COULOMB_VELOCITY


class FileModel(_Table):
    """A model in a file of its own."""

    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]


class RobustLaw(_Table):
    """Huang (2003), eq. (11)."""

    law: Literal["robust"]
    k: Positive
    exponents: Annotated[list[Exponent], Field(min_length=3, max_length=3)] = [1.0, 2.0, 3.0]
    largest_link_inertia: Positive
    largest_motor_inertia: Positive
    smallest_joint_stiffness: Positive
    nominal: Values


class PdGravityLaw(_Table):
    """PD control on the motor with gravity compensation."""

    law: Literal["pd-gravity"]
    proportional: NotNegative
    derivative: NotNegative
    nominal: Values


class ComputedTorqueLaw(_Table):
    """Feedback linearisation."""

    law: Literal["computed-torque"]
    poles: Annotated[list[Negative], Field(min_length=4, max_length=4)]
    nominal: Values


class OwnLaw(_Table):
    """A law in expressions."""

    law: Literal["expressions"]
    tracked: Name
    inputs: Annotated[dict[Name, str], Field(min_length=1, max_length=50)]
    parameters: Values = {}
    definitions: Annotated[dict[Name, str], Field(max_length=100)] = {}
    coordinates: Annotated[dict[Name, str], Field(max_length=100)] = {}


class SineReference(_Table):
    """One sine wave."""

    kind: Literal["sine"]
    amplitude: Number
    angular_frequency: Number
    phase: Number = 0.0
    offset: Number = 0.0


class MultisineReference(_Table):
    """Several sine waves."""

    kind: Literal["multisine"]
    amplitudes: Numbers
    angular_frequencies: Numbers
    phases: Numbers = []
    offset: Number = 0.0


class ConstantReference(_Table):
    """Standing still."""

    kind: Literal["constant"]
    value: Number


class ContinuousRun(_Table):
    """A run in continuous time."""

    duration: Positive
    sample_time: Positive = 1e-3
    relative_tolerance: Annotated[float, Field(ge=1e-13, le=0.1)] = 1e-6
    absolute_tolerance: Positive | None = None
    maximum_steps: Annotated[Whole, Field(ge=1, le=10**9)] = 1_000_000
    stiff: bool = True


class SampledRun(_Table):
    """A run of a sampled loop."""

    duration: Positive


class SamplingTable(_Table):
    """What a drive's sensors and clock are like."""

    sample_time: Positive = 1e-3
    input_limit: Annotated[float, Field(gt=0)] = math.inf
    position_resolution: NotNegative = 0.0
    position_noise: NotNegative = 0.0
    velocity_noise: NotNegative = 0.0
    seed: Annotated[Whole, Field(ge=0, le=2**63)] = 0


class CampaignTable(_Table):
    """What varies over many runs, and what is kept of each."""

    kind: Plan
    runs: Annotated[int, Field(ge=1, le=MOST_RUNS)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**63)] = 0
    keep: list[Kept] = list(MEASURES)
    runs_per_part: Annotated[int, Field(ge=1, le=100_000)] | None = None
    vary: Annotated[dict[str, Any], Field(min_length=1)]


class ListedValues(_Table):
    """Several values of one number."""

    values: Annotated[list[Number], Field(min_length=1, max_length=10_000)]


class DistributionTable(_Table):
    """One distribution: a kind and two numbers."""

    uniform: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    log_uniform: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    normal: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    integers: Annotated[list[Whole], Field(min_length=2, max_length=2)] | None = None

    def distribution(self) -> Distribution | None:
        """The one that is given, or nothing if it is not one."""
        given = [
            Distribution(kind, float(pair[0]), float(pair[1]))
            for kind in get_args(Kind)
            if (pair := getattr(self, kind)) is not None
        ]
        return given[0] if len(given) == 1 else None


ModelTable = TypeVar("ModelTable", bound=_Table)
Law = TypeVar("Law", bound=_Table)
ReferenceTable = TypeVar("ReferenceTable", bound=_Table)
RunTable = TypeVar("RunTable", bound=_Table)


class Tables(_Table, Generic[ModelTable, Law, ReferenceTable, RunTable]):
    """The whole file, for one kind of each part."""

    name: Title = ""
    model: ModelTable = Field(default_factory=dict, validate_default=True)  # type: ignore[arg-type]
    plant: Annotated[Values, Field(min_length=1)]
    controller: Law
    reference: ReferenceTable
    observer: Annotated[dict[Name, NotNegative], Field(min_length=1, max_length=50)]
    initial_estimates: Values = {}
    initial_state: Values = {}
    run: RunTable
    sampling: SamplingTable | None = None


LAWS: dict[str, type[BaseModel]] = {
    "robust": RobustLaw,
    "pd-gravity": PdGravityLaw,
    "computed-torque": ComputedTorqueLaw,
    "expressions": OwnLaw,
}
REFERENCES: dict[str, type[BaseModel]] = {
    "sine": SineReference,
    "multisine": MultisineReference,
    "constant": ConstantReference,
}
