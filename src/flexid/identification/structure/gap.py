"""Play of the joint, fitted with a shape as wide as the play itself.

What the term `backlash` finds is the gap of a joint that passes through it fast if its shape is as
wide as `WIDTH_OF_GAP` says; a wider one makes the gap larger. The fit begins with a width that
suits the motion, and from there the width follows the gap.
"""

from dataclasses import replace

from flexid.identification.full_model.fitting import fit_like
from flexid.identification.full_model.model import Fitted
from flexid.models.flexible_joint import BACKLASH_WIDTH, WIDTH_OF_GAP

_GAPS = (("alpha_backlash", "alpha1"), ("theta_backlash", "theta2"))  # and the spring's stiffness
_MOST_FITS = 4
_SETTLED = 0.1  # relative change of the width, which moves the gap by some per mille


def as_wide_as_its_gap(fitted: Fitted) -> Fitted:
    """A fit whose play has the width that its own gap gives it; the same fit where that is worse.

    Parameters
    ----------
    fitted : Fitted
        With or without play.
    """
    for _ in range(_MOST_FITS):
        joint, gap = fitted.structure.joint, half_gap(fitted)
        if gap <= 0.0:
            return fitted
        width = WIDTH_OF_GAP * gap
        if abs(width / joint.extended.constants[BACKLASH_WIDTH] - 1.0) < _SETTLED:
            return fitted
        structure = replace(fitted.structure, joint=joint.with_widths({BACKLASH_WIDTH: width}))
        other = fit_like(structure, fitted)
        if other is None or other.minimum.equations.cost >= fitted.minimum.equations.cost:
            return fitted
        fitted = other
    return fitted


def half_gap(fitted: Fitted) -> float:
    """Half the gap in rad; zero without one."""
    values = fitted.by_name
    for play, spring in _GAPS:
        if play in values and spring in values and values[spring] > 0.0:
            return values[play] / values[spring]
    return 0.0
