"""Estimate of a fit with disturbances, with all doubts in its covariance.

Systematic parts of the disturbances show as differences between bands, and between the halves of
the log. Differences beyond chance widen the intervals. Errors that are the same in every band and
half, or that no log shows, are covered by doubts (`flexid.identification.estimation.doubts`).
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.normal_equations import scaled_inverse
from flexid.estimators.samples import side_by_side
from flexid.estimators.state_variable_filter import RowFit, regressors
from flexid.identification.estimation.band import Band
from flexid.identification.estimation.disturbed import Disturbed
from flexid.identification.estimation.doubts import (
    CABLE,
    DOUBTS,
    ECCENTRICITY,
    GAUGE,
    HIDDEN,
    LINK_CABLE,
    LINK_GRAVITY,
    LINK_STATICS,
    OF_A_BAND,
    OF_A_HALF,
    OF_A_LOG,
    Doubted,
    Repeat,
    between_bands,
    between_halves,
    between_logs,
    covariance_of,
    no_errors,
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
from flexid.models.flexible_joint import DAMPING, HARDENING, PLAY, SHAPE_TERMS, SPRING

_SOME_SAMPLES = 20_000  # enough for the shapes of terms over the angle
_BANDS = (0.5, 2.0)  # factors of the usual number of samples per period


def disturbed_estimate(
    found: Disturbed, logged: Data, hidden: FloatArray | float = 0.0, *, is_voltage: bool
) -> tuple[Estimate, dict[str, str]]:
    """Return the estimate with all doubts in its covariance, and the main cause of each variance.

    `hidden` is the covariance, shape (k, k), from removed terms.
    """
    fitted, band = found.fitted, found.best.band
    estimate = fitted.fit.at_least(fitted.unit_deviations)
    estimate = with_free_width(estimate, fitted)
    # A spring that hardens may be one with play.
    may_have_play = PLAY.isdisjoint(fitted.names) and not HARDENING.isdisjoint(fitted.names)
    squares = least_squares_start(fitted.structure, fitted.data, suited_rate(fitted))[1]
    sizes, by_play = row_sizes(squares.rows), found.by_play if may_have_play else 0.0
    doubted = Doubted(fitted, sizes, found.best.shares, is_voltage, by_play)
    errors = [(doubt(doubted), words) for doubt, words in DOUBTS.items()]
    errors += [
        (by_cable(fitted, squares.rows[0]), "a cable may act like gravity"),
        (by_curved_cable(fitted, squares.rows[0]), "a curved cable may look like it"),
        (by_eccentricity(fitted), "encoder errors once per turn may look like it"),
        (by_gauge(found), "nothing confirms the scale of the deflection's sensor"),
        (by_damping(found), "damping of the joint may look like a late link encoder"),
        (by_input_noise(found, logged), "the input's noise may come from its sensor"),
    ]
    if fitted.converged:  # otherwise there is nothing to compare other fits with
        own = Repeat(fitted.values, np.diag(estimate.covariance))
        errors.append((between_bands(own, _in_other_bands(found)), OF_A_BAND))
        errors.append((by_sampling(found, own), "the input may change between its samples"))
        parts = [("", half) for half in band.data.halves()]
        if len({*band.data.groups}) > 1:
            parts += [(f"[{log + 1}]", data) for log, data in band.data.logs()]
        one, other, *logs = side_by_side(
            lambda part: _refit(found, replace(band, data=part[1]), part[0]), parts
        )
        if one and other:
            errors.append((between_halves(fitted.values, one, other), OF_A_HALF))
        if len(of_logs := [*filter(None, logs)]) > 1:
            errors.append((between_logs(fitted.values, of_logs), OF_A_LOG))
    every = [(covariance_of(directions), words) for directions, words in errors]
    return widened(estimate, [*every, (np.broadcast_to(hidden, estimate.covariance.shape), HIDDEN)])


def by_input_noise(found: Disturbed, logged: Data) -> FloatArray:
    """Return errors by noise of the input's sensor, or since it was taken for such noise."""
    if found.input.left == 0.0 or not found.fitted.converged:
        return no_errors(found.fitted)
    other = _refit(found, replace(found.best.band, data=found.input.other_of(logged)))
    change = 0.0 if other is None else other.values - found.fitted.values
    return np.broadcast_to(found.input.left * change, found.fitted.values.shape)[:, None]


def by_sampling(found: Disturbed, own: Repeat) -> FloatArray:
    """Return errors if the input changes between its samples, by a fit to half as many of them.

    A controller that is faster than the log answers a step with a torque that the log shows only in
    part. If every other sample of the input is interpolated, such an error about doubles.
    """
    if found.fitted.structure.joint.kind == "link":
        return no_errors(found.fitted)
    # Imported late: it is slow, and few logs need it.
    from scipy.interpolate import CubicSpline

    band, samples = found.best.band, []
    for recording in band.data.samples:
        places = np.arange(len(recording.inputs))
        inputs = CubicSpline(places[::2], recording.inputs[::2])(places)
        samples.append(replace(recording, inputs=np.ascontiguousarray(inputs)))
    other = _refit(found, replace(band, data=replace(band.data, samples=tuple(samples))))
    # Uniform between none and all of it.
    return between_bands(own, [other] if other else []) / np.sqrt(3.0)


def by_damping(found: Disturbed) -> FloatArray:
    """Return errors if the delay of the link's encoder is in part a damping of the joint.

    There are none if the delay explains clearly more of a balance. In the motor's balance they are
    alike, and what pushes the link may hide the difference in its own.
    """
    fitted, structure = found.fitted, found.fitted.structure
    names, values, none = fitted.names, fitted.by_name, no_errors(fitted)
    is_absent = DAMPING.isdisjoint({*names, *structure.fixed})
    if not ({LINK, "alpha1"} <= values.keys() and is_absent):
        return none
    other = replace(structure, absent=structure.absent - DAMPING).without({LINK})
    start = {**values, "alpha_damping": values["alpha1"] * values[LINK]}
    try:
        fit = found.best.band.fit(other, start, found.best.sizes)
    except ConvergenceError:
        return none
    shares = found.best.shares.items()
    if any(LIKELIER * fit.shares[side] ** 2 > share**2 for side, share in shares):
        return none
    own = {**values, **fit.fitted.by_name, LINK: 0.0}
    change = np.array([own[name] for name in names]) - fitted.values
    return change[:, None] / np.sqrt(3.0)  # uniform between none and all of it


def by_gauge(found: Disturbed) -> FloatArray:
    """Return errors by the scale of a deflection sensor, which nothing else in the log shows.

    The error of a spring is at least that of the scale.
    """
    fitted, band = found.fitted, found.best.band
    if not band.data.relative_to:
        return no_errors(fitted)
    other = _refit(found, replace(band, data=_rescaled(band.data, 1.01)))
    change = 0.0 if other is None else 100.0 * (other.values - fitted.values)
    springs = np.array([name in SPRING for name in fitted.names])
    least = np.where(springs, np.abs(fitted.values), 0.0)
    grown = np.where(np.signbit(change), -1.0, 1.0) * np.maximum(np.abs(change), least)
    return GAUGE * grown[:, None]


def by_cable(fitted: Fitted, row: RowFit) -> FloatArray:
    """Return errors of gravity by a cable that pulls the link back.

    `row` is the link's row of least squares. A cable has a prior size, in proportion to the link's
    acceleration. If the link moves far, the log shows how large it is, since the torque of a cable
    grows with the angle, that of gravity with its sine.
    """
    structure, (cable,) = fitted.structure, SHAPE_TERMS["parallel_spring"].link
    gravity = np.array([name in LINK_GRAVITY for name in fitted.names])
    if not gravity.any() or cable in fitted.names:
        return no_errors(fitted)
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


def by_curved_cable(fitted: Fitted, row: RowFit) -> FloatArray:
    """Return errors of terms of the link's angle by a cable whose torque is curved over the angle.

    Its parts in the square and the cube of the angle have a prior size each. Over a short motion
    these terms take up the torque, and a cosine and an offset then have large errors that nearly
    cancel. The log limits what they leave of it as precisely as it limits gravity.
    """
    bases = [name.partition("[")[0] for name in fitted.names]  # without a group's number
    own = [place for place, base in enumerate(bases) if base in LINK_STATICS]
    one = next((place for place in own if bases[place] in LINK_GRAVITY | LINK_CABLE), None)
    if one is None:
        return no_errors(fitted)
    terms, angle = _terms_of_angle(fitted, [fitted.names[place] for place in own])
    pulls = np.vander(angle - angle.mean(), 4)[:, :2]
    squares = np.mean(pulls**2, axis=0)
    if not squares.all():
        return no_errors(fitted)
    pulls *= CABLE * np.sqrt(np.mean(row.left_hand_side**2) / squares)
    taken = np.linalg.lstsq(terms, pulls, rcond=None)[0]
    left = pulls - terms @ taken
    shown = fitted.minimum.reduced.information[one, one] / np.sum(terms[:, own.index(one)] ** 2)
    shown /= max(fitted.excess, 1.0) * _scatter(fitted)
    directions = np.zeros((len(bases), 2))
    directions[own] = taken @ np.linalg.cholesky(np.linalg.inv(np.eye(2) + shown * left.T @ left))
    return directions


def _terms_of_angle(fitted: Fitted, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return terms of the link's angle at some samples, shape (n, k), and the angle, (n,).

    A term that differs between groups of recordings is zero in those of the others.
    """
    system, terms, angles = fitted.structure.joint.smoothed[1], [], []
    every = 1 + sum(map(len, fitted.data.samples)) // _SOME_SAMPLES
    for samples, group in zip(fitted.data.samples, fitted.data.groups, strict=True):
        speeds = samples.velocities
        some = replace(
            samples,
            positions=samples.positions[::every],
            velocities=None if speeds is None else speeds[::every],
            inputs=samples.inputs[::every],
        )
        signals = dict(zip(system.coefficients, regressors(some, system), strict=True))
        signals |= {f"{name}[{group + 1}]": signal for name, signal in signals.items()}
        none = np.zeros(len(some))
        terms.append(np.column_stack([signals.get(name, none) for name in names]))
        angles.append(some.positions[:, 0])
    return np.concatenate(terms), np.concatenate(angles)


def by_eccentricity(fitted: Fitted) -> FloatArray:
    """Return errors of the values by an encoder error once per turn.

    In the link's balance such an error looks like gravity, through the spring. The motor's torque
    balances gravity alone, so where gravity bends the spring most, its stiffness is wrong as well.
    The log may show how large the error is. If the motion diverges with such an error, gravity may
    be wrong by as much as its value.
    """
    gravity = np.array([name in LINK_GRAVITY for name in fitted.names])
    if fitted.data.relative_to or not gravity.any():
        return no_errors(fitted)
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


def _in_other_bands(found: Disturbed) -> list[Repeat]:
    """Fit the structure in a wider and a narrower band, if the log allows them."""
    band, values = found.best.band, found.fitted.by_name
    factors = {thinning(band.data, values, share * PER_PERIOD) for share in _BANDS} - {band.factor}
    bands = (replace(band, factor=factor) for factor in sorted(factors))
    others = side_by_side(lambda other: _refit(found, other), bands)
    return [other for other in others if other is not None]


def _refit(found: Disturbed, band: Band, log: str = "") -> Repeat | None:
    """Fit the structure to other data or in another band; None if that shows nothing.

    `log` is the end of the names that belong to this log alone. Names of other logs keep their
    value, with an infinite variance.
    """
    fitted, of_band = found.fitted, band.factor == found.best.band.factor
    begun = {name.removesuffix(log): value for name, value in fitted.by_name.items()}
    try:
        other = band.fit(fitted.structure, begun, found.best.sizes, of_band=of_band).fitted
    except (ConvergenceError, SettingError):  # the latter if a part is too short for a segment
        return None
    names = [name.removesuffix(log) for name in fitted.names]
    places = [i for i, name in enumerate(names) if not (log and "[" in name)]
    # A channel with a delay beyond the margin has no data to compare.
    as_before = other.names == tuple(names[i] for i in places)
    if not (as_before and other.converged and other.has_partners):
        return None
    values, variances = fitted.values.copy(), np.full(len(names), np.inf)
    values[places] = other.values
    variances[places] = np.maximum(np.diag(other.fit.covariance), other.unit_deviations**2)
    return Repeat(values, variances)
