"""The channels that a log may have, and one of them in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass

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
# They differ at the two sides of the gear: angles are divided, the torque multiplied.
GEARED = ("motor_position", "motor_velocity", "motor_torque")


@dataclass(frozen=True)
class Origin:
    """How a channel was computed: ``factor * (sum of weight * column) + offset``, in SI units."""

    columns: Mapping[str, float]  # weights of the columns, by name in the file
    factor: float  # of the unit, the scale of a column map and the gear ratio together
    offset: float  # in `unit`
    unit: str  # SI
    gear_ratio: float | None  # by which `factor` carries the channel to the link's side of the gear


@dataclass(frozen=True, eq=False)
class Channel:
    """One canonical channel of a file, in SI units."""

    values: FloatArray  # shape (n,)
    unit: str
    column: str  # as named in the file; several are joined by " + "
    unit_stated: bool  # whether the file or the map named a unit
    origin: Origin

    @property
    def place(self) -> str:
        """The column, for a message."""
        return f"column {self.column!r}"
