"""Model files: a `ParametricSystem`, or an arm, in TOML."""

from functools import partial
from math import isfinite, radians
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

from flexid.errors import ExpressionError, ModelError
from flexid.files import parse_toml, read_small, shown, validated
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.models.planar_arm import PlanarArm

Name = Annotated[str, StringConstraints(min_length=1, max_length=60, pattern=r"^[\w .:()-]+$")]
Number = Annotated[float, Field(allow_inf_nan=False)]


class _Row(BaseModel):
    """One ``[[rows]]`` table."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: Name
    coordinate: Name
    velocity: Name
    known: str = "0"
    coefficients: dict[Name, str] = Field(min_length=1, max_length=100)


class _Model(BaseModel):
    """Whole file."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: Name
    inputs: list[Name] = Field(default=["u"], max_length=50)
    constants: dict[Name, Number] = Field(default={}, max_length=100)
    rows: list[_Row] = Field(min_length=1, max_length=50)


def _refused(file: str, key: str, reason: str) -> ModelError:
    return ModelError(file, f"the key {key!r} {reason}" if key else reason)


def read_model(path: str | Path) -> ParametricSystem:
    """Read a model file.

    Parameters
    ----------
    path : str or Path
        A TOML file with ``name``, optionally ``inputs`` (default ``["u"]``), a table ``constants``
        and one ``[[rows]]`` table per equation: ``name``, ``coordinate``, ``velocity``, optionally
        ``known``, and a table ``coefficients`` of regressors.

    Returns
    -------
    ParametricSystem

    Raises
    ------
    ModelError
        If the file cannot be read or declares no model; the message gives file, key and remedy.
    ExpressionError
        If an expression leaves the whitelist.
    """
    path = Path(path)
    refuse = partial(_refused, str(path))
    raw = read_small(path, "a TOML file, or the name flexible-joint", refuse)
    content = validated(parse_toml(raw, refuse), _Model, refuse)
    rows = tuple(
        Row(row.name, row.coordinate, row.velocity, row.coefficients, row.known)
        for row in content.rows
    )
    try:
        return ParametricSystem(content.name, rows, tuple(content.inputs), content.constants)
    except ModelError as error:
        raise ModelError(f"{path}: {error.model}", error.reason) from None
    except ExpressionError as error:
        raise ExpressionError(error.expression, error.reason, f"{path}: {error.place}") from None
    except RecursionError:
        raise ModelError(str(path), "an expression is nested too deeply: split it") from None


MOST_JOINTS = 7  # largest number of joints of an arm: its equations grow with the third power

_LONGEST, _STRONGEST = 100.0, 1000.0  # m, m/s^2


def _plausible(value: float) -> float:
    if not isfinite(value) or abs(value) > _STRONGEST:
        raise ValueError(f"{value:g} is outside -{_STRONGEST:g} to {_STRONGEST:g} m/s^2")
    return value


_Length = Annotated[float, Field(ge=0.0, le=_LONGEST)]
_Acceleration = Annotated[float, AfterValidator(_plausible)]
_Degrees = Annotated[float, Field(ge=-360.0, le=360.0, strict=True)]
_Number = Annotated[str, StringConstraints(pattern=f"^[1-{MOST_JOINTS}]$")]


class _Arm(BaseModel):
    model_config = ConfigDict(extra="forbid")

    lengths: list[_Length] = Field(min_length=1, max_length=MOST_JOINTS)
    gravity: _Acceleration | tuple[_Acceleration, _Acceleration] = 0.0
    slides: dict[_Number, _Degrees] = {}


class _ArmFile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    arm: _Arm


def read_arm(path: Path) -> PlanarArm:
    """Read the table ``[arm]`` of a TOML file: lengths, gravity, and which joints slide."""
    refuse = partial(_refused, shown(path))
    content = parse_toml(read_small(path, "a TOML file", refuse), refuse)
    arm = validated(content, _ArmFile, refuse).arm
    along, across = arm.gravity if isinstance(arm.gravity, tuple) else (arm.gravity, 0.0)
    angles = {int(joint): radians(angle) for joint, angle in arm.slides.items()}
    joints = range(1, len(arm.lengths) + 1)
    slides = tuple(angles.get(joint) for joint in joints)
    for joint in angles:
        if joint not in joints:
            reason = f"names joint {joint}, but lengths ends at joint {joints[-1]}: add its length"
            raise refuse("arm.slides", reason)
    for joint in joints[:-1]:
        if arm.lengths[joint - 1] == 0.0 and not {joint, joint + 1} & angles.keys():
            reason = f"is 0 between joints {joint} and {joint + 1}, which turn: give the distance"
            raise refuse("arm.lengths", reason)
    gravity = float(along), float(across)
    return PlanarArm(tuple(arm.lengths), gravity, shown(path), slides if arm.slides else ())
