"""Where two estimates come from: whether they share logs, and what was done otherwise."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

from flexid.arms.result import ArmIdentification
from flexid.comparisons.shape_widths import used_widths
from flexid.identification.result.identification import Identification
from flexid.models.flexible_joint import CONSTANT_UNITS

Either = Identification | ArmIdentification

Sharing = Literal["different", "some shared", "same"]
"""Whether two estimates were made from the same logs."""


_POSITIONS = ("motor_position", "link_position", "deflection")


class _Log(NamedTuple):
    """A file, and the columns of its positions: it may hold several axes."""

    sha256: str
    columns: frozenset[str]

    def is_of(self, other: "_Log") -> bool:
        """Whether both hold one axis' noise; where columns are not named, one file is one axis."""
        apart = self.columns and other.columns and not self.columns & other.columns
        return self.sha256 == other.sha256 and not apart


def shared_logs(a: Mapping[str, Any], b: Mapping[str, Any]) -> Sharing:
    """Whether the provenances of two estimates name the same axes of the same files."""
    first, second = _named_logs(a), _named_logs(b)
    in_both = [
        any(log.is_of(other) for other in others)
        for logs, others in ((first, second), (second, first))
        for log in logs
    ]
    if not any(in_both):
        return "different"
    return "same" if all(in_both) else "some shared"


def apart(a: Either, b: Either) -> dict[str, tuple[str, str]]:
    """What was asked for, chosen or used otherwise: in A and in B, by name."""
    first, second = _facts(a), _facts(b)
    names = dict.fromkeys([*first, *second])
    pairs = {name: (first.get(name, "none"), second.get(name, "none")) for name in names}
    found = {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
    own = (_beside(a, b), _beside(b, a))
    return found | ({"terms only here": own} if own[0] != own[1] else {})


def _beside(one: Either, other: Either) -> str:
    """Terms that one model has and the other has not."""
    if one.model == "arm" or other.model == "arm":
        return ""
    return _text([term for term in one.choices.terms if term not in other.choices.terms])


def doubts(a: Either, b: Either, logs: Sharing) -> Iterator[str]:
    """What limits a comparison, a sentence each."""
    if a.model != b.model:
        yield (
            f"A is of {_joint(a)} and B of {_joint(b)}: only what has the same name, meaning and "
            f"unit in both is compared"
        )
    if logs == "some shared":
        yield (
            "some logs are in both estimates, which therefore err alike: the intervals allow for "
            "the worst of that, and a change may be missed"
        )
    unnamed = [side for side, e in (("A", a), ("B", b)) if not _named_logs(e.provenance)]
    if unnamed:
        yield (
            f"{' and '.join(unnamed)} does not say which logs it was made from: they are taken for "
            f"different ones"
        )
    common = [name for name in _known(a) if name in _known(b)]
    if common:
        yield (
            f"both rest on what was said of {' and '.join(common)}: if that has changed, other "
            f"values seem to have changed in its stead"
        )
    unexplained = [side for side, e in (("A", a), ("B", b)) if _is_unexplained(e)]
    if unexplained and logs != "same":
        yield (
            f"in {' and '.join(unexplained)} the residuals hold something that no term describes. "
            f"It may look like a change where the motions differ: compare logs of the same motion"
        )
    for side, estimate in (("A", a), ("B", b)):
        yield from (f"{side}: {warning}" for warning in estimate.warnings)


def _is_unexplained(estimate: Either) -> bool:
    if estimate.model == "arm":
        return estimate.disturbances is not None
    return estimate.model_error.share > 0.0


def _joint(estimate: Either) -> str:
    return {
        "flexible": "a flexible joint",
        "link": "a link alone",
        "rigid": "a rigid joint",
        "arm": "an arm",
    }[estimate.model]


def _facts(estimate: Either) -> dict[str, str]:
    """Everything that an estimate was made with, as text."""
    if estimate.model == "arm":
        return _facts_of_arm(estimate)
    provenance = estimate.provenance
    facts = _common_facts(estimate)
    asked = provenance.get("settings", {})
    facts |= {f"{name} (asked)": _text(value) for name, value in asked.items() if name != "model"}
    choices, alignment = estimate.choices, estimate.choices.alignment
    facts |= {
        "hold": choices.hold,
        "input delay": f"{1e3 * alignment.input_delay.value:.3g} ms",
        "link encoder delay": f"{1e3 * alignment.link_delay.value:.3g} ms",
        "estimator": choices.estimator,
    }
    if choices.estimator == "least-squares":
        facts["filter rate"] = f"{choices.filter_rate:.4g} 1/s"
    if choices.coulomb_velocity is not None:
        facts["coulomb velocity"] = f"{choices.coulomb_velocity:.4g} rad/s"
    if choices.amplifier.dead_zone:
        facts["amplifier's dead zone"] = f"{choices.amplifier.dead_zone:.4g} V"
    if choices.amplifier.limit is not None:
        facts["amplifier's limit"] = f"{choices.amplifier.limit:.4g} V"
    for name, width in used_widths(estimate).items():
        facts[name.replace("_", " ")] = f"{width:.4g} {CONSTANT_UNITS[name]}".removesuffix(" 1")
    return facts | _columns(provenance)


def _common_facts(estimate: Either) -> dict[str, str]:
    provenance = estimate.provenance
    return {
        "logs": _text([log.get("file") for log in provenance.get("inputs", ())]),
        "model": estimate.model,
        "flexid": _text(provenance.get("flexid_version")),
    }


def _facts_of_arm(estimate: ArmIdentification) -> dict[str, str]:
    return _common_facts(estimate) | {
        "lengths": f"{_text(estimate.arm.lengths)} m",
        "gravity": f"{_text(estimate.arm.gravity)} m/s^2",
        "hold": estimate.hold,
        "input delay": f"{1e3 * estimate.input_delay:.3g} ms",
        "disturbances": "none" if estimate.disturbances is None else "fitted",
    }


def _columns(provenance: Mapping[str, Any]) -> dict[str, str]:
    """How each channel was computed from the columns of the first log."""
    first = next(iter(provenance.get("inputs", ())), {})
    found = {}
    for channel, origin in first.get("columns", {}).items():
        numbers = {key: origin.get(key) for key in ("columns", "factor", "offset", "gear_ratio")}
        found[f"column of {channel}"] = _text({k: v for k, v in numbers.items() if v is not None})
    return found


def _named_logs(provenance: Mapping[str, Any]) -> set[_Log]:
    return {
        _Log(str(log["sha256"]), frozenset(_position_columns(log)))
        for log in provenance.get("inputs", ())
        if log.get("sha256")
    }


def _position_columns(log: Mapping[str, Any]) -> Iterator[str]:
    for channel, origin in log.get("columns", {}).items():
        if channel in _POSITIONS:
            yield from origin["columns"]


def _known(estimate: Either) -> Mapping[str, Any]:
    return estimate.provenance.get("settings", {}).get("known", {})


def _text(value: Any) -> str:
    """A setting in words: the same for what was read from a file and what was not."""
    if isinstance(value, Mapping):
        text = ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    elif isinstance(value, list | tuple):
        text = ", ".join(map(_text, value))
    elif isinstance(value, float):
        text = f"{value:g}"
    else:
        text = "" if value is None else str(value)
    return text or "none"
