"""The model of an arm as the fits take it: what `Joint` is for one joint.

All its parameters are always there. Dry friction is set-valued, and links couple.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.balance_motion import balance_motion, balance_unknowns
from flexid.estimators.channel_timing import Timing
from flexid.estimators.segmented_motion import SegmentedMotion
from flexid.estimators.segments import Segments
from flexid.estimators.unknowns import Unknowns
from flexid.models.torque_balance import TorqueBalance


@dataclass(frozen=True)
class ElasticArm:
    """An arm with all its terms."""

    balance: TorqueBalance
    resting: tuple[int, ...] = ()  # joints whose motors stand still
    terms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # none can be left out
    ties: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)
    nonlinear: Mapping[str, str] = field(default_factory=dict)
    first: Mapping[str, float] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of both positions of each joint, and of its deflection."""
        kinds = ("link_position", "motor_position", "deflection")
        joints = range(1, self.balance.joints + 1)
        return tuple(f"{kind}_{joint}" for joint in joints for kind in kinds)

    def channels_of(self, positions: FloatArray, inputs: FloatArray) -> FloatArray:  # noqa: ARG002
        """Channels, shape (n, 3 n_joints), in rad."""
        links, motors = positions[:, ::2], positions[:, 1::2]
        return np.stack((links, motors, links - motors), axis=2).reshape(len(positions), -1)

    def unknowns(
        self,
        absent: Collection[str],
        fixed: Mapping[str, float],
        groups: Sequence[int] = (),  # noqa: ARG002
    ) -> Unknowns:
        """What is sought where some parameters have a value."""
        return balance_unknowns(self.balance, {**dict.fromkeys(absent, 0.0), **fixed})

    def with_widths(self, widths: Mapping[str, float]) -> "ElasticArm":  # noqa: ARG002
        """The same: its terms have no constants."""
        return self

    def motion(self, segments: Segments, timing: Timing, unknowns: Unknowns) -> SegmentedMotion:
        """Its motion over segments."""
        return balance_motion(self.balance, segments, timing, unknowns)
