"""One row of a joint alone, driven by the measured motion of the other side.

The spring couples the two rows. Where the other side's position and velocity are measured, they
are inputs like any other, and one row needs nothing of the other row's friction, inertia or input:

    x1' = x2
    x2' = -theta1 sin x1 - theta2 (x1 - x3)

is the link of Huang (2003), eq. (4), with the motor's position x3 as its input.
"""

import re

from flexid.models.parametric_system import ParametricSystem


def row_alone(system: ParametricSystem, name: str) -> ParametricSystem:
    """One row of a system, with the states of the other rows as inputs.

    >>> from flexid.models.flexible_joint import flexible_joint
    >>> row_alone(flexible_joint(), "link").inputs
    ('x3', 'x4')
    >>> row_alone(flexible_joint(), "motor").inputs
    ('x1', 'x2', 'u')
    """
    row = next(row for row in system.rows if row.name == name)
    others = [state for state in system.states if state not in (row.coordinate, row.velocity)]
    used = {*re.findall(r"[^\W\d]\w*", " ".join([*row.regressors.values(), row.known]))}
    return ParametricSystem(
        f"{system.name}, {name} alone",
        (row,),
        (*others, *(u for u in system.inputs if u in used)),
        {c: value for c, value in system.constants.items() if c in used},
    )
