"""Tables of an experiment file, except ``[campaign]``."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
)

from flexid.errors import ExpressionError, ModelError, SettingError
from flexid.files import RefuseKey
from flexid.models.flexible_joint import COULOMB_VELOCITY, PAPER_TERMS, flexible_joint
from flexid.models.model_file import read_model
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import TERM_PARAMETERS

Name = Annotated[str, StringConstraints(min_length=1, max_length=60, pattern=r"^[\w-]+$")]

SMALLEST = 1e-30
LARGEST = 1e30  # beyond these limits powers overflow


def _in_range(value: float) -> float:
    if value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
        raise ValueError(f"a magnitude between {SMALLEST:g} and {LARGEST:g} is needed")
    return value


def _whole(value: Any) -> Any:
    # Campaigns draw whole numbers as floats.
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("one line of printable text is needed")
    return text


Number = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_in_range)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Exponent = Annotated[float, Field(ge=-6, le=6)]
Whole = Annotated[int, BeforeValidator(_whole)]
Numbers = Annotated[list[Number], Field(max_length=50)]
Values = Annotated[dict[Name, Number], Field(max_length=100)]
Expressions = Annotated[dict[Name, str], Field(max_length=100)]
Title = Annotated[str, StringConstraints(max_length=200), AfterValidator(_printable)]


class Table(BaseModel):
    """Table with strict types and without unknown keys."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class JointModel(Table):
    """Flexible joint with optional terms."""

    terms: list[Name] = list(PAPER_TERMS)
    known: list[Name] = ["beta1"]
    coulomb_velocity: Positive = COULOMB_VELOCITY["revolute"]  # rad/s

    def system(self, _folder: Path, refuse: RefuseKey) -> ParametricSystem:
        """Return the model; its known coefficients get the value 1."""
        for place, term in enumerate(self.terms, start=1):
            if term not in TERM_PARAMETERS:
                known = ", ".join(TERM_PARAMETERS)
                raise refuse(f"model.terms.{place}", f"is {term!r}: take one of {known}")
        try:
            return flexible_joint(self.terms, dict.fromkeys(self.known, 1.0), self.coulomb_velocity)
        except SettingError as error:
            raise refuse("model.known", f"does not fit: {error.reason}") from None
        except ModelError as error:
            raise refuse("model", f"does not fit: {error.reason}") from None


class FileModel(Table):
    """Model in a separate file."""

    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]

    def system(self, folder: Path, refuse: RefuseKey) -> ParametricSystem:
        """Return the model, with the values of constants from its file."""
        try:
            return read_model(folder / self.file)
        except (ModelError, ExpressionError) as error:
            raise refuse("model.file", f"names a model that cannot be used, {error}") from None


class PdNominal(Table):
    """Nominal parameters for `PdGravityLaw`."""

    gravity_torque: Number  # N m
    joint_stiffness: Positive  # N m/rad


class RobustNominal(Table):
    """Nominal parameters for `RobustLaw`."""

    gravity_torque: Number  # N m
    link_inertia: Number  # kg m^2
    joint_stiffness: Positive  # N m/rad
    motor_inertia: Number  # kg m^2
    motor_viscous_friction: Number  # N m s/rad


class RobustLaw(Table):
    """Robust control law of Huang (2003), eq. (11)."""

    law: Literal["robust"]
    k: Positive  # 1/s
    exponents: Annotated[list[Exponent], Field(min_length=3, max_length=3)] = [1.0, 2.0, 3.0]
    largest_link_inertia: Positive  # kg m^2
    largest_motor_inertia: Positive  # kg m^2
    smallest_joint_stiffness: Positive  # N m/rad
    nominal: RobustNominal


class PdGravityLaw(Table):
    """PD control on the motor with gravity compensation."""

    law: Literal["pd-gravity"]
    proportional: NotNegative  # N m/rad
    derivative: NotNegative  # N m s/rad
    nominal: PdNominal


class OwnLaw(Table):
    """Control law in expressions of the user."""

    law: Literal["expressions"]
    tracked: Name
    inputs: Annotated[dict[Name, str], Field(min_length=1, max_length=50)]
    parameters: Values = {}
    definitions: Expressions = {}
    coordinates: Expressions = {}


class SineReference(Table):
    """One sine wave."""

    kind: Literal["sine"]
    amplitude: Number  # rad
    angular_frequency: Number  # rad/s
    phase: Number = 0.0  # rad
    offset: Number = 0.0  # rad


class MultisineReference(Table):
    """Several sine waves."""

    kind: Literal["multisine"]
    amplitudes: Numbers  # rad
    angular_frequencies: Numbers  # rad/s
    phases: Numbers = []  # rad
    offset: Number = 0.0  # rad


class ConstantReference(Table):
    """Constant reference."""

    kind: Literal["constant"]
    value: Number  # rad


class ContinuousRun(Table):
    """Duration and tolerances of a loop in continuous time."""

    duration: Positive  # s
    sample_time: Positive = 1e-3  # s
    relative_tolerance: Annotated[float, Field(ge=1e-13, le=0.1)] = 1e-6
    absolute_tolerance: Positive | None = None  # a thousandth of the relative one
    maximum_steps: Annotated[Whole, Field(ge=1, le=10**9)] = 1_000_000
    stiff: bool = True

    def settled(self) -> "ContinuousRun":
        """Return the table with a default absolute tolerance, from the relative one."""
        if self.absolute_tolerance is not None:
            return self
        return self.model_copy(update={"absolute_tolerance": 1e-3 * self.relative_tolerance})


class SampledRun(Table):
    """Duration of a sampled loop."""

    duration: Positive  # s


class SamplingTable(Table):
    """Sample time, input limit and sensor errors of a sampled loop."""

    sample_time: Positive = 1e-3  # s
    input_limit: Annotated[float, Field(gt=0)] = math.inf  # N m
    position_resolution: NotNegative = 0.0  # rad
    position_noise: NotNegative = 0.0  # rad
    velocity_noise: NotNegative = 0.0  # rad/s
    seed: Annotated[Whole, Field(ge=0, le=2**63)] = 0


def _kind_of_model(content: Any) -> str:
    if isinstance(content, FileModel) or (isinstance(content, Mapping) and "file" in content):
        return "a file"
    return "a joint"


Model = Annotated[
    Annotated[JointModel, Tag("a joint")] | Annotated[FileModel, Tag("a file")],
    Discriminator(_kind_of_model),
]
Law = RobustLaw | PdGravityLaw | OwnLaw
Reference = SineReference | MultisineReference | ConstantReference


class LoopTables(Table):
    """Tables that every experiment file has."""

    name: Title = ""
    model: Model = JointModel()
    plant: Annotated[Values, Field(min_length=1)]
    controller: Annotated[Law, Field(discriminator="law")]
    reference: Annotated[Reference, Field(discriminator="kind")]
    observer: Annotated[dict[Name, NotNegative], Field(min_length=1, max_length=50)]
    initial_estimates: Values = {}
    initial_state: Values = {}


class ContinuousTables(LoopTables):
    """Experiment file of a loop in continuous time."""

    run: ContinuousRun

    @property
    def settings(self) -> ContinuousRun:
        """Duration, sample time and tolerances."""
        return self.run.settled()


class SampledTables(LoopTables):
    """Experiment file of a sampled loop."""

    run: SampledRun
    sampling: SamplingTable

    @property
    def settings(self) -> ContinuousRun:
        """Duration and sample time; tolerances have no effect."""
        return ContinuousRun(
            duration=self.run.duration, sample_time=self.sampling.sample_time
        ).settled()


Tables = ContinuousTables | SampledTables
