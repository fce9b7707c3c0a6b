"""The model of an estimate once more: joint, coefficients and delays, ready to run over a log."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isclose

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.estimators.segmented_motion import Point, SegmentedMotion, segmented_motion
from flexid.estimators.segments import Segments
from flexid.estimators.unknowns import Unknowns
from flexid.identification.full_model.model import LINK, Data, Structure
from flexid.identification.preparation.joint import Joint, Kind, joint_of
from flexid.identification.result.identification import Identification
from flexid.recording.recording import Hold

_SAME = 1e-6  # relative difference of a tied coefficient to what it follows from that is rounding


@dataclass(frozen=True, eq=False)
class JointModel:
    """A joint with values, ready to run over a log.

    Offsets that were found log by log have nothing to say of another log; their mean is taken.
    """

    kind: Kind
    coefficients: Mapping[str, float]  # an offset of the second log is "offset[2]"
    hold: Hold
    delays: Mapping[str, float] = field(default_factory=dict)  # in s, by name
    coulomb_velocity: float | None = None  # in rad/s; None where friction is dry
    shapes: Mapping[str, float] = field(default_factory=dict)  # constants of shapes, by name
    given: Collection[str] = ()  # coefficients that are not sought

    @classmethod
    def of(cls, result: Identification, group: int | None = None) -> "JointModel":
        """The model of an identification for one of its logs, counted from 0, or for all."""
        label = "" if group is None else f"[{group + 1}]"
        own = {
            name.removesuffix(label): c.value
            for name, c in result.coefficients.items()
            if group is None or "[" not in name or name.endswith(label)
        }
        choices, alignment = result.choices, result.choices.alignment
        delays = {INPUT: alignment.input_delay.value, LINK: alignment.link_delay.value}
        return cls(
            result.model, own, choices.hold, delays, choices.coulomb_velocity, choices.shapes
        )

    @cached_property
    def structure(self) -> Structure:
        """Joint, absent terms, timing and fixed coefficients; a `SettingError` if none is made."""
        values = self.by_coefficient
        joint = joint_of(self.kind)
        unknown = [name for name in values if name not in joint.units]
        if unknown:
            raise SettingError(unknown[0], f"is no coefficient of the {self.kind} joint")
        joint = self._with_constants(joint)
        needed = [
            c for c in joint.system.coefficients if c not in joint.optional and c not in values
        ]
        if needed:
            raise SettingError(
                needed[0], "is missing: every joint of this kind has that coefficient"
            )
        absent = frozenset(c for c in joint.optional if c not in values)
        delays = {name: d for name, d in self.delays.items() if d}
        if self.kind == "rigid":
            delays.pop(LINK, None)
        fixed = {c: value for c, value in values.items() if c in self.given}
        fixed |= _untied(joint, values, absent)
        return Structure(joint, absent, Timing(self.hold, delays), fixed)

    @property
    def joint(self) -> Joint:
        """The joint."""
        return self.structure.joint

    @cached_property
    def unknowns(self) -> Unknowns:
        """The coefficients that are sought."""
        return self.structure.unknowns(())

    @property
    def values(self) -> FloatArray:
        """Values of the unknowns, shape (k,)."""
        return np.array([self.by_coefficient[name] for name in self.unknowns.names])

    def motion(
        self, segments: Segments, noise: FloatArray, data: Data, sought: Sequence[str] = ()
    ) -> tuple[SegmentedMotion, Point]:
        """The model over segments, with initial states near the measured positions."""
        timing = self.structure.timing
        delays = [name for name in (INPUT, LINK) if name in sought]
        timing = Timing(timing.hold, timing.delays, tuple(delays), data.relative_to)
        late = [timing.delays.get(name, 0.0) for name in delays]
        problem = segmented_motion(self.unknowns.system, segments, timing, self.unknowns)
        point = Point(np.concatenate((self.values, late)), problem.start_states)
        return problem.at(point, 1.0 / noise), point

    @cached_property
    def by_coefficient(self) -> dict[str, float]:
        """One value for each coefficient: the mean over the logs where each has its own."""
        found: dict[str, list[float]] = {}
        for name, value in self.coefficients.items():
            found.setdefault(name.partition("[")[0], []).append(value)
        return {name: float(np.mean(each)) for name, each in found.items()}

    def _with_constants(self, joint: Joint) -> Joint:
        used = joint.shapes & {*self.by_coefficient}
        if self.coulomb_velocity is not None:
            if used:
                raise SettingError(
                    sorted(used)[0], "goes with dry friction only, and coulomb_velocity smooths it"
                )
            return joint.with_coulomb_velocity(self.coulomb_velocity)
        wanted = joint.constants_of(used)
        missing = sorted({*wanted} - {*self.shapes})
        if missing:
            raise SettingError(missing[0], "is missing, without which its term says nothing")
        widths = {name: self.shapes[name] for name in sorted(wanted)}
        return joint.with_widths(widths) if widths else joint


def _untied(joint: Joint, values: Mapping[str, float], absent: frozenset[str]) -> dict[str, float]:
    """Coefficients that usually follow from others but have a value of their own here."""
    own = {}
    for name, sources in joint.ties.items():
        if name in values:
            follows = 0.0
            if sources[0] not in absent and values[sources[2]]:
                a, b, d = (values[c] for c in sources)
                follows = a * b / d
            if not isclose(values[name], follows, rel_tol=_SAME):
                own[name] = values[name]
    return own
