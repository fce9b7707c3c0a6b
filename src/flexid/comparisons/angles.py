"""Parameters that are angles: what lies between two is taken round the circle."""

from math import pi

ANGLES = frozenset({"gravity_angle", "eccentricity_angle", "ripple_angle"})
"""Parameters of which a difference is taken round the circle, and no percentage makes sense."""


def difference(name: str, a: float, b: float) -> float:
    """B's value minus A's, of an angle the shorter way round.

    Examples
    --------
    >>> round(difference("gravity_angle", 3.1, -3.1), 3)
    0.083
    >>> difference("gravity_torque", 3.0, -3.0)
    -6.0
    """
    value = b - a
    return (value + pi) % (2.0 * pi) - pi if name in ANGLES else value
