"""Where the fit of a log begins: least squares of it, in several ways, and the best of these.

Least squares takes each row as its acceleration's explanation. On a stiff drive with dry friction
that misleads: while a side sticks, friction balances whatever acts, and nothing of it is an
acceleration, so that all coefficients come out too small by one factor. The same row, solved for
its input, does not mind: no inertia is learnt where nothing accelerates. Which of them is better
shows in the residuals over the shortest segments.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.estimators.segments import Segments
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.full_model.fitting import motion_at
from flexid.identification.full_model.model import Data, Structure
from flexid.models.flexible_joint import DISSIPATIVE

_RATES = (20.0, 60.0, 7.0)  # 1/s, of the filters
_INPUT = "beta1"
_SPRINGS = ("theta2", "alpha1", _INPUT)
_CURVATURES = ("alpha_cubic", "theta_cubic")
_DAMPINGS = ("alpha_damping", "theta_damping")


def starts(structure: Structure, data: Data, segments: Segments) -> list[dict[str, float]]:
    """Values that a fit may begin with, the most promising first.

    Parameters
    ----------
    structure : Structure
        What is to be fitted.
    data : Data
        To what, with velocities.
    segments : Segments
        Short ones, over which the residuals of each start are compared.
    """
    found: list[tuple[float, int, dict[str, float]]] = []
    for rate in _RATES:
        start, fit = least_squares_start(structure, data, rate)
        ways = [start]
        if any(_INPUT in row.coefficients for row in fit.rows):
            values = {**_values(fit), **_solved_for_input(fit)}
            ways.append({**structure.timing.delays, **_passive(values)})
        for way in ways:
            problem, point = motion_at(structure, data, segments, way, None)
            found.append((problem.equations(point).cost, len(found), way))
    return [way for *_, way in sorted(found, key=lambda each: each[:2])]


def _values(fit: LeastSquaresFit) -> dict[str, float]:
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def _solved_for_input(fit: LeastSquaresFit) -> dict[str, float]:
    """Least squares of the row with an input, with the input as what is to be explained."""
    (row,) = (row for row in fit.rows if _INPUT in row.coefficients)
    place = row.coefficients.index(_INPUT)
    others = np.delete(row.regressors, place, axis=0)
    regressors = np.vstack((row.left_hand_side, -others))
    gram = regressors @ regressors.T
    scale = np.sqrt(np.diag(gram))
    inverse, _ = scaled_inverse(gram, scale)
    inertia, *rest = (inverse @ (regressors @ row.regressors[place])).tolist()
    names = (name for name in row.coefficients if name != _INPUT)
    if inertia == 0.0:
        return {}
    values = {name: value / inertia for name, value in zip(names, rest, strict=True)}
    return {_INPUT: 1.0 / inertia, **values}


def least_squares_start(
    structure: Structure, data: Data, filter_rate: float
) -> tuple[dict[str, float], LeastSquaresFit]:
    """Least squares of the data with smoothed friction, delays ignored: where a fit begins.

    Parameters
    ----------
    structure : Structure
        Terms that are on, and what is given.
    data : Data
        With velocities.
    filter_rate : float
        In 1/s.
    """
    unknowns = smooth_unknowns(structure, data.groups)
    hold = "zero" if structure.timing.hold == "zero" else "linear"
    fit = filtered_least_squares(data.samples, unknowns.system, filter_rate, hold, unknowns)
    return {**structure.timing.delays, **_passive(_values(fit))}, fit


def _passive(values: Mapping[str, float]) -> dict[str, float]:
    """Values of a joint that no motion can run away from: where a fit may begin.

    Least squares of channels that do not match in time has frictions that feed energy in, and
    springs that push.
    """
    found = {}
    for name, value in values.items():
        base = name.partition("[")[0]
        if base in _DAMPINGS:
            found[name] = 0.0
        elif base in DISSIPATIVE:
            found[name] = max(value, 0.0)
        elif base in _SPRINGS:
            found[name] = abs(value)
        else:
            found[name] = 0.0 if base in _CURVATURES else value
    return found


def smooth_unknowns(structure: Structure, groups: Sequence[int]) -> Unknowns:
    """What least squares seeks of a structure: friction smoothed, and each coefficient for itself.

    Parameters
    ----------
    structure : Structure
        Terms that are on, and what is given.
    groups : sequence of int
        The log of each recording.
    """
    joint = structure.joint
    smooth = joint.smooth
    absent = structure.absent
    given = {c: v for c, v in structure.fixed.items() if c in smooth.coefficients}
    off = {c: 0.0 for c in smooth.coefficients if c in absent}
    # Where the source of a tie is off, so is what follows from it.
    off |= {
        c: 0.0
        for c, (source, _, _) in joint.ties.items()
        if c in smooth.coefficients and source in absent
    }
    sought = structure.unknowns(groups)
    return Unknowns(smooth, {**off, **given}, sought.per_group, tuple(groups))
