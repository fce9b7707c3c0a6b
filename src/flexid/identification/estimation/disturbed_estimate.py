"""Estimate of a fit with disturbances, with all doubts in its covariance.

Systematic parts of the disturbances show as differences between bands, and between the halves of
the log. Differences beyond chance widen the intervals. Errors that are the same in every band and
half, or that no log shows, are covered by doubts (`flexid.identification.estimation.doubts`).
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.normal_equations import scaled_inverse
from flexid.estimators.samples import side_by_side
from flexid.estimators.state_variable_filter import RowFit
from flexid.identification.estimation.band import fit_in_band, shares_of
from flexid.identification.estimation.disturbed import Disturbed
from flexid.identification.estimation.doubts import (
    CABLE,
    DOUBTS,
    ECCENTRICITY,
    HIDDEN,
    LINK_GRAVITY,
    OF_A_BAND,
    OF_A_HALF,
    Doubted,
    Repeat,
    between_bands,
    between_halves,
    covariance_of,
    widened,
)
from flexid.identification.estimation.excitations import row_sizes
from flexid.identification.estimation.rig_errors import (
    SHARE,
    SMALL_SHARE,
    likely_changes,
    with_sensor_error,
)
from flexid.identification.estimation.thinned_log import PER_PERIOD, thinning
from flexid.identification.full_model.fitting import expanded
from flexid.identification.full_model.model import LINK, Data, Fitted
from flexid.identification.full_model.starting import least_squares_start, suited_rate
from flexid.identification.structure.gap import LIKELIER, with_free_width
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import DAMPING, HARDENING, PLAY, SHAPE_TERMS

_BANDS = (0.5, 2.0)  # factors of the usual number of samples per period


def disturbed_estimate(
    found: Disturbed, data: Data, hidden: FloatArray | float = 0.0, *, is_voltage: bool
) -> tuple[Estimate, dict[str, str]]:
    """Return the estimate with all doubts in its covariance, and the main cause of each variance.

    `hidden` is the covariance, shape (k, k), from removed terms.
    """
    fitted, logged, data = found.fitted, data, found.input.of(data)
    estimate = fitted.fit.at_least(fitted.unit_deviations)
    estimate = with_free_width(estimate, fitted)
    names = fitted.names
    # A spring that hardens may be one with play.
    may_have_play = PLAY.isdisjoint(names) and not HARDENING.isdisjoint(names)
    squares = least_squares_start(fitted.structure, fitted.data, suited_rate(fitted))[1]
    doubted = Doubted(
        fitted,
        row_sizes(squares.rows),
        dict(found.shares),
        is_voltage,
        _by_gauge(found, data),
        by_cable(fitted, squares.rows[0]),
        by_eccentricity(fitted),
        by_damping(found, data),
        _by_input_noise(found, logged),
        found.by_play if may_have_play else 0.0,
    )
    errors = [(doubt(doubted), words) for doubt, words in DOUBTS.items()]
    if fitted.converged:  # otherwise there is nothing to compare other fits with
        own = Repeat(fitted.values, np.diag(estimate.covariance))
        errors.append((between_bands(own, _in_other_bands(found, data)), OF_A_BAND))
        one, other = side_by_side(lambda half: _refit(found, half, found.factor), data.halves())
        errors += [(between_halves(one, other), OF_A_HALF)] if one and other else []
    every = [(covariance_of(directions), words) for directions, words in errors]
    return widened(estimate, [*every, (np.broadcast_to(hidden, estimate.covariance.shape), HIDDEN)])


def _by_input_noise(found: Disturbed, logged: Data) -> FloatArray:
    """Return the likely error of each value, shape (k,), by noise of the input's sensor."""
    none = np.zeros(len(found.fitted.names))
    if found.input.left == 0.0 or not found.fitted.converged:
        return none
    other = _refit(found, found.input.other_of(logged), found.factor)
    return none if other is None else found.input.left * (other.values - found.fitted.values)


def by_damping(found: Disturbed, data: Data) -> FloatArray | None:
    """Return the change of each value, shape (k,), with damping instead of a late link encoder.

    None if the delay explains clearly more of a balance. In the motor's balance they are alike, and
    what pushes the link may hide the difference in its own.
    """
    fitted, structure = found.fitted, found.fitted.structure
    names, values = fitted.names, fitted.by_name
    is_absent = DAMPING.isdisjoint({*names, *structure.fixed})
    if not ({LINK, "alpha1"} <= values.keys() and is_absent):
        return None
    other = replace(structure, absent=structure.absent - DAMPING).without({LINK})
    start = {**values, "alpha_damping": values["alpha1"] * values[LINK]}
    try:
        fit = fit_in_band(other, data, found.factor, start, found.sizes)
    except ConvergenceError:
        return None
    shares = shares_of(fit.fitted, fit.sizes)
    if any(LIKELIER * shares[side] ** 2 > share**2 for side, share in found.shares.items()):
        return None
    own = {**values, **fit.fitted.by_name, LINK: 0.0}
    return np.array([own[name] for name in names]) - fitted.values


def _by_gauge(found: Disturbed, data: Data) -> FloatArray | None:
    """Return the change of each value, shape (k,), if the deflection sensor reads 1 % more."""
    if not data.relative_to:
        return None
    other = _refit(found, _rescaled(data, 1.01), found.factor)
    return (
        np.zeros(len(found.fitted.names)) if other is None else other.values - found.fitted.values
    )


def by_cable(fitted: Fitted, row: RowFit) -> FloatArray | None:
    """Return errors of gravity, shape (k, 2), by a cable that pulls the link back.

    `row` is the link's row of least squares. A cable has a prior size, in proportion to the link's
    acceleration. If the link moves far, the log shows how large it is, since the torque of a cable
    grows with the angle, that of gravity with its sine.
    """
    structure, (cable,) = fitted.structure, SHAPE_TERMS["parallel_spring"].link
    gravity = np.array([name in LINK_GRAVITY for name in fitted.names])
    if not gravity.any() or cable in fitted.names:
        return None
    wider = replace(structure, absent=structure.absent - {cable})
    seen = expanded(wider.with_hold(fitted.problem.timing.hold), fitted)
    place = seen.names.index(cable)
    own = np.arange(len(seen.names)) != place
    scatter = max(fitted.excess, 1.0) * _scatter(fitted)
    information = seen.minimum.reduced.information / scatter
    angle = fitted.problem.segments.outputs[:, 0]
    size = CABLE * np.sqrt(np.mean(row.left_hand_side**2)) / np.std(angle)
    information[place, place] += size**-2
    inverse, _ = scaled_inverse(information, np.sqrt(np.diag(information)))
    mean = inverse @ seen.minimum.reduced.scores.sum(axis=1) / scatter
    spread = inverse[:, place] / np.sqrt(inverse[place, place])
    return gravity[:, None] * np.column_stack((spread, mean))[own]


def by_eccentricity(fitted: Fitted) -> FloatArray | None:
    """Return errors of the values, shape (k, 3) or (k, 1), by an encoder error once per turn.

    In the link's balance such an error looks like gravity, through the spring. The motor's torque
    balances gravity alone, so where gravity bends the spring most, its stiffness is wrong as well.
    The log may show how large the error is. If the motion diverges with such an error, gravity may
    be wrong by as much as its value.
    """
    gravity = np.array([name in LINK_GRAVITY for name in fitted.names])
    if fitted.data.relative_to or not gravity.any():
        return None
    angle = fitted.problem.segments.outputs[:, 0]
    errors = [ECCENTRICITY * wave(angle) for wave in (np.sin, np.cos)]
    for share in (SHARE, SMALL_SHARE):
        rigs = [with_sensor_error(fitted, 0, error, share) for error in errors]
        with suppress(ConvergenceError):
            return likely_changes(fitted, rigs, _scatter(fitted), share)
    return (gravity * fitted.values)[:, None]


def _scatter(fitted: Fitted) -> float:
    """Return the largest ratio of a variance to its value for white innovations."""
    return float(np.fmax(fitted.scatter, 1.0).max()) ** 2


def _rescaled(data: Data, scale: float) -> Data:
    """Return the log with the readings of its deflection sensor multiplied by `scale`."""
    rescaled = []
    for samples in data.samples:
        assert samples.velocities is not None
        positions, velocities = samples.positions.copy(), samples.velocities.copy()
        if positions.shape[1] == 1:  # the motor's motion is the input
            motor, speed = samples.inputs[:, 0], samples.inputs[:, 1]
        else:
            motor, speed = positions[:, 1], velocities[:, 1]
        positions[:, 0] = motor + scale * (positions[:, 0] - motor)
        velocities[:, 0] = speed + scale * (velocities[:, 0] - speed)
        rescaled.append(replace(samples, positions=positions, velocities=velocities))
    return replace(data, samples=tuple(rescaled))


def _in_other_bands(found: Disturbed, data: Data) -> list[Repeat]:
    """Fit the structure in a wider and a narrower band, if the log allows them."""
    factors = {thinning(data, found.fitted.by_name, share * PER_PERIOD) for share in _BANDS} - {
        found.factor
    }
    others = side_by_side(lambda factor: _refit(found, data, factor), sorted(factors))
    return [other for other in others if other is not None]


def _refit(found: Disturbed, data: Data, factor: int) -> Repeat | None:
    fitted = found.fitted
    try:
        other = fit_in_band(
            fitted.structure,
            data,
            factor,
            fitted.by_name,
            found.sizes,
            of_band=factor == found.factor,
        ).fitted
    except ConvergenceError:
        return None
    # A channel with a delay beyond the margin has no data to compare.
    if not (other.names == fitted.names and other.converged and other.has_partners):
        return None
    variances = np.maximum(np.diag(other.fit.covariance), other.unit_deviations**2)
    return Repeat(other.values, variances)
