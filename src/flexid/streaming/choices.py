"""What a user chooses of a stream's estimation, and what follows from the stream."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Literal

from flexid.errors import SettingError
from flexid.estimators.filter_rate import FASTEST, SLOWEST
from flexid.models.terms import COULOMB_VELOCITY
from flexid.streaming.commissioned import Commissioned
from flexid.streaming.options import KINDS, RATES, USABLE_TERMS, USUAL_TERMS, WatchOptions


@dataclass(frozen=True)
class Choices:
    """What a user chooses; the rest follows from the stream, or from an estimate made before."""

    # See `WatchOptions`; None takes those of the estimate, or the usual ones
    terms: tuple[str, ...] | None = None
    hold: str = "auto"  # With ``"auto"`` that of the estimate, if there is one
    # In 1/s; None takes that of the estimate, or 20, as far as the sample time allows
    filter_rate: float | None = None
    memory: float = inf  # In s
    coulomb_velocity: float | None = None  # In rad/s; None takes that of the estimate, or 0.1
    sample_time: float | None = None  # In s; None takes it from the first time stamps
    # Of the joint; with ``"auto"`` that of the estimate, or what the channels show
    model: str = "auto"
    known: Mapping[str, float] = field(default_factory=dict)  # See `WatchOptions`
    known_deviations: Mapping[str, float] = field(default_factory=dict)  # See `WatchOptions`
    estimate: Commissioned | None = None  # What the stream is held against

    def __post_init__(self) -> None:
        if self.model not in ("auto", *KINDS):
            raise SettingError("model", f"{self.model!r} is none: give auto, {', '.join(KINDS)}")

    @property
    def wanted_model(self) -> str:
        """The model that is asked for."""
        if self.model == "auto" and self.estimate is not None:
            return self.estimate.kind
        return self.model

    def options(
        self,
        kind: Literal["flexible", "link", "rigid"],
        input_unit: str,
        sample_time: float,
        *,
        from_deflection: bool,
        motor_turn: float = 0.0,
    ) -> WatchOptions:
        """Options of a session."""
        made = self.estimate or Commissioned(kind, USUAL_TERMS, hold="auto")
        if made.kind != kind:
            raise SettingError(
                "estimate", f"is of the {made.kind} joint, and these channels show the {kind} one"
            )
        if self.estimate is not None and made.input_unit != input_unit:
            raise SettingError(
                "estimate",
                f"is of an input in {made.input_unit}, and that of the stream is in {input_unit}: "
                f"compare like with like",
            )
        rate = self.filter_rate
        if rate is None:
            slowest, fastest = SLOWEST / min(RATES), FASTEST / max(RATES)
            rate = min(max(made.filter_rate, slowest / sample_time), fastest / sample_time)
        asked = (self.coulomb_velocity, made.coulomb_velocity, COULOMB_VELOCITY)
        hold = made.hold if self.hold == "auto" and kind != "link" else self.hold
        terms = made.terms if self.terms is None else self.terms
        off = [USABLE_TERMS[t] for t in made.terms if t in USABLE_TERMS and t not in terms]
        gone = {coefficient for term in off for coefficient in term.coefficients}
        return WatchOptions(
            sample_time,
            terms,
            kind,
            hold,  # type: ignore[arg-type] - WatchOptions checks it
            rate,
            self.memory,
            next(velocity for velocity in asked if velocity is not None),
            input_unit,
            from_deflection,
            made.shapes,
            {**{c: v for c, v in made.given.items() if c not in gone}, **self.known},
            self.known_deviations,
            made.reference,
            motor_turn,
        )

    def warnings(self, sample_time: float) -> tuple[str, ...]:
        """What a stream of such samples does not account for."""
        return () if self.estimate is None else self.estimate.warnings(sample_time)
