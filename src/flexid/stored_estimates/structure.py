"""Structure and values of an estimate, ready to be simulated with another log."""

from collections.abc import Mapping
from math import isclose

import numpy as np

from flexid.errors import SettingError
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.full_model.model import LINK, Structure
from flexid.identification.preparation.joint import Joint, joint_of
from flexid.identification.result import Choices, Identification
from flexid.models.flexible_joint import WIDTHS

_SAME = 1e-6  # relative tolerance for a tied coefficient against the value computed from others


def values_of(result: Identification, group: int | None = None) -> dict[str, float]:
    """Return the coefficients' values, with offsets of one log (from 0) or their mean over logs."""
    found: dict[str, list[float]] = {}
    for name, coefficient in result.coefficients.items():
        bare, label, _ = name.partition("[")
        if not label or group is None or name == f"{bare}[{group + 1}]":
            found.setdefault(bare, []).append(coefficient.value)
    return {name: float(np.mean(each)) for name, each in found.items()}


def delays_of(result: Identification) -> dict[str, float]:
    """Return the delays of the input and the link's encoder, in s, by name."""
    alignment = result.choices.alignment
    return {INPUT: alignment.input_delay.value, LINK: alignment.link_delay.value}


def structure_of(
    result: Identification, values: Mapping[str, float], *, smooth: bool = True
) -> Structure:
    """Return the structure that has the given coefficients; raise a `SettingError` if none has."""
    joint = joint_of(result.model, result.joint)
    unknown = [name for name in values if name not in joint.units]
    if unknown:
        raise SettingError(unknown[0], f"is no coefficient of the {result.model} joint")
    joint = _with_constants(joint, values, result.choices, smooth=smooth)
    needed = [c for c in joint.units if c not in joint.optional and c not in values]
    if needed:
        raise SettingError(needed[0], "is missing: every joint of this kind has that coefficient")
    absent = joint.never | {c for c in joint.optional if c not in values}
    delays = {name: d for name, d in delays_of(result).items() if d}
    if result.model == "rigid":
        delays.pop(LINK, None)
    timing = Timing(result.choices.hold, delays)
    return Structure(joint, absent, timing, _untied(joint, values, absent))


def _with_constants(
    joint: Joint, values: Mapping[str, float], choices: Choices, *, smooth: bool
) -> Joint:
    joint = joint.with_widths(choices.shapes)
    used = joint.shapes & {*values}
    if smooth and choices.coulomb_velocity is not None:
        if used:
            raise SettingError(
                sorted(used)[0], "needs dry friction, and coulomb_velocity smooths it: drop one"
            )
        return joint.with_coulomb_velocity(choices.coulomb_velocity)
    missing = sorted(joint.constants_of(used).keys() & {*WIDTHS} - choices.shapes.keys())
    if missing:
        raise SettingError(missing[0], "is missing, and its term needs it: identify again")
    return joint


def _untied(joint: Joint, values: Mapping[str, float], absent: frozenset[str]) -> dict[str, float]:
    """Return tied coefficients whose value differs from the one that their tie gives."""
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
