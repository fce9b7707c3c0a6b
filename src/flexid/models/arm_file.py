"""Arms as TOML files: the table ``[arm]`` with lengths and gravity."""

from math import isfinite
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from flexid.errors import ModelError
from flexid.files import shown
from flexid.models.planar_arm import PlanarArm
from flexid.toml_file import parse_toml, read_bytes, validated

MOST_JOINTS = 7
"""Joints of an arm at most: its equations grow with the third power of their number."""

_LONGEST, _STRONGEST = 100.0, 1000.0  # m, m/s^2


def _plausible(value: float) -> float:
    if not isfinite(value) or abs(value) > _STRONGEST:
        raise ValueError(f"{value:g} is outside -{_STRONGEST:g} to {_STRONGEST:g} m/s^2")
    return value


_Length = Annotated[float, Field(gt=0.0, le=_LONGEST)]
_Acceleration = Annotated[float, AfterValidator(_plausible)]


class _Arm(BaseModel):
    model_config = ConfigDict(extra="forbid")

    lengths: list[_Length] = Field(min_length=1, max_length=MOST_JOINTS)
    gravity: _Acceleration | tuple[_Acceleration, _Acceleration] = 0.0


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    arm: _Arm


def read_arm(path: Path) -> PlanarArm:
    """Read an arm."""
    file = shown(path)

    def refuse(key: str, reason: str) -> ModelError:
        return ModelError(file, f"the key {key!r} {reason}" if key else reason)

    content = validated(parse_toml(read_bytes(path, "a TOML file", refuse), refuse), _File, refuse)
    gravity = content.arm.gravity
    along, across = gravity if isinstance(gravity, tuple) else (gravity, 0.0)
    return PlanarArm(tuple(content.arm.lengths), (float(along), float(across)), file)
