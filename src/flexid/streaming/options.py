"""What an estimation next to a drive is given: the model, the clock, the filter, the memory."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from math import inf, isfinite
from typing import Any, Literal

from flexid.errors import SettingError
from flexid.estimators.state_variable_filter import FASTEST, SLOWEST, check_filter_rate
from flexid.estimators.unknowns import Unknowns
from flexid.identification.preparation.joint import Joint, Kind, joint_of
from flexid.identification.preparation.settings import Settings
from flexid.identification.preparation.stated import Stated, stated
from flexid.identification.result.identification import Identification
from flexid.models.arm_file import refuse_arm_file
from flexid.models.flexible_joint import SHAPE_TERMS, SHAPES, SQUARES, TERMS, flexible_joint
from flexid.models.parametric_system import ParametricSystem
from flexid.models.rigid_joint import rigid_joint, rigid_terms, row_alone
from flexid.models.terms import COULOMB_VELOCITY, check_terms
from flexid.recording.sampling import check_sample_time
from flexid.recording.wraps import TURN
from flexid.streaming.channels import StreamChannels
from flexid.streaming.departures import given_values, taken_from

USUAL_TERMS = ("gravity", "motor_viscous", "joint_damping", "motor_coulomb")
"""Terms of the model where none are named."""

FILTER_RATE = 20.0  # of the filter in 1/s, where the samples come often enough for it
RATES = (1.0, 0.25, 4.0)  # multiples of the filter rate that run side by side; the first is asked
KINDS = ("flexible", "link", "rigid")  # models of the joint
USABLE_TERMS = {n: t for n, t in (TERMS | SHAPE_TERMS).items() if t.memory is None}
"""Terms that may be named: least squares has no memory."""

_INPUT_UNITS = ("N m", "A", "V")


@dataclass(frozen=True)
class WatchOptions:
    """What does not change while a stream is watched."""

    sample_time: float  # in s
    terms: tuple[str, ...] = USUAL_TERMS  # terms of the flexible joint besides its spring
    # whether link and motor have an encoder each, and there is an input; or the link is driven by
    # the motor's measured motion; or the drive has one encoder
    kind: Kind = "flexible"
    # the input between samples: on straight lines, or held. With ``"auto"`` it is taken as on
    # lines, and the intervals cover what a held one would give
    hold: Literal["auto", "linear", "zero"] = "auto"
    filter_rate: float = FILTER_RATE  # λ of the filter, in 1/s
    memory: float = inf  # seconds after which a sample weighs 1/e as much; infinite: nothing fades
    # velocity in rad/s over which Coulomb friction changes its sign
    coulomb_velocity: float = COULOMB_VELOCITY
    input_unit: str = "N m"  # of what drives the motor; empty for the link alone
    from_deflection: bool = False  # whether the link's position comes as the joint's deflection
    # constants of the shapes of unusual terms, by name
    shapes: Mapping[str, float] = field(default_factory=dict)
    # physical parameters or coefficients, as in `Settings`
    known: Mapping[str, float] = field(default_factory=dict)
    # standard deviations of what is known; what has none is known exactly
    known_deviations: Mapping[str, float] = field(default_factory=dict)
    # physical parameters by an estimate made before, and half of their intervals
    reference: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # A turn of the motor at the link's side of the gear, in rad, where its encoder may wrap by
    # such turns; 0 where it stands behind the gear, or there is none
    motor_turn: float = 0.0
    input_delay: float = 0.0  # s, by which the input acts later than it comes
    link_delay: float = 0.0  # s, by which the link's encoder, or the deflection's, is late

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        check_sample_time(self.sample_time)
        check_terms(self.terms, USABLE_TERMS)
        if self.kind not in KINDS:
            raise SettingError("model", f"must be flexible, link or rigid, got {self.kind!r}")
        if self.hold not in ("auto", "linear", "zero"):
            raise SettingError("hold", f"must be auto, linear or zero, got {self.hold!r}")
        check_filter_rate(
            self.filter_rate, self.sample_time, slowest=min(RATES), fastest=max(RATES)
        )
        if not self.memory > 20.0 / self.filter_rate:
            raise SettingError(
                "memory",
                f"must be longer than the filter's memory, got {self.memory} s: give more than "
                f"{20.0 / self.filter_rate:.3g} s",
            )
        if not 0.0 <= self.motor_turn <= TURN:
            raise SettingError(
                "motor turn",
                f"must be 0 to {TURN:.4g} rad at the link's side, got {self.motor_turn}",
            )
        if self.kind == "link":
            object.__setattr__(self, "input_unit", "")
            if self.hold != "auto":
                raise SettingError("hold", "is of an input, and the link alone has none: leave it")
        elif self.input_unit not in _INPUT_UNITS:
            raise SettingError(
                "input unit", f"must be one of {', '.join(_INPUT_UNITS)}, got {self.input_unit!r}"
            )
        pairs = {name: (float(was), float(half)) for name, (was, half) in self.reference.items()}
        object.__setattr__(self, "reference", pairs)
        _ = self.stated  # raises
        missing = [name for name in SHAPES if name in self.system.constants.keys() - self.shapes]
        if missing:
            raise SettingError(
                "terms", f"one of them needs a {missing[0]}, which an estimate has: give one"
            )

    @cached_property
    def stated(self) -> Stated:
        """What the user states of the drive."""
        terms = rigid_terms(self.terms) if self.kind == "rigid" else self.terms
        settings = Settings(
            terms=terms, known={**self.known}, known_deviations={**self.known_deviations}
        )
        return stated(settings, self.joint, self.input_unit)

    @cached_property
    def joint(self) -> Joint:
        """The joint of this kind: units, and physical parameters."""
        return joint_of(self.kind)

    @cached_property
    def unknowns(self) -> Unknowns:
        """What is sought of the model, and what is given."""
        return Unknowns(self._system({}), self.given)

    @property
    def given(self) -> Mapping[str, float]:
        """Coefficients that are known exactly, and those too small to be sought."""
        too_small = {c for t in self.terms for c in USABLE_TERMS[t].coefficients if c in SQUARES}
        return dict.fromkeys(sorted(too_small & {*self.joint.units}), 0.0) | {**self.stated.given}

    @property
    def n_encoders(self) -> int:
        """Positions in a sample."""
        return 1 if self.kind == "rigid" else 2

    @property
    def n_inputs(self) -> int:
        """Inputs in a sample."""
        return 0 if self.kind == "link" else 1

    @property
    def width(self) -> int:
        """Numbers in a sample: the time, positions, and the input."""
        return 1 + self.n_encoders + self.n_inputs

    @property
    def system(self) -> ParametricSystem:
        """The model; what is known exactly is in its known parts."""
        return self._system(self.given)

    def _system(self, known: Mapping[str, float]) -> ParametricSystem:
        if self.kind == "rigid":
            return rigid_joint(rigid_terms(self.terms), known, self.coulomb_velocity)
        whole = flexible_joint(self.terms, known, self.coulomb_velocity)
        used = {name: width for name, width in self.shapes.items() if name in whole.constants}
        whole = whole.with_constants(used)
        return row_alone(whole, "link") if self.kind == "link" else whole

    @property
    def document(self) -> dict[str, Any]:
        """The options, ready for JSON; an endless memory is None."""
        endless = self.memory if isfinite(self.memory) else None
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"memory": endless}

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> "WatchOptions":
        """The options that a document holds."""
        names = {f.name for f in fields(cls)}
        if not isinstance(document, Mapping) or {*document} != names:
            raise SettingError("checkpoint", "its options are not those of this version")
        memory = document["memory"]
        try:
            return cls(**{**document, "memory": inf if memory is None else memory})
        except (TypeError, ValueError, AttributeError):
            raise SettingError("checkpoint", "its options are of wrong types") from None


def wanted_kind(chosen: Mapping[str, Any], estimate: Identification | None) -> str:
    """The kind of joint that is asked for: as chosen, or that of the estimate; else ``"auto"``."""
    kind = chosen.get("kind", "auto")
    refuse_arm_file(str(kind))
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
    """What a user chooses, by the names of the fields; None and "auto": as in the estimate."""
    check_sample_time(sample_time)
    chosen = {name: v for name, v in chosen.items() if v is not None and v != "auto"}
    follows: dict[str, Any] = {"terms": USUAL_TERMS, "filter_rate": FILTER_RATE}
    given: dict[str, float] = {}
    if estimate is not None:
        _check_alike(estimate, channels)
        follows |= taken_from(estimate)
        kept = chosen.get("terms", follows["terms"])
        off = [USABLE_TERMS[t] for t in follows["terms"] if t in USABLE_TERMS and t not in kept]
        left = {*stated, *(coefficient for term in off for coefficient in term.coefficients)}
        given = {name: v for name, v in given_values(estimate).items() if name not in left}
    slowest, fastest = SLOWEST / min(RATES), FASTEST / max(RATES)
    rate = min(max(follows["filter_rate"], slowest / sample_time), fastest / sample_time)
    shown = {
        "sample_time": sample_time,
        "kind": channels.kind,
        "input_unit": channels.input_unit,
        "from_deflection": channels.from_deflection,
        "motor_turn": channels.motor_turn,
        "known": {**given, **chosen.get("known", {})},
    }
    return WatchOptions(**{**follows, "filter_rate": rate, **chosen, **shown})


def _check_alike(estimate: Identification, channels: StreamChannels) -> None:
    """Refuse an estimate of another joint or input than the channels show."""
    if estimate.model != channels.kind:
        raise SettingError(
            "estimate",
            f"is of the {estimate.model} joint, and these channels show the {channels.kind} one",
        )
    if estimate.input_unit != channels.input_unit:
        raise SettingError(
            "estimate",
            f"is of an input in {estimate.input_unit}, and that of the stream is in "
            f"{channels.input_unit}: compare like with like",
        )
