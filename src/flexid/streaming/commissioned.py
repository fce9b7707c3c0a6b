"""An estimate made before, as what a stream is held against.

Its model is that of the stream: terms, what was given, hold and filter. Its values are not: what
is learnt is learnt from the stream alone, because a drive that has changed since would be drawn to
what it was. Whether it has is a comparison of the two.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import TYPE_CHECKING, Literal

from flexid.errors import SettingError
from flexid.models.flexible_joint import SHAPE_TERMS, SQUARES
from flexid.models.parameter_kinds import ANGLES, difference

if TYPE_CHECKING:
    from flexid.identification.result.identification import Identification
    from flexid.identification.vocabulary.evidence import ParameterEstimate

FILTER_RATE = 20.0  # rate of the filter in 1/s, where the samples come often enough for it
LATE = 0.1  # part of a sample time by which a channel may be late before it is worth a word
_OF_THE_MOTOR = {"viscous": "motor_viscous", "coulomb": "motor_coulomb", "offset": "motor_offset"}


@dataclass(frozen=True)
class Commissioned:
    """What a stream takes from an estimate, and what it is compared with."""

    kind: Literal["flexible", "link", "rigid"]  # which joint
    terms: tuple[str, ...]  # of the joint
    hold: Literal["auto", "linear", "zero"]  # the input between samples
    filter_rate: float = FILTER_RATE  # in 1/s
    given: Mapping[str, float] = field(default_factory=dict)  # coefficients that were not estimated
    shapes: Mapping[str, float] = field(default_factory=dict)  # constants of shapes, by name
    coulomb_velocity: float | None = None  # in rad/s; None where friction was dry
    # value of each physical parameter that is determined, and half of its 95 % interval
    reference: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    input_unit: str = ""  # of the input; empty where there is none
    # channels that were found late, and by how many seconds
    late: Mapping[str, float] = field(default_factory=dict)
    corrected: bool = False  # whether the logged voltage was corrected for its amplifier

    def warnings(self, sample_time: float) -> tuple[str, ...]:
        """What a stream of such samples does not account for."""
        late = tuple(
            f"the estimate found the {name} late by {1e3 * delay:.3g} ms, and a stream is taken as "
            f"it comes: send it in time, or inertias, friction and damping seem to have changed"
            for name, delay in self.late.items()
            if abs(delay) > LATE * sample_time
        )
        if not self.corrected:
            return late
        return (
            *late,
            "the estimate corrected the voltage for its amplifier, and a stream is taken as it "
            "comes: send the voltage at the motor, or gain and friction seem to have changed",
        )


def commissioned(result: "Identification") -> Commissioned:
    """What a stream that is held against an identification takes from it."""
    terms = result.choices.terms
    remembering = [term for term in terms if (s := SHAPE_TERMS.get(term)) and s.memory]
    if remembering:
        left = ",".join(term for term in terms if term not in remembering)
        raise SettingError(
            "estimate",
            f"has {remembering[0]}, which remembers the path of the spring, and least squares "
            f"remembers nothing: identify with --terms {left or 'none'}, and take that estimate",
        )
    taken = taken_from(result)
    if not taken.reference:
        raise SettingError("estimate", "determines nothing that a stream could be compared with")
    unknown = [name for name, value in taken.given.items() if not isfinite(value)]
    if unknown:
        raise SettingError(
            "estimate", f"has no value of {unknown[0]}, which is not sought: identify once more"
        )
    return taken


def taken_from(result: "Identification") -> Commissioned:
    """Model, settings and values of an identification."""
    from flexid.stored_estimates.rebuilt import given_coefficients, input_unit_of

    choices = result.choices
    names = given_coefficients(result) | SQUARES
    return Commissioned(
        kind=result.model,
        terms=stream_terms(choices.terms, result.model),
        hold="zero" if choices.hold == "zero" else "linear",
        filter_rate=choices.filter_rate if isfinite(choices.filter_rate) else FILTER_RATE,
        given={name: c.value for name, c in result.coefficients.items() if name in names},
        shapes={**choices.shapes},
        coulomb_velocity=choices.coulomb_velocity,
        reference={
            name: (found.value, 0.5 * (found.interval[1] - found.interval[0]))
            for name, found in result.parameters.items()
            if found.verdict == "determined" and _is_known(found)
        },
        input_unit=input_unit_of(result),
        late={
            "input": choices.alignment.input_delay.value,
            "link's encoder": choices.alignment.link_delay.value,
        },
        corrected=choices.amplifier.corrects,
    )


def stream_terms(terms: Sequence[str], kind: str) -> tuple[str, ...]:
    """Terms by the names of the flexible joint, as a stream has them."""
    return tuple(_OF_THE_MOTOR.get(term, term) if kind == "rigid" else term for term in terms)


def _is_known(found: "ParameterEstimate") -> bool:
    if "[" in found.name or not all(map(isfinite, (found.value, found.std, *found.interval))):
        return False
    return found.value != 0.0 or found.name in ANGLES


@dataclass(frozen=True)
class Departure:
    """A physical parameter that differs from what it was."""

    name: str  # of the parameter
    unit: str  # of the parameter
    was: float  # in the estimate, and by the stream
    now: float  # in the estimate, and by the stream
    excess: float  # their difference, over the least that counts as one

    @property
    def change(self) -> float:
        """Relative; NaN of an angle, which has none."""
        return nan if self.name in ANGLES else self.now / self.was - 1.0

    @property
    def sentence(self) -> str:
        """By how much, for a report."""
        unit = f" {self.unit}" if self.unit else ""
        values = f"{self.now:.4g}{unit} where it was {self.was:.4g}"
        if self.name in ANGLES:
            turned = abs(difference(self.name, self.was, self.now))
            return f"{self.name} is {turned:.2g}{unit} from that of the estimate, {values}"
        if self.now * self.was < 0.0:
            return f"{self.name} has the other sign: {values}"
        amount = f"{abs(self.change):.2g}" if abs(self.change) > 9.995 else ""
        share = f"{amount} times" if amount else f"{abs(self.change):.0%}"
        way = "higher" if abs(self.now) > abs(self.was) else "lower"
        return f"{self.name} is {share} {way} than in the estimate, {values}"


def departures(
    reference: Mapping[str, tuple[float, float]],
    parameters: Mapping[str, "ParameterEstimate"],
    *,
    widths: float,
    least: float,
) -> tuple[Departure, ...]:
    """Parameters that differ from an estimate, the clearest first."""
    found = []
    for name, (was, half_was) in reference.items():
        now = parameters.get(name)
        if now is None or not isfinite(now.std):
            continue
        half = 0.5 * (now.interval[1] - now.interval[0])
        whole = 1.0 if name in ANGLES else abs(was)
        allowed = max(widths * (half**2 + half_was**2) ** 0.5, least * whole)
        excess = abs(difference(name, was, now.value)) / allowed if allowed > 0.0 else 0.0
        if excess > 1.0:
            found.append(Departure(name, now.unit, was, now.value, excess))
    return tuple(sorted(found, key=lambda departure: -departure.excess))
