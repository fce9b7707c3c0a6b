"""Models that are fitted to a log: a flexible joint, its link alone, a rigid joint, and an arm.

Each joint is compiled with all usual terms, and again with the unusual ones. A term that is off is
a coefficient fixed at 0. So terms can be tried and removed without another kernel.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import Samples, Segments, samples_of_recording
from flexid.estimators.segmented_motion import SegmentedMotion, segmented_motion
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import (
    ANGLE_ORIGIN,
    ANGULAR_TERMS,
    BACKLASH_WIDTH,
    COEFFICIENT_UNITS,
    CONTACT_DEFLECTION,
    COULOMB_VELOCITY,
    DAMPING,
    HYSTERESIS_GRIP,
    PLAY,
    RIGID_TERMS,
    RIGID_UNITS,
    SHAPE_TERMS,
    SMOOTHING,
    SOUGHT_CONSTANTS,
    TERMS,
    TIES,
    flexible_joint,
    rigid_joint,
    row_alone,
    with_dry_friction,
)
from flexid.models.motion import FORCES, JointType, unit_of
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import PhysicalParameter, ZeroAngle, physical_parameters
from flexid.recording.jumps import TURN
from flexid.recording.recording import Recording

if TYPE_CHECKING:
    from flexid.models.torque_balance import TorqueBalance

Kind = Literal["flexible", "link", "rigid"]

_MOTOR = 1  # index of the motor among the two sides

# Widths of shapes, relative to the root mean square of their argument. The amplitude is fitted, so
# widths from a quarter to four times as large describe nearly the same friction.
_BACKLASH_SHARE, _SMOOTHING_SHARE = 0.1, 0.1
_GRIP_SHARE = 0.4  # first reach in the search for a spring's hysteresis
_LEAST = 1e-15  # least width, to avoid a division by zero


@dataclass(frozen=True)
class Joint:
    """Joint with all its terms; made by `flexible`, `link` and `rigid`."""

    # flexible: two encoders and a spring between them; link: the link alone, driven by the motor's
    # measured motion; rigid: one encoder
    kind: Kind
    # with dry friction: every usual term; those of `SHAPE_TERMS` without memory, too; all terms
    systems: tuple[ParametricSystem, ...]
    # the first two of these with smoothed friction, for least squares, which takes the first
    smoothed: tuple[ParametricSystem, ...]
    terms: Mapping[str, tuple[str, ...]]  # coefficients of each term
    shapes: frozenset[str]  # coefficients of the terms in `SHAPE_TERMS`
    # unit of every coefficient; ``{input}`` is replaced by the unit of the input
    units: Mapping[str, str]
    channels: tuple[str, ...]  # names of the channels that a free run is compared in
    # coefficients that follow from three others, by name
    ties: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)
    # coefficients of terms with a nonlinear coefficient, and the name of the latter
    nonlinear: Mapping[str, str] = field(default_factory=dict)
    # start value of each nonlinear coefficient; its fixed value while its term is off
    first: Mapping[str, float] = field(default_factory=dict)
    type: JointType = "revolute"  # type of motion
    # coefficients of the systems that are always zero, since the joint has no such term
    never: frozenset[str] = frozenset()

    @property
    def smooth(self) -> ParametricSystem:
        """Model with smoothed friction, for least squares and the paper's observer."""
        return self.smoothed[0]

    @cached_property
    def remembered(self) -> frozenset[str]:
        """Coefficients of terms with memory: only the last system has them."""
        return frozenset({*self.systems[2].coefficients} - {*self.systems[1].coefficients})

    @cached_property
    def optional(self) -> frozenset[str]:
        """Coefficients of terms, which may all be absent."""
        return frozenset(c for names in self.terms.values() for c in names)

    def scaled(self, recordings: Sequence[Samples]) -> "Joint":
        """Return the joint with widths of shapes that suit recordings with velocities."""
        last = _root_mean_square([_velocities(p)[:, -1] for p in recordings])
        joint = self._smoothed_over(max(_SMOOTHING_SHARE * last, _LEAST))
        if self.kind == "rigid":
            return joint
        sides = [self.both_sides(recording) for recording in recordings]
        deflection = float(
            np.std(self.deflections(recordings))
        )  # about its mean: encoders may not share their zero
        widths = {BACKLASH_WIDTH: max(_BACKLASH_SHARE * deflection, _LEAST)}
        widths[ANGLE_ORIGIN] = self._origin([positions[:, _MOTOR] for positions, _ in sides])
        widths[HYSTERESIS_GRIP] = 1.0 / max(_GRIP_SHARE * deflection, _LEAST)
        return joint.with_widths(widths)

    def _smoothed_over(self, velocity: float) -> "Joint":
        """Return the joint with the friction of least squares smoothed over a velocity in rad/s."""
        smoothed = (system.with_constants({SMOOTHING: velocity}) for system in self.smoothed)
        return replace(self, smoothed=tuple(smoothed))

    def _origin(self, parts: Sequence[FloatArray]) -> float:
        """Return the origin of periodic terms: the middle of motion, rounded to whole turns."""
        middle = 0.5 * (max(float(x.max()) for x in parts) + min(float(x.min()) for x in parts))
        return TURN * round(middle / TURN) if self.type == "revolute" else middle

    def with_widths(self, widths: Mapping[str, float]) -> "Joint":
        """Return the joint with other values, or start values, of its constants."""

        def wide(system: ParametricSystem) -> ParametricSystem:
            own = {name: w for name, w in widths.items() if name in system.constants}
            return system.with_constants(own) if own else system

        first = {name: widths.get(name, value) for name, value in self.first.items()}
        if first == self.first and not {*widths} & self.smoothed[1].constants.keys():
            return self
        systems, smoothed = (tuple(map(wide, each)) for each in (self.systems, self.smoothed))
        return replace(self, first=first, systems=systems, smoothed=smoothed)

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the shapes, with start values for those that are sought."""
        return {**self.first, **self.systems[1].constants}

    def constants_of(self, coefficients: Collection[str]) -> dict[str, float]:
        """Return the constants in the regressors of the given coefficients."""
        constants, used = self.constants, {*coefficients}
        if PLAY.isdisjoint(coefficients):
            constants.pop(CONTACT_DEFLECTION, None)
            used -= DAMPING  # whose constants are those of the contact
        regressors = [
            regressor
            for row in self.systems[1].rows
            for name, regressor in row.regressors.items()
            if name in used
        ]
        return {name: v for name, v in constants.items() if any(name in r for r in regressors)}

    @property
    def with_shapes_in_least_squares(self) -> "Joint":
        """Joint whose least squares also covers the terms of `SHAPE_TERMS` without memory."""
        return replace(self, smoothed=(self.smoothed[1],) * 2)

    def both_sides(self, recording: Samples) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of link and motor, shape (n, 2) each."""
        if self.kind == "flexible":
            return recording.positions, _velocities(recording)
        motor = recording.inputs[:, :1], recording.inputs[:, 1:]
        return np.hstack((recording.positions, motor[0])), np.hstack(
            (_velocities(recording), motor[1])
        )

    def deflections(self, recordings: Sequence[Samples]) -> FloatArray:
        """Return the deflection in rad of all samples of the recordings, concatenated."""
        sides = (self.both_sides(recording)[0] for recording in recordings)
        return np.concatenate([np.subtract(*positions.T) for positions in sides])

    def with_coulomb_velocity(self, velocity: float) -> "Joint":
        """Return the joint with friction smoothed over a velocity in rad/s instead of dry."""
        smooth = self.smooth.with_constants({SMOOTHING: velocity})
        usual = {t: names for t, names in self.terms.items() if not {*names} <= self.shapes}
        rest: dict[str, Any] = {"shapes": frozenset(), "nonlinear": {}, "first": {}}
        return replace(self, systems=(smooth,) * 3, smoothed=(smooth,) * 2, terms=usual, **rest)

    def of_coefficient(self, name: str) -> str | None:
        """Return the term of a coefficient; None if the coefficient is always in the model."""
        return next((term for term, names in self.terms.items() if name in names), None)

    def samples(self, recording: Recording) -> Samples:
        """Return a recording as `Samples` for the estimators."""
        return samples_of_recording(recording, self.kind)

    def channels_of(
        self,
        positions: FloatArray,  # (n, n_rows)
        inputs: FloatArray,  # (n, n_inputs)
    ) -> FloatArray:
        """Return the channels, shape (n, n_channels), in rad."""
        if self.kind == "rigid":
            return positions
        motor = inputs[:, 0] if self.kind == "link" else positions[:, 1]
        return np.column_stack((positions, positions[:, 0] - motor))

    def unknowns(
        self,
        absent: Collection[str],
        fixed: Mapping[str, float],
        groups: Sequence[int] = (),
    ) -> Unknowns:
        """Return the unknowns, with absent coefficients at zero and fixed ones at their values."""
        needed = 0 if self.shapes <= {*absent} else 1 if self.remembered <= {*absent} else 2
        system = self.systems[needed]
        off = {c: self.first.get(c, 0.0) for c in system.coefficients if c in absent}
        ties = {
            c: sources
            for c, sources in self.ties.items()
            if c in system.coefficients and c not in fixed
        }
        given = {c: v for c, v in fixed.items() if c in system.coefficients}
        offsets = [
            c
            for row in system.rows
            for c, regressor in row.regressors.items()
            if regressor == "1" and c not in fixed and c not in absent
        ]
        return Unknowns(system, {**off, **given}, tuple(offsets), tuple(groups), ties)

    def motion(self, segments: Segments, timing: Timing, unknowns: Unknowns) -> SegmentedMotion:
        """Return the motion over segments."""
        return segmented_motion(unknowns.system, segments, timing, unknowns)

    def parameters(
        self, coefficients: Collection[str], input_unit: str
    ) -> tuple[PhysicalParameter, ...]:
        """Return the physical parameters that the coefficients determine, in the joint's units."""
        found = physical_parameters(coefficients, input_unit in FORCES, self.kind)
        return tuple(
            p if isinstance(p, ZeroAngle) else replace(p, unit=self.unit_of(p.unit, input_unit))
            for p in found
        )

    def unit_of(self, declared: str, input_unit: str) -> str:
        """Return this joint's unit for a declared unit."""
        named = f"({input_unit})" if " " in input_unit else input_unit
        return unit_of(declared, self.type).format(input=named)


def flexible() -> Joint:
    """Return the flexible joint of Huang (2003), eq. (4), with every further term."""
    smooth = flexible_joint(tuple(TERMS))
    every = TERMS | SHAPE_TERMS
    shaped = flexible_joint([name for name, term in every.items() if term.memory is None])
    whole = flexible_joint(tuple(every))
    return Joint(
        "flexible",
        tuple(
            with_dry_friction(each).seeking(SOUGHT_CONSTANTS) for each in (smooth, shaped, whole)
        ),
        (smooth, shaped),
        {name: term.coefficients for name, term in every.items()},
        frozenset(c for term in SHAPE_TERMS.values() for c in term.coefficients),
        COEFFICIENT_UNITS,
        ("link_position", "motor_position", "deflection"),
        TIES,
        {
            c: term.nonlinear
            for term in every.values()
            if term.nonlinear
            for c in (*term.link, *term.motor)
        },
        {term.nonlinear: 1.0 for term in every.values() if term.nonlinear},
    )


def link() -> Joint:
    """Return the link of the flexible joint alone, with every term of its row.

    The motor's measured position and velocity are its inputs. No coefficients are tied, since
    there is no motor row.
    """
    whole = flexible()
    usual, extended = (row_alone(system, "link") for system in whole.systems[:2])
    own = {*extended.coefficients}
    terms = {t: tuple(c for c in names if c in own) for t, names in whole.terms.items()}
    return Joint(
        "link",
        (usual, extended, extended),
        tuple(row_alone(system, "link") for system in whole.smoothed),
        {t: names for t, names in terms.items() if names},
        whole.shapes & own,
        {c: unit for c, unit in COEFFICIENT_UNITS.items() if c in own},
        ("link_position", "deflection"),
        nonlinear={c: name for c, name in whole.nonlinear.items() if c in own},
        first={name: value for name, value in whole.first.items() if name in own},
    )


def rigid() -> Joint:
    """Return the rigid joint with every term."""
    smooth = rigid_joint(tuple(RIGID_TERMS))
    dry = with_dry_friction(smooth)
    return Joint(
        "rigid",
        (dry,) * 3,
        (smooth,) * 2,
        {name: tuple(regressors) for name, regressors in RIGID_TERMS.items()},
        frozenset(),
        RIGID_UNITS,
        ("motor_position",),
    )


def joint_of(kind: Kind, joint_type: JointType = "revolute") -> Joint:
    """Return the joint of a kind; a prismatic joint lacks the terms of an angle."""
    joint = {"flexible": flexible, "link": link, "rigid": rigid}[kind]()
    if joint_type == "revolute":
        return joint
    never = {c for term in ANGULAR_TERMS for c in joint.terms.get(term, ())}
    return replace(
        joint._smoothed_over(COULOMB_VELOCITY[joint_type]),
        terms={term: names for term, names in joint.terms.items() if term not in ANGULAR_TERMS},
        shapes=joint.shapes - never,
        units={c: unit for c, unit in joint.units.items() if c not in never},
        ties={c: sources for c, sources in joint.ties.items() if c not in never},
        type=joint_type,
        never=frozenset(never),
    )


def _velocities(recording: Samples) -> FloatArray:
    assert recording.velocities is not None
    return recording.velocities


def _root_mean_square(parts: Sequence[FloatArray]) -> float:
    return float(np.sqrt(sum(float(x @ x) for x in parts) / sum(map(len, parts))))


@dataclass(frozen=True)
class ElasticArm:
    """Arm with all its terms."""

    balance: "TorqueBalance"
    resting: tuple[int, ...] = ()  # joints whose motors are at rest
    terms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # no optional terms
    ties: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)
    nonlinear: Mapping[str, str] = field(default_factory=dict)
    first: Mapping[str, float] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of link position, motor position and deflection of each joint."""
        kinds = ("link_position", "motor_position", "deflection")
        joints = range(1, self.balance.joints + 1)
        return tuple(f"{kind}_{joint}" for joint in joints for kind in kinds)

    def channels_of(
        self,
        positions: FloatArray,
        inputs: FloatArray,  # noqa: ARG002 - same signature as for a joint
    ) -> FloatArray:
        """Return the channels, shape (n, 3 n_joints), in rad."""
        links, motors = positions[:, ::2], positions[:, 1::2]
        return np.stack((links, motors, links - motors), axis=2).reshape(len(positions), -1)

    def unknowns(
        self,
        absent: Collection[str],
        fixed: Mapping[str, float],
        groups: Sequence[int] = (),  # noqa: ARG002 - same signature as for a joint
    ) -> Unknowns:
        """Return the unknowns, with absent and fixed parameters at their values."""
        known = {**dict.fromkeys(absent, 0.0), **fixed}
        # The estimators use only the names, constants and compiled motion of a system.
        return Unknowns(cast(ParametricSystem, self.balance), known)

    def with_widths(
        self,
        widths: Mapping[str, float],  # noqa: ARG002 - same signature as for a joint
    ) -> "ElasticArm":
        """Return the arm unchanged, since its terms have no sought constants."""
        return self

    def motion(self, segments: Segments, timing: Timing, unknowns: Unknowns) -> SegmentedMotion:
        """Return the motion over segments."""
        return segmented_motion(unknowns.system, segments, timing, unknowns)
