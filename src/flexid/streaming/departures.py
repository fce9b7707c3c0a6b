"""A stream that is held against an identification: what it takes from that, and what departs.

The model is that of the identification: terms, what was given, hold and filter. Its values are not
used: the estimates follow from the stream alone, since a drive that has changed since would be
drawn to what it was. Whether it has is a comparison of the two.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from flexid.errors import SettingError
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.evidence import ParameterEstimate
from flexid.models.flexible_joint import SHAPE_TERMS, SQUARES
from flexid.models.parameter_kinds import ANGLES, difference

LATE = 0.1  # part of a sample time by which a channel may be late before it is worth a word
_OF_THE_MOTOR = {"viscous": "motor_viscous", "coulomb": "motor_coulomb", "offset": "motor_offset"}


def check_comparable(result: Identification) -> None:
    """Refuse an identification that no stream can be held against."""
    terms = result.choices.terms
    remembering = [term for term in terms if (s := SHAPE_TERMS.get(term)) and s.memory]
    if remembering:
        left = ",".join(term for term in terms if term not in remembering)
        raise SettingError(
            "estimate",
            f"has {remembering[0]}, which remembers the path of the spring, and least squares "
            f"remembers nothing: identify with --terms {left or 'none'}, and take that estimate",
        )
    if not _reference(result):
        raise SettingError("estimate", "determines nothing that a stream could be compared with")
    unknown = [name for name, value in given_values(result).items() if not isfinite(value)]
    if unknown:
        raise SettingError(
            "estimate", f"has no value of {unknown[0]}, which is not sought: identify once more"
        )


def taken_from(result: Identification) -> dict[str, Any]:
    """Options of a stream, by the fields of `WatchOptions`, as an identification has them."""
    choices = result.choices
    hold = "zero" if choices.hold == "zero" else "linear"
    found: dict[str, Any] = {
        "terms": stream_terms(choices.terms, result.model),
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
    """Coefficients that a stream does not seek, with their values."""
    names = result.given | SQUARES
    return {name: c.value for name, c in result.coefficients.items() if name in names}


def not_accounted_for(result: Identification, sample_time: float) -> Iterator[str]:
    """What of an identification a stream of such samples does not account for."""
    alignment = result.choices.alignment
    late = {"input": alignment.input_delay.value, "link's encoder": alignment.link_delay.value}
    for name, delay in late.items():
        if abs(delay) > LATE * sample_time:
            yield (
                f"the estimate found the {name} late by {1e3 * delay:.3g} ms, and a stream is "
                f"taken as it comes: send it in time, or inertias, friction and damping seem to "
                f"have changed"
            )
    if result.choices.amplifier.corrects:
        yield (
            "the estimate corrected the voltage for its amplifier, and a stream is taken as it "
            "comes: send the voltage at the motor, or gain and friction seem to have changed"
        )


def stream_terms(terms: Sequence[str], kind: str) -> tuple[str, ...]:
    """Terms by the names of the flexible joint, as a stream has them."""
    return tuple(_OF_THE_MOTOR.get(term, term) if kind == "rigid" else term for term in terms)


def _reference(result: Identification) -> dict[str, tuple[float, float]]:
    """Value of each physical parameter that is determined, and half of its 95 % interval."""
    return {
        name: (found.value, found.half_width)
        for name, found in result.parameters.items()
        if found.verdict == "determined" and _is_known(found)
    }


def _is_known(found: ParameterEstimate) -> bool:
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
    parameters: Mapping[str, ParameterEstimate],
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
        whole = 1.0 if name in ANGLES else abs(was)
        allowed = max(widths * (now.half_width**2 + half_was**2) ** 0.5, least * whole)
        excess = abs(difference(name, was, now.value)) / allowed if allowed > 0.0 else 0.0
        if excess > 1.0:
            found.append(Departure(name, now.unit, was, now.value, excess))
    return tuple(sorted(found, key=lambda departure: -departure.excess))
