"""A delay of the link's encoder, where the motor's row says little of it or is not there.

A joint looks the same at any time: what a late encoder shows is the motion of a link whose motor
moved later. With a delay τ the link seems to obey, to first order in τ,

    x1'' = … - θ2 (x1 - x3) - θ2 τ x4,

and -θ2 τ x4 = θ2 τ (x2 - x4) - θ2 τ x2: a damping of the joint that is lower by θ2 τ beside a
friction of the link that is higher by as much. The motor's row would say which of the two it is;
the link alone cannot. What it can tell is their signs, since neither is ever negative:

- where both fit as they are, the delay is taken to be none, and the intervals span what the signs
  leave possible;
- where one comes out negative, the delay makes up for it, and that one is taken to be none;
- where the spring comes out negative, damping has taken the part of the delay altogether, and both
  are taken to be none beside it.

A motor whose friction no term describes says little more: there an encoder that is early by just
what makes its link's friction none is a damping of the joint.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.full_model.model import LINK
from flexid.identification.preparation.alignment import Alignment
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.intervals import interval

CONFUSED = DAMPING, FRICTION = "theta_damping", "theta_viscous"
"""What a delay passes for."""

_STIFFNESS = "theta2"

_LITTLE = 0.1  # of a friction, that is left of it beside a damping: a model's error leaves 0.001
_CHANCE = 0.5  # that there is a delay at all, before the log was seen


def doubtful(values: Mapping[str, float]) -> frozenset[str]:
    """Which of damping and friction came out as no drive has them.

    Neither is to be trusted where the spring itself came out negative.
    """
    if values.get(_STIFFNESS, np.inf) <= 0.0:
        return frozenset(CONFUSED)
    return frozenset(name for name in CONFUSED if values.get(name, 0.0) < 0.0)


def possible(values: Mapping[str, float]) -> tuple[float, float]:
    """Ends in s of the further delay that the signs of damping and friction leave possible."""
    stiffness = values.get(_STIFFNESS, 0.0)
    if stiffness <= 0.0:
        return 0.0, 0.0
    damping, friction = (max(values.get(name, 0.0), 0.0) for name in CONFUSED)
    return -damping / stiffness, friction / stiffness


def is_damping(values: Mapping[str, float]) -> bool:
    """Whether an early encoder and a friction of its link are but one damping of the joint."""
    delay, friction = values.get(LINK, 0.0), values.get(FRICTION, 0.0)
    left = friction + values.get(_STIFFNESS, 0.0) * delay
    return delay < 0.0 and abs(left) <= _LITTLE * friction


def confused_covariance(estimate: Estimate) -> FloatArray:
    """Covariance, shape (k, k), that a further delay adds: one is there as likely as not.

    If there is one, it may be any that the signs leave possible.
    """
    values = estimate.by_name
    lower, upper = possible(values)
    mean_square = _CHANCE * (lower**2 + lower * upper + upper**2) / 3.0
    slopes = {
        DAMPING: values.get(_STIFFNESS, 0.0),
        FRICTION: -values.get(_STIFFNESS, 0.0),
        LINK: 1.0,
    }
    direction = np.array([slopes.get(name, 0.0) for name in estimate.names])
    return mean_square * np.outer(direction, direction)


def in_doubt(alignment: Alignment, estimate: Estimate) -> Alignment:
    """An alignment whose link delay is what the signs of damping and friction leave possible."""
    delay = alignment.link_delay
    if LINK in estimate.names:
        place = estimate.names.index(LINK)
        std = float(estimate.deviations[place])
        ends = interval(delay.value, std, estimate.degrees_of_freedom[place])
        return replace(alignment, link_delay=replace(delay, std=std, interval=ends))
    return replace(alignment, link_delay=replace(delay, interval=possible(estimate.by_name)))
