"""Options of an online estimation: channels, model, sample time, filter and memory."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from math import inf, isfinite
from typing import Any, Literal, cast

from flexid.errors import RecordingError, SettingError, check_names
from flexid.estimators.state_variable_filter import FASTEST, SLOWEST, check_filter_rate
from flexid.estimators.unknowns import Unknowns
from flexid.identification.preparation.joint import Joint, Kind, joint_of
from flexid.identification.preparation.recordings import traits
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import Stated, stated
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.flexible_joint import (
    ANGULAR_TERMS,
    COULOMB_VELOCITY,
    RIGID_TERMS,
    SHAPE_TERMS,
    SQUARES,
    TERMS,
    WIDTHS,
    joint_model,
    rigid_terms,
)
from flexid.models.motion import JointType
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import ANGLES
from flexid.recording.jumps import TURN
from flexid.recording.recording import INPUTS, Channel
from flexid.recording.sampling import check_sample_time

LATE = 0.1  # largest delay of a channel without a warning, over the sample time


@dataclass(frozen=True)
class StreamChannels:
    """Channels of a stream, which are the values of each sample."""

    kind: Kind  # flexible: two encoders and an input; link: no input; rigid: one encoder
    input_unit: str  # empty if there is no input
    from_deflection: bool  # whether the first position is the joint's deflection
    warnings: tuple[str, ...]  # assumptions about the columns
    motor_turn: float = 0.0  # see `WatchOptions`
    joint_type: JointType = "revolute"
    # by name, in the order of a sample, with the values of the first samples
    sampled: Mapping[str, Channel] = field(default_factory=dict, compare=False)


def chosen_channels(
    source: str, channels: Mapping[str, Channel], warnings: tuple[str, ...], model: str = "auto"
) -> StreamChannels:
    """Return the channels to use: time, one or two positions, input; raise if one is missing."""
    drive = next((name for name in INPUTS if name in channels), None)
    link = next((name for name in ("deflection", "link_position") if name in channels), None)
    if "motor_position" not in channels:
        raise RecordingError(
            source,
            "motor position",
            "is not among the columns, and a stream's velocities are not integrated: send it",
        )
    kind = model
    if model == "auto" and link is None and "link_velocity" in channels:
        kind = "flexible"
    elif model == "auto":
        kind = "rigid" if link is None else "link" if drive is None else "flexible"
    if kind != "link" and drive is None:
        raise RecordingError(
            source,
            "input",
            "no torque, current or voltage is among the columns, and the motor cannot be "
            "identified without one: send it too",
        )
    if kind != "rigid" and link is None:
        raise RecordingError(
            source, "link position", "is not among the columns: send it too, or --model rigid"
        )
    link, drive = link if kind != "rigid" else None, drive if kind != "link" else None
    ratio = channels["motor_position"].origin.ratio
    return StreamChannels(
        cast(Kind, kind),
        channels[drive].unit if drive else "",
        link == "deflection",
        warnings,
        TURN / abs(ratio) if ratio else 0.0,
        channels["motor_position"].joint,
        {name: channels[name] for name in ("time", link, "motor_position", drive) if name},
    )


_USUAL_FRICTION = ("motor_viscous", "joint_damping", "motor_coulomb")
USUAL_TERMS: Mapping[JointType, tuple[str, ...]] = {
    "revolute": ("gravity", *_USUAL_FRICTION),
    "prismatic": (*_USUAL_FRICTION, "link_offset", "motor_offset"),
}
"""Default terms of the model; on a slope gravity is a constant force, so offsets describe it."""

FILTER_RATE = 20.0  # default rate of the filter in 1/s; lower if the sample time requires it
RATES = (1.0, 0.25, 4.0)  # multiples of the filter rate that run in parallel; the first is the main
KINDS = ("flexible", "link", "rigid")  # models of the joint
USABLE_TERMS = {n: t for n, t in (TERMS | SHAPE_TERMS).items() if t.memory is None}
"""Terms that a joint with two encoders may have: all but those with memory."""


@dataclass(frozen=True)
class WatchOptions:
    """Options that are fixed while a stream is watched."""

    sample_time: float  # in s
    terms: tuple[str, ...] = USUAL_TERMS["revolute"]  # terms of the joint besides its spring
    # flexible: link and motor have an encoder each, and there is an input; link: the motor's
    # measured motion drives the link; rigid: the drive has one encoder
    kind: Kind = "flexible"
    # the input between samples: linear or constant. With ``"auto"`` it is taken as linear, and
    # the intervals cover the difference to a constant one
    hold: Literal["auto", "linear", "zero"] = "auto"
    filter_rate: float = FILTER_RATE  # λ of the filter, in 1/s
    memory: float = inf  # s after which a sample's weight falls to 1/e; infinite: no forgetting
    # velocity over which the smoothed Coulomb friction changes its sign, in rad/s or m/s
    coulomb_velocity: float = COULOMB_VELOCITY["revolute"]
    input_unit: str = "N m"  # of the input; empty for the link alone
    from_deflection: bool = False  # whether the first position is the joint's deflection
    # constants of the terms that have a shape, by name
    shapes: Mapping[str, float] = field(default_factory=dict)
    # physical parameters or coefficients, as in `Settings`
    known: Mapping[str, float] = field(default_factory=dict)
    # standard deviations of known values; one without a deviation is exact
    known_deviations: Mapping[str, float] = field(default_factory=dict)
    # value and half-width of the interval of each physical parameter in the reference estimate
    reference: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    joint_type: JointType = "revolute"
    # One turn of the motor, measured on the link's side of the gear, in rad or m, if its encoder
    # may wrap by such turns; 0 if the encoder is behind the gear or there is no gear
    motor_turn: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        check_sample_time(self.sample_time)
        check_names("terms", self.terms, _known_terms(self.kind, self.joint_type))
        check_filter_rate(
            self.filter_rate, self.sample_time, slowest=min(RATES), fastest=max(RATES)
        )
        if not self.memory > 20.0 / self.filter_rate:
            raise SettingError(
                "memory",
                f"must be longer than the filter's memory, got {self.memory} s: give more than "
                f"{20.0 / self.filter_rate:.3g} s",
            )
        if self.kind == "link":
            object.__setattr__(self, "input_unit", "")
            if self.hold != "auto":
                raise SettingError("hold", "is of an input, and the link alone has none: omit it")
        pairs = {name: (float(was), float(half)) for name, (was, half) in self.reference.items()}
        object.__setattr__(self, "reference", pairs)
        _ = self.stated  # raises
        missing = [name for name in WIDTHS if name in self.system.constants.keys() - self.shapes]
        if missing:
            raise SettingError(
                "terms", f"one of them needs a {missing[0]}: give an estimate that has it"
            )

    @cached_property
    def stated(self) -> Stated:
        """Known values of the drive, with their deviations."""
        deviations = {**self.known_deviations}
        settings = Settings(terms=self.terms, known={**self.known}, known_deviations=deviations)
        return stated(settings, self.joint, self.input_unit)

    @cached_property
    def joint(self) -> Joint:
        """Joint of this kind, with units and physical parameters."""
        return joint_of(self.kind, self.joint_type)

    @cached_property
    def unknowns(self) -> Unknowns:
        """Unknown coefficients of the model, and those with a given value."""
        return Unknowns(self._system({}), self.given)

    @property
    def given(self) -> Mapping[str, float]:
        """Coefficients with a fixed value: known exactly, or negligible and set to zero."""
        too_small = {c for t in self.terms for c in self.joint.terms.get(t, ()) if c in SQUARES}
        return dict.fromkeys(sorted(too_small), 0.0) | {**self.stated.given}

    @property
    def n_encoders(self) -> int:
        """Number of positions in a sample."""
        return 1 if self.kind == "rigid" else 2

    @property
    def n_inputs(self) -> int:
        """Number of inputs in a sample."""
        return 0 if self.kind == "link" else 1

    @property
    def system(self) -> ParametricSystem:
        """Model of the joint, with fixed coefficients moved to its known parts."""
        return self._system(self.given)

    def _system(self, known: Mapping[str, float]) -> ParametricSystem:
        return joint_model(self.kind, self.terms, known, self.coulomb_velocity, self.shapes)

    @property
    def document(self) -> dict[str, Any]:
        """Options ready for JSON; an infinite memory is None."""
        memory = self.memory if isfinite(self.memory) else None
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"memory": memory}


def check_comparable(result: Identification) -> None:
    """Raise if a stream cannot be compared with an identification."""
    terms = result.choices.terms
    remembering = [term for term in terms if (s := SHAPE_TERMS.get(term)) and s.memory]
    if remembering:
        left = ",".join(term for term in terms if term not in remembering)
        raise SettingError(
            "estimate",
            f"has {remembering[0]}, which depends on the path of the motion, and recursive least "
            f"squares cannot have it: identify with --terms {left or 'none'}, and use that",
        )
    if not _reference(result):
        raise SettingError(
            "estimate", "determines no parameter that a stream could be compared with: give another"
        )
    unknown = [name for name, value in given_values(result).items() if not isfinite(value)]
    if unknown:
        raise SettingError(
            "estimate", f"has no value of {unknown[0]}, which a stream needs: identify once more"
        )


def wanted_kind(chosen: Mapping[str, Any], estimate: Identification | None) -> str:
    """Return the chosen kind of joint, or else the estimate's, or else ``"auto"``."""
    kind = chosen.get("kind", "auto")
    if kind not in ("auto", *KINDS):
        raise SettingError("model", f"must be auto, flexible, link or rigid, got {kind!r}")
    return estimate.model if kind == "auto" and estimate is not None else kind


def options_of_stream(
    chosen: Mapping[str, Any],
    estimate: Identification | None,
    channels: StreamChannels,
    sample_time: float,
    stated: Collection[str] = (),
) -> WatchOptions:
    """Combine chosen options, by field name, with those of the estimate (for None and "auto")."""
    check_sample_time(sample_time)
    chosen = {name: v for name, v in chosen.items() if v is not None and v != "auto"}
    if "terms" in chosen:
        chosen["terms"] = _named(chosen["terms"], channels)
    usual = USUAL_TERMS[channels.joint_type]
    usual = rigid_terms(usual) if channels.kind == "rigid" else usual
    defaults: dict[str, Any] = {
        "terms": usual,
        "filter_rate": FILTER_RATE,
        "coulomb_velocity": COULOMB_VELOCITY[channels.joint_type],
    }
    given: dict[str, float] = {}
    if estimate is not None:
        _check_alike(estimate, channels)
        defaults |= _options_of(estimate)
        kept = chosen.get("terms", defaults["terms"])
        off = [term for term in defaults["terms"] if term not in kept]
        terms = joint_of(channels.kind, channels.joint_type).terms
        left = {*stated, *(c for term in off for c in terms.get(term, ()))}
        given = {name: v for name, v in given_values(estimate).items() if name not in left}
    slowest, fastest = SLOWEST / min(RATES), FASTEST / max(RATES)
    rate = min(max(defaults["filter_rate"], slowest / sample_time), fastest / sample_time)
    shown = {
        "sample_time": sample_time,
        "kind": channels.kind,
        "input_unit": channels.input_unit,
        "from_deflection": channels.from_deflection,
        "motor_turn": channels.motor_turn,
        "joint_type": channels.joint_type,
        "known": {**given, **chosen.get("known", {})},
    }
    return WatchOptions(**{**defaults, "filter_rate": rate, **chosen, **shown})


def _known_terms(kind: Kind, joint_type: JointType) -> list[str]:
    """Return the terms that the joint may have; angular terms only if it is revolute."""
    known = [*RIGID_TERMS] if kind == "rigid" else [*USABLE_TERMS]
    return [n for n in known if joint_type == "revolute" or n not in ANGULAR_TERMS]


def _named(terms: Sequence[str], channels: StreamChannels) -> tuple[str, ...]:
    """Return the user's terms by the names of this kind of joint; raise if it lacks one."""
    check_names("terms", terms, USABLE_TERMS | RIGID_TERMS)
    kind = channels.kind
    known = _known_terms(kind, channels.joint_type)
    if kind == "link":
        known = [name for name in known if USABLE_TERMS[name].link]
    slides = "prismatic " if channels.joint_type == "prismatic" else ""
    found: list[str] = []
    for term in terms:
        own = {term} if term in known or kind != "rigid" else {*rigid_terms((term,))}
        if not own & {*known}:
            raise SettingError(
                "terms",
                f"{term!r} is no term of the {slides}{kind} joint; it has {', '.join(known)}",
            )
        found += own
    return tuple(dict.fromkeys(found))


def _check_alike(estimate: Identification, channels: StreamChannels) -> None:
    """Raise if the estimate is of another kind of joint or input than the stream."""
    made = {"model": estimate.model, **traits(estimate.joint, estimate.input_unit)}
    shown = {"model": channels.kind, **traits(channels.joint_type, channels.input_unit)}
    for name, words in shown.items():
        if words != made[name]:
            reason = f"has {name} {made[name]}, and the stream {words}: give one of this drive"
            raise SettingError("estimate", reason)


def _options_of(result: Identification) -> dict[str, Any]:
    """Return the fields of `WatchOptions` that an identification determines."""
    choices = result.choices
    hold = "zero" if choices.hold == "zero" else "linear"
    found: dict[str, Any] = {
        "terms": choices.terms,
        "hold": "auto" if result.model == "link" else hold,
        "shapes": {**choices.shapes},
        "reference": _reference(result),
    }
    if isfinite(choices.filter_rate):
        found["filter_rate"] = choices.filter_rate
    if choices.coulomb_velocity is not None:
        found["coulomb_velocity"] = choices.coulomb_velocity
    return found


def given_values(result: Identification) -> dict[str, float]:
    """Return the values of the coefficients that a stream takes from the estimate."""
    names = result.given | SQUARES
    return {name: c.value for name, c in result.coefficients.items() if name in names}


def not_accounted_for(result: Identification, sample_time: float) -> Iterator[str]:
    """Yield a warning for each correction of an identification that a stream lacks."""
    alignment = result.choices.alignment
    late = {"input": alignment.input_delay.value, "link's encoder": alignment.link_delay.value}
    for name, delay in late.items():
        if abs(delay) > LATE * sample_time:
            yield (
                f"the estimate found the {name} late by {1e3 * delay:.3g} ms, and a stream is "
                f"not corrected: send it in time, or inertias, friction and damping seem to "
                f"have changed"
            )
    if result.choices.amplifier.corrects:
        yield (
            "the estimate corrected the log for an amplifier or a filter, and a stream is not "
            "corrected: send the input that reaches the motor, and positions without a filter, or "
            "gain and friction seem to have changed"
        )


def _reference(result: Identification) -> dict[str, tuple[float, float]]:
    """Return the value and half the 95 % interval of each determined physical parameter."""
    return {
        name: (found.value, found.half_width)
        for name, found in result.parameters.items()
        if found.verdict == "determined" and _is_known(found)
    }


def _is_known(found: ValueEstimate) -> bool:
    if "[" in found.name or not all(map(isfinite, (found.value, found.std, *found.interval))):
        return False
    return found.value != 0.0 or found.name in ANGLES
