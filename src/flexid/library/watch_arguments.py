"""Arguments of `flexid.watch`, and of what is fed to it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import ArgumentError
from flexid.library.checks import as_path, kind_of
from flexid.library.options import as_known, as_number, as_terms
from flexid.recording.channel import INPUTS, SI_UNITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexid.arrays import FloatArray
    from flexid.streaming.choices import Choices
    from flexid.streaming.commissioned import Commissioned
    from flexid.streaming.options import WatchOptions

_CHANNELS = {
    "flexible": "link_position or deflection, motor_position and an input",
    "link": "link_position or deflection, motor_position and no input",
    "rigid": "motor_position and an input, and no link",
}


def as_choices(
    *, terms: Any, hold: Any, model: Any, known: Any, estimate: Any, memory: Any, **numbers: Any
) -> "Choices":
    """What the arguments of `flexid.watch` choose; other numbers are None where they follow."""
    from flexid.streaming.choices import Choices

    values, deviations = as_known("watch", known)
    given = {
        name: None if value is None else as_number("watch", name, value)
        for name, value in numbers.items()
    }
    return Choices(
        terms=_terms(terms),
        hold=hold,
        memory=as_number("watch", "memory", memory),
        model=model,
        known=values,
        known_deviations=deviations,
        estimate=_commissioned(estimate),
        **given,
    )


def fed_options(choices: "Choices", names: "Sequence[str]") -> "WatchOptions":
    """Options of a session that is fed the channels of these names."""
    inputs = [name for name in INPUTS if name in names]
    links = [name for name in ("link_position", "deflection") if name in names]
    if len(inputs) > 1 or len(links) > 1 or not inputs + links:
        raise ArgumentError(
            "feed",
            "channels",
            f"are {', '.join(names)}: give one of {', '.join(INPUTS)}, and of link_position and "
            f"deflection one at most; without an input, one of these",
        )
    kind = ("flexible" if inputs else "link") if links else "rigid"
    if choices.wanted_model not in ("auto", kind):
        raise ArgumentError(
            "feed",
            "channels",
            f"are {', '.join(names)}: for the {choices.wanted_model} joint give "
            f"{_CHANNELS[choices.wanted_model]}",
        )
    unit = SI_UNITS[inputs[0]][0] if inputs else ""
    assert choices.sample_time is not None
    return choices.options(kind, unit, choices.sample_time, from_deflection=links == ["deflection"])


def as_samples(name: str, values: Any) -> "FloatArray":
    """Numbers of a channel, shape (n,); an `ArgumentError` for what is none."""
    try:
        found = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError):
        raise ArgumentError("feed", name, f"is {kind_of(values)}: give numbers") from None
    if found.ndim != 1:
        raise ArgumentError("feed", name, f"has {found.ndim} dimensions: give one number a sample")
    return found


def _terms(terms: Any) -> tuple[str, ...] | None:
    if isinstance(terms, str) and terms == "usual":
        return None
    names = as_terms("watch", terms)
    return (names,) if isinstance(names, str) else names


def _commissioned(estimate: Any) -> "Commissioned | None":
    from flexid.library.joint_estimate import JointEstimate
    from flexid.streaming.commissioned import commissioned, read_commissioned

    if estimate is None:
        return None
    if isinstance(estimate, JointEstimate):
        return commissioned(estimate.result)
    if isinstance(estimate, Mapping):
        return read_commissioned(estimate)
    return read_commissioned(as_path("watch", "estimate", estimate))
