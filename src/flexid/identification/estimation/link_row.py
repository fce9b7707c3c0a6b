"""The link's row alone, beside the fit of both rows.

One fit of both rows believes both. Where the residuals show a model error, it mostly is the
motor's: friction of another law, ripple of the torque. Through the spring it bends the link's
coefficients too. The link's row needs no torque and no friction of the motor: driven by the motor's
measured position it stands for itself. Where it knows every coefficient of the link better than
both rows together do, its values and their covariance take the place of theirs, and what is left,
the motor's, follows along the quadratic form of the fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.estimators.segments import divide
from flexid.identification.estimation.absence import hidden_covariance
from flexid.identification.estimation.measured_input import error_of, widened_by
from flexid.identification.estimation.model_error import (
    driving_covariance,
    driving_frictions,
    stand_in_covariance,
)
from flexid.identification.full_model.fitting import expanded, refit
from flexid.identification.full_model.model import FINE, LINK, Fitted, Structure, data_of
from flexid.identification.preparation.joint import link
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.structure.gap import with_free_width
from flexid.identification.structure.job import MEASURED_HOLD
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import LinkRow, ModelError
from flexid.identification.vocabulary.intervals import interval, quantile
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.terms import SMOOTHING


def with_link_row(
    estimate: Estimate,
    reported: Fitted,
    rungs: Sequence[Fitted],
    full: Fitted,
    recordings: SplitRecordings,
    scales: Mapping[str, float],
    error: ModelError,
    thresholds: Thresholds,
) -> tuple[Estimate, LinkRow | None]:
    """An estimate of both rows, with what the link's row alone knows better.

    Parameters
    ----------
    estimate : Estimate
        Of both rows, with everything in its covariance that is doubted.
    reported : Fitted
        The fit that it comes from.
    rungs : sequence of Fitted
        The same over segments of growing length.
    full : Fitted
        The fit of the full model.
    recordings : SplitRecordings
        The data.
    scales : mapping of str to float
        Size that a coefficient or delay may have by itself; see `hidden_covariance`.
    error : ModelError
        What the residuals of both rows say about the model.
    thresholds : Thresholds
        What counts as evidence of such an error.

    Returns
    -------
    estimate : Estimate
        The same, unless the row alone knows all of the link's coefficients better.
    row : LinkRow or None
        What the row alone gives; None where it was not asked: the fit shows no model error, there
        is one row only, its spring has a memory, or the row alone cannot be fitted within bounds.
    """
    structure = reported.structure
    remembered = structure.joint.remembered - structure.absent
    if structure.joint.kind != "flexible" or error.share == 0.0 or remembered:
        return estimate, None
    try:
        # What noise explains shows over short segments; the row's own may hold an error as well.
        shortest, fitted = _fits_alone(reported, (rungs[0], reported), recordings)
    except ConvergenceError:
        return estimate, None
    if fitted.at_bound:
        return estimate, None
    own = error_of(fitted, [shortest, fitted], thresholds)
    alone = with_free_width(widened_by(fitted, own), fitted)
    usual = expanded(_alone(full.structure, reported), fitted)
    alone = alone.widened(hidden_covariance(fitted, usual, scales))
    # A stand-in in the spring is in this row as well, and so is what it may stand for.
    alone = alone.widened(stand_in_covariance(fitted, error, thresholds))
    alone = alone.widened(driving_covariance(fitted, driving_frictions(fitted, thresholds)))
    found = taken(estimate, alone, thresholds)
    row = LinkRow(
        fitted.excess, _values(alone, estimate), _values(estimate, alone), found is not None
    )
    return found or estimate, row


def taken(estimate: Estimate, alone: Estimate, thresholds: Thresholds) -> Estimate | None:
    """An estimate with the values of some of its names taken from another one.

    The others keep what they are given these values: the marginal distribution is another, the
    conditional one the same. Nothing rests on the two being independent. But what bounds a model
    error was made for all of them together, so the deviations of the others fall by less.

    Parameters
    ----------
    estimate : Estimate
        Of everything.
    alone : Estimate
        Of some of it, and maybe of other names.
    thresholds : Thresholds
        Factor by which the others are doubted beyond what follows, as far as they were before; and
        what counts as a contradiction.

    Returns
    -------
    Estimate or None
        None where the other does not know each of the shared names better, or contradicts the
        estimate: one of them is wrong then, and the motor's coefficients would follow far.
    """
    shared = [name for name in estimate.names if name in alone.names]
    places = [estimate.names.index(name) for name in shared]
    others = [alone.names.index(name) for name in shared]
    before = estimate.deviations[places]
    better = _half_widths(alone)[others] < _half_widths(estimate)[places]
    if not shared or not better.all() or not np.isfinite(before).all():
        return None
    apart = np.abs(alone.values[others] - estimate.values[places])
    if (apart > thresholds.contradiction * np.hypot(before, alone.deviations[others])).any():
        return None
    old = estimate.covariance[np.ix_(places, places)]
    new = alone.covariance[np.ix_(others, others)]
    finite = np.where(np.isfinite(estimate.covariance), estimate.covariance, 0.0)
    gain = finite[:, places] @ scaled_inverse(old, before)[0]
    gain[places] = np.eye(len(places))
    least = min(alone.degrees_of_freedom[other] for other in others)
    freedom = [min(own, least) for own in estimate.degrees_of_freedom]
    for place, other in zip(places, others, strict=True):
        freedom[place] = alone.degrees_of_freedom[other]
    found = Estimate(
        estimate.names,
        estimate.values + gain @ (alone.values[others] - estimate.values[places]),
        estimate.covariance + gain @ (new - old) @ gain.T,
        tuple(freedom),
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        fallen = estimate.deviations / found.deviations
    factors = np.where(np.isfinite(fallen), np.clip(fallen, 1.0, thresholds.row_doubt), 1.0)
    factors[places] = 1.0
    return found.scaled(factors)


def _half_widths(estimate: Estimate) -> FloatArray:
    quantiles = [quantile(freedom) for freedom in estimate.degrees_of_freedom]
    return np.array(quantiles) * estimate.deviations


def _fits_alone(
    reported: Fitted, as_long: Sequence[Fitted], recordings: SplitRecordings
) -> list[Fitted]:
    """The link's row fitted over segments as long as others', from where both rows' fit ended."""
    structure = _alone(reported.structure, reported)
    data = replace(
        data_of(structure.joint, recordings.whole, recordings.groups),
        refinement=reported.data.refinement,
    )
    system = reported.problem.unknowns.system
    every = dict(zip(system.coefficients, reported.coefficients(0).tolist(), strict=True))
    start = {**every, **reported.delays, **reported.by_name}
    found = []
    for other in as_long:
        segments = divide(data.samples, other.duration, margin=data.margin)
        states = other.minimum.point.initial_states[:, :2]
        found.append(refit(structure, data, start, segments, FINE, states))
    return found


def _alone(structure: Structure, reported: Fitted) -> Structure:
    """The link's part of a structure; the clock of its encoder is that of both rows."""
    whole, joint = structure.joint, link()
    if whole.system is whole.smooth:
        joint = joint.with_coulomb_velocity(whole.smooth.constants[SMOOTHING])
    own = {*joint.extended.coefficients}
    widths = {n: w for n, w in whole.extended.constants.items() if n in joint.extended.constants}
    sought = tuple(name for name in structure.timing.sought if name == LINK)
    return Structure(
        joint.with_widths(widths),
        structure.absent & own,
        Timing(MEASURED_HOLD, {LINK: reported.delays[LINK]}, sought),
        {n: v for n, v in {**structure.fixed, **reported.at_bound}.items() if n in own},
        {n: ends for n, ends in structure.bounds.items() if n in own - {*reported.at_bound}},
    )


def _values(of: Estimate, beside: Estimate) -> dict[str, tuple[float, float, float]]:
    """Value and interval of all that is in both estimates."""
    return {
        name: (float(value), *interval(float(value), float(std), freedom))
        for name, value, std, freedom in zip(
            of.names, of.values, of.deviations, of.degrees_of_freedom, strict=True
        )
        if name in beside.names
    }
