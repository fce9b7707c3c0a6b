"""Where the fit of a log begins: least squares of it, in several ways, and the best of these.

Least squares takes each row as its acceleration's explanation. On a drive with dry friction that
misleads: while a side sticks, friction balances whatever acts, and nothing of it is an
acceleration, so that all coefficients come out too small by one factor. While it keeps moving in
one direction its friction is a constant, and the row is exact. Which samples and which filter are
better shows in the residuals over the shortest segments.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.rowwise import LeastSquaresFit
from flexid.estimators.segments import Segments, first_states
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.full_model.fitting import motion_at
from flexid.identification.full_model.model import Data, Structure, data_of
from flexid.models.flexible_joint import DISSIPATIVE, HARDENING, SQUARES
from flexid.recording.recording import Recording

RATES = (20.0, 60.0, 7.0, 200.0)
"""Of the filters of least squares, in 1/s."""

_SPRINGS = ("theta2", "alpha1", "beta1")
_FRICTIONS = ("theta_coulomb", "alpha_coulomb", "gamma_coulomb")
_DIRECTED = 0.99  # of a filtered direction, from which on a side has kept moving
_FEWEST_EACH = 10  # samples for each coefficient
_DAMPINGS = ("alpha_damping", "theta_damping")
_COMPARED = 50  # segments over which starts are compared


def starts(structure: Structure, data: Data, segments: Segments) -> list[dict[str, float]]:
    """Values that a fit may begin with, the most promising first."""
    found: list[tuple[float, int, dict[str, float]]] = []
    some = segments.some(_COMPARED)
    states = first_states(some)
    # Which samples a friction is known at shows where it is sought, be it given or not.
    given = {name: value for name, value in structure.fixed.items() if name not in _FRICTIONS}
    sought = replace(structure, fixed=given)
    for rate in RATES:
        start, fit = least_squares_start(sought, data, rate)
        ways = [start]
        if moving := _while_moving(fit):
            ways.append(_begun(sought, {**fit.by_name, **moving}))
        for way in ways:
            found.append((_misfit(structure, data, some, way, states), len(found), way))
    return [way for *_, way in sorted(found, key=lambda each: each[:2])]


def _misfit(
    structure: Structure,
    data: Data,
    segments: Segments,
    way: Mapping[str, float],
    states: FloatArray,
) -> float:
    """Mean logarithm of what a start leaves in the segments, once each begins where that suits it.

    A start may be nearly right and still go astray where a side sticks or is jolted: a sum would
    heed nothing else.
    """
    problem, point = motion_at(structure, data, segments, way, states)
    equations = problem.equations(point, "states")
    if not np.isfinite(equations.cost):
        return np.inf
    left = equations.costs - problem.solve(equations).by_states
    return float(np.mean(np.log(np.maximum(left / segments.lengths, 1.0))))


def _while_moving(fit: LeastSquaresFit) -> dict[str, float]:
    """Least squares of each row over the samples at which its friction is known but for its size.

    There the filtered direction of its motion is one or minus one, so that it has not turned round
    or stuck for as long as the filter remembers. A row of which these are few, or all, is left out.
    """
    found: dict[str, float] = {}
    for row in fit.rows:
        frictions = [place for place, name in enumerate(row.coefficients) if name in _FRICTIONS]
        moving = np.all(np.abs(row.regressors[frictions]) >= _DIRECTED, axis=0)
        few = np.count_nonzero(moving) < _FEWEST_EACH * len(row.coefficients)
        if few or moving.all():
            continue
        found |= dict(zip(row.coefficients, row.over(moving).tolist(), strict=True))
    return found


def least_squares_start(
    structure: Structure, data: Data, filter_rate: float
) -> tuple[dict[str, float], LeastSquaresFit]:
    """Least squares of the data with smoothed friction, delays ignored: where a fit begins."""
    unknowns = smooth_unknowns(structure, data.groups)
    hold = "zero" if structure.timing.hold == "zero" else "linear"
    fit = filtered_least_squares(data.samples, unknowns.system, filter_rate, hold, unknowns)
    return _begun(structure, fit.by_name), fit


def _begun(structure: Structure, values: Mapping[str, float]) -> dict[str, float]:
    """Where a fit begins, from values by least squares; what is given stands beside them."""
    return {**structure.timing.delays, **_passive({**structure.fixed, **values})}


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
        elif base in DISSIPATIVE | HARDENING:
            found[name] = max(value, 0.0)
        elif base in _SPRINGS:
            found[name] = abs(value)
        else:
            found[name] = value
    if {*HARDENING, "theta2", "alpha1"} <= found.keys() and values["theta2"] > 0.0:
        # One spring acts on both rows, and the link's, of positions alone, knows its shape best.
        found["alpha_cubic"] = found["theta_cubic"] * found["alpha1"] / found["theta2"]
    return found


def smooth_unknowns(structure: Structure, groups: Sequence[int]) -> Unknowns:
    """What least squares seeks of a structure: friction smoothed, no coefficients tied."""
    joint = structure.joint
    smooth = joint.smooth
    absent = structure.absent
    given = {c: v for c, v in structure.fixed.items() if c in smooth.coefficients}
    off = {c: 0.0 for c in smooth.coefficients if c in absent | SQUARES}
    # Where the source of a tie is off, so is what follows from it.
    off |= {
        c: 0.0
        for c, (source, _, _) in joint.ties.items()
        if c in smooth.coefficients and source in absent
    }
    sought = structure.unknowns(groups)
    return Unknowns(smooth, {**off, **given}, sought.per_group, tuple(groups))


_FILTER_RATE = 20.0  # 1/s


def turned_round(
    structure: Structure, recordings: Sequence[Recording], groups: Sequence[int], share: float
) -> bool:
    """Whether a measured deflection explains the link's motion if its sign is changed, only then.

    The link's row alone decides: the motor's fits either way, with a stiffness of either sign.
    """
    if not recordings[0].link_from_deflection:
        return False
    fits = [
        least_squares_start(structure, data_of(structure.joint, some, groups), _FILTER_RATE)[1]
        for some in (recordings, [mirrored(recording) for recording in recordings])
    ]
    as_it_is, other = (_unexplained(fit) for fit in fits)
    springs = fits[1].by_name
    positive = all(springs.get(name, 1.0) > 0.0 for name in ("theta2", "alpha1"))
    return positive and other < share * as_it_is


def mirrored(recording: Recording) -> Recording:
    """The recording with its deflection turned round."""
    motor, link = recording.motor_position, recording.needed_link_position
    found = replace(recording, link_position=2.0 * motor - link)
    if recording.link_velocity is None or recording.motor_velocity is None:
        return found
    return replace(found, link_velocity=2.0 * recording.motor_velocity - recording.link_velocity)


def _unexplained(fit: LeastSquaresFit) -> float:
    """Share of the link's squared acceleration that no term explains."""
    (link,) = (row for row in fit.rows if row.name == "link")
    return link.residual_sum / link.total_sum if link.total_sum else 0.0
