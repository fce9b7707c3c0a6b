"""Arguments of `flexid.watch`, and of what is fed to it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import ArgumentError
from flexid.library.arguments import as_known, as_names, as_number, kind_of
from flexid.recording.channel import INPUTS, SI_UNITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexid.arrays import FloatArray
    from flexid.identification.result.identification import Identification
    from flexid.streaming.channels import StreamChannels

_CHANNELS = {
    "flexible": "link_position or deflection, motor_position and an input",
    "link": "link_position or deflection, motor_position and no input",
    "rigid": "motor_position and an input, and no link",
}


def as_chosen(
    *, terms: Any, hold: Any, model: Any, known: Any, memory: Any, **numbers: Any
) -> dict[str, Any]:
    """What the arguments of `flexid.watch` choose, by the fields of its options."""
    values, deviations = as_known("watch", known)
    given = {
        name: None if value is None else as_number("watch", name, value)
        for name, value in numbers.items()
    }
    return {
        "terms": _terms(terms),
        "hold": hold,
        "kind": model,
        "known": values,
        "known_deviations": deviations,
        "memory": as_number("watch", "memory", memory),
        **given,
    }


def fed_channels(names: "Sequence[str]", kind: str) -> "StreamChannels":
    """What a session is fed, by the names of its channels; the kind is asked for, or "auto"."""
    from flexid.streaming.channels import StreamChannels

    inputs = [name for name in INPUTS if name in names]
    links = [name for name in ("link_position", "deflection") if name in names]
    if len(inputs) > 1 or len(links) > 1 or not inputs + links:
        raise ArgumentError(
            "feed",
            "channels",
            f"are {', '.join(names)}: give one of {', '.join(INPUTS)}, and of link_position and "
            f"deflection one at most; without an input, one of these",
        )
    found = ("flexible" if inputs else "link") if links else "rigid"
    if kind not in ("auto", found):
        raise ArgumentError(
            "feed",
            "channels",
            f"are {', '.join(names)}: for the {kind} joint give {_CHANNELS[kind]}",
        )
    unit = SI_UNITS[inputs[0]][0] if inputs else ""
    return StreamChannels(found, unit, links == ["deflection"], ())


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
    return as_names("watch", terms)


def as_comparable(estimate: Any) -> "Identification | None":
    """What a stream is held against, if there is something."""
    if estimate is None:
        return None
    from flexid.library.identify import estimated
    from flexid.streaming.departures import check_comparable

    found = estimated("watch", "estimate", estimate).of_joint
    check_comparable(found)
    return found
