"""The channels that a log may have, and one of them in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexid.arrays import FloatArray

VELOCITIES = ("link_velocity", "motor_velocity")
INPUTS = ("motor_torque", "motor_current", "motor_voltage")  # in the order of preference
SI_UNITS: dict[str, tuple[str, ...]] = {
    "time": ("s",),
    "link_position": ("rad",),
    "link_velocity": ("rad/s",),
    "motor_position": ("rad",),
    "motor_velocity": ("rad/s",),
    "deflection": ("rad",),
    "motor_torque": ("N m", "V", "A"),
    "motor_current": ("A",),
    "motor_voltage": ("V",),
}
GEARED = ("motor_position", "motor_velocity", "motor_torque")
"""Channels that differ at the two sides of the gear: angles are divided, the torque multiplied."""


@dataclass(frozen=True)
class Origin:
    """How a channel was computed: ``factor * (sum of weight * column) + offset``, in SI units.

    Parameters
    ----------
    columns : mapping of str to float
        Weights of the columns, by name in the file.
    factor : float
        With the conversion of the unit, the scale of a column map and the gear ratio.
    offset : float
        In `unit`.
    unit : str
        The SI unit.
    gear_ratio : float or None
        By which the channel was carried to the link's side of the gear, as `factor` says.
    """

    columns: Mapping[str, float]
    factor: float
    offset: float
    unit: str
    gear_ratio: float | None


@dataclass(frozen=True, eq=False)
class Channel:
    """One canonical channel of a file, in SI units.

    Parameters
    ----------
    values : FloatArray, shape (n,)
    unit : str
        The SI unit of the values.
    column : str
        The column it came from, as named in the file, or several joined by " + ".
    unit_stated : bool
        Whether the file or the map named a unit.
    origin : Origin
        How the values were computed.
    """

    values: FloatArray
    unit: str
    column: str
    unit_stated: bool
    origin: Origin
