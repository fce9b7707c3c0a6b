"""Play of the joint, fitted with a shape as wide as the play itself.

What the term `backlash` finds is the gap of a joint that passes through it fast if its shape is as
wide as `WIDTH_OF_GAP` says; a wider one makes the gap larger. The fit begins with a width that
suits the motion, and from there the width follows the gap.
"""

from dataclasses import replace

from flexid.errors import ConvergenceError
from flexid.identification.full_model.beginning import FIRST_ITERATIONS
from flexid.identification.full_model.fitting import climb, fit_like, in_own_steps
from flexid.identification.full_model.model import Fitted
from flexid.models.flexible_joint import BACKLASH_WIDTH, WIDTH_OF_GAP

_GAPS = (("alpha_backlash", "alpha1"), ("theta_backlash", "theta2"))  # and the spring's stiffness
_MOST_FITS = 8
_SETTLED = 0.1  # relative change of the width, which moves the gap by some per mille


def as_wide_as_its_gap(fitted: Fitted) -> Fitted:
    """A fit whose play has the width that its own gap gives it; the same fit where that is worse.

    A sharper shape may want shorter steps, which the data of what is returned then have.

    Parameters
    ----------
    fitted : Fitted
        With or without play.
    """
    for _ in range(_MOST_FITS):
        own = WIDTH_OF_GAP * half_gap(fitted)
        before = fitted.structure.joint.extended.constants.get(BACKLASH_WIDTH, 0.0)
        if own <= 0.0 or abs(own / before - 1.0) < _SETTLED:
            return fitted
        # From a width that is far away half the way may lead on where the whole does not.
        fits = (_narrowed(fitted, width) for width in (own, (own * before) ** 0.5))
        better = next((found for found in fits if found is not None), None)
        if better is None:
            return fitted
        fitted = in_own_steps(better)
    return fitted


def _narrowed(fitted: Fitted, width: float) -> Fitted | None:
    """A fit with another width; None if its first steps do not lead below the sum of squares."""
    joint = fitted.structure.joint.with_widths({BACKLASH_WIDTH: width})
    structure, segments = replace(fitted.structure, joint=joint), [fitted.problem.segments]
    states = fitted.minimum.point.initial_states
    try:
        (first,) = climb(
            structure,
            fitted.data,
            fitted.by_name,
            segments,
            states,
            insist=False,
            iterations=FIRST_ITERATIONS,
        )
    except ConvergenceError:
        return None
    if _cost(first) >= _cost(fitted):
        return None
    found = fit_like(structure, first)
    return found if found is not None and _cost(found) < _cost(fitted) else None


def _cost(fitted: Fitted) -> float:
    return fitted.minimum.equations.cost


def half_gap(fitted: Fitted) -> float:
    """Half the gap in rad; zero without one."""
    values = {**fitted.structure.fixed, **fitted.by_name}
    for play, spring in _GAPS:
        if play in values and values.get(spring, 0.0) > 0.0:
            return values[play] / values[spring]
    return 0.0
