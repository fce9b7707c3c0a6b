"""Units of an arm's parameters, from the types and the inputs of its joints."""

from collections.abc import Sequence
from typing import NamedTuple

from flexid.models.motion import FORCES, JointType, unit_of
from flexid.models.torque_balance import BodyTerm, JointTerm

# Units where no input is calibrated, by the type of the reference joint. {} stands for the unit of
# its input, which replaces the unit of torque or force.
_IN_PLACE = {
    "revolute": {
        "kg m^2": "{} s^2/rad",
        "kg m": "{} s^2/(m rad)",
        "kg": "{} s^2/m^2",
        "N m": "{}",
        "N": "{}/m",
    },
    "prismatic": {
        "kg m^2": "{} m s^2/rad",
        "kg m": "{} s^2/rad",
        "kg": "{} s^2/m",
        "N m": "{} m",
        "N": "{}",
    },
}
_PER_METRE = {"/m/m": "/m^2", "/m/m^3": "/m^4", "/m s/m": " s/m^2"}


class ArmUnits(NamedTuple):
    """Units of the parameters of joints with these types and units of input."""

    types: Sequence[JointType]
    inputs: Sequence[str]
    resting: Sequence[int] = ()

    @property
    def calibrated(self) -> tuple[int, ...]:
        """Joints whose input is a torque or a force."""
        return tuple(joint for joint, unit in enumerate(self.inputs, 1) if unit in FORCES)

    @property
    def reference(self) -> int:
        """First joint that moves, whose input replaces torques if no input is calibrated."""
        return next(j for j in range(1, len(self.inputs) + 1) if j not in self.resting)

    def of(self, term: JointTerm | BodyTerm, joint: int) -> str:
        """Return a parameter's unit, relative to the reference input if no input is calibrated."""
        own, joint_type = self.inputs[joint - 1], self.types[joint - 1]
        if term.name == "torque_constant":
            torque, _, per = self._relative(unit_of("N m", joint_type)).partition("/")
            return f"{torque}/({per} {own})" if per else f"{torque}/{own}"
        in_joint = isinstance(term, JointTerm)
        return self._relative(unit_of(term.unit, joint_type) if in_joint else term.unit)

    def _relative(self, unit: str) -> str:
        if self.calibrated:
            return unit
        first = self.inputs[self.reference - 1]
        for declared, other in _IN_PLACE[self.types[self.reference - 1]].items():
            if unit.startswith(declared):
                found = other.format(first) + unit.removeprefix(declared)
                for twice, tidy in _PER_METRE.items():
                    found = found.replace(twice, tidy) if found.endswith(twice) else found
                return found
        return unit
