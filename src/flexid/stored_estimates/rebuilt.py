"""The model of an estimate once more: joint, coefficients and delays, ready to run over a log."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
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


@dataclass(frozen=True)
class Described:
    """What makes up the model of an estimate."""

    model: Kind
    coefficients: Mapping[str, float]  # an offset of the second log is "offset[2]"
    hold: Hold
    delays: Mapping[str, float] = field(default_factory=dict)  # in s, by name
    coulomb_velocity: float | None = None  # in rad/s; None where friction is dry
    shapes: Mapping[str, float] = field(default_factory=dict)  # constants of shapes, by name


def described(result: Identification, group: int | None = None) -> Described:
    """The model of an identification for one of its logs, counted from 0, or for all together."""
    label = "" if group is None else f"[{group + 1}]"
    own = {
        name.removesuffix(label): c.value
        for name, c in result.coefficients.items()
        if group is None or "[" not in name or name.endswith(label)
    }
    choices = result.choices
    delays = {
        INPUT: choices.alignment.input_delay.value,
        LINK: choices.alignment.link_delay.value,
    }
    return Described(
        result.model, own, choices.hold, delays, choices.coulomb_velocity, choices.shapes
    )


def given_coefficients(result: Identification) -> frozenset[str]:
    """Coefficients of an identification that were not estimated."""
    return frozenset(n.partition("[")[0] for n, c in result.coefficients.items() if c.std == 0.0)


def input_unit_of(result: Identification) -> str:
    """Unit of the input that an identification was made of; empty for the link alone."""
    gain = result.coefficients.get("beta1")
    return "" if gain is None else gain.unit.removeprefix("rad/s^2/").strip("()")


@dataclass(frozen=True, eq=False)
class Rebuilt:
    """A model with its values."""

    structure: Structure  # none of whose delays is sought
    unknowns: Unknowns
    values: FloatArray  # of the unknowns, shape (k,)

    @property
    def joint(self) -> Joint:
        """The joint."""
        return self.structure.joint

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


def rebuilt(described: Described, given: Collection[str] = ()) -> Rebuilt:
    """Build the model of an estimate.

    Offsets that were found log by log have nothing to say of another log; their mean is taken.
    """
    values = _by_coefficient(described.coefficients)
    joint = joint_of(described.model)
    unknown = [name for name in values if name not in joint.units]
    if unknown:
        raise SettingError(unknown[0], f"is no coefficient of the {described.model} joint")
    joint = _with_constants(joint, described, values)
    needed = [c for c in joint.system.coefficients if c not in joint.optional and c not in values]
    if needed:
        raise SettingError(needed[0], "is missing: every joint of this kind has that coefficient")
    absent = frozenset(c for c in joint.optional if c not in values)
    delays = {name: d for name, d in described.delays.items() if d}
    if described.model == "rigid":
        delays.pop(LINK, None)
    fixed = {c: value for c, value in values.items() if c in given}
    fixed |= _untied(joint, values, absent)
    structure = Structure(joint, absent, Timing(described.hold, delays), fixed)
    unknowns = structure.unknowns(())
    return Rebuilt(structure, unknowns, np.array([values[name] for name in unknowns.names]))


def averaged_offsets(coefficients: Collection[str]) -> tuple[str, ...]:
    """Coefficients that were found log by log."""
    return tuple(dict.fromkeys(n.partition("[")[0] for n in coefficients if "[" in n))


def _by_coefficient(coefficients: Mapping[str, float]) -> dict[str, float]:
    """One value for each coefficient: the mean over the logs where each has its own."""
    found: dict[str, list[float]] = {}
    for name, value in coefficients.items():
        found.setdefault(name.partition("[")[0], []).append(value)
    return {name: float(np.mean(each)) for name, each in found.items()}


def _with_constants(joint: Joint, described: Described, values: Mapping[str, float]) -> Joint:
    used = joint.shapes & {*values}
    if described.coulomb_velocity is not None:
        if used:
            raise SettingError(
                sorted(used)[0], "goes with dry friction only, and coulomb_velocity smooths it"
            )
        return joint.with_coulomb_velocity(described.coulomb_velocity)
    wanted = joint.constants_of(used)
    missing = sorted({*wanted} - {*described.shapes})
    if missing:
        raise SettingError(missing[0], "is missing, without which its term says nothing")
    widths = {name: described.shapes[name] for name in sorted(wanted)}
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
