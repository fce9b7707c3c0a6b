"""Choice between the exact fit of a log and the fit with disturbances.

The exact fit assumes sensor noise alone. It reaches the Cramér-Rao bound on a log that the model
explains. If it leaves larger residuals, its intervals allow for the worst error that these may
hide. The fit with disturbances assumes that the model is incomplete. The fit that determines
inertias, stiffness and gravity better is reported.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.budget import BudgetError, within
from flexid.identification.estimation.doubts import (
    DOUBTS,
    OF_A_VOLTAGE,
    OF_AN_EXACT_FIT,
    Doubted,
    Repeat,
    another_law,
    between_bands,
    covariance_of,
    widened,
)
from flexid.identification.estimation.final_fits import (
    FinalFits,
    final_fits,
    hidden_covariance,
    with_doubts,
)
from flexid.identification.estimation.spring_doubts import delay_doubts, doubts_of_spring
from flexid.identification.full_model.fits_by_length import (
    TURNING,
    FitsByLength,
    explains,
    is_acceptable,
    nearly_explains,
)
from flexid.identification.full_model.fitting import fit_like, lengths, motion_at
from flexid.identification.full_model.model import Fitted
from flexid.identification.full_model.starting import suited_rate
from flexid.identification.structure.choice import Choice, core_deviations, hardly_known
from flexid.identification.structure.elimination import latest, one_by_one
from flexid.identification.structure.job import MEASURED_HOLD, Job, predicting
from flexid.identification.structure.validation import validate
from flexid.identification.vocabulary.evidence import (
    Disturbances,
    Estimate,
    Validation,
)
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import DISSIPATIVE, POSITIVE
from flexid.recording.recording import Caution

if TYPE_CHECKING:
    from flexid.identification.estimation.disturbed import Disturbed

# Share of a balance's acceleration that disturbances leave, up to which an exact fit may be
# reported. In 15 logs with one, they left up to 0.004.
_LEFT_BY_EXACT = 0.01
_BY_CHANCE = 3.0  # standard deviations of a mean square of noise
OF_A_LENGTH = "segments of other lengths give other values"
# Most integration steps to search for an exact fit, some ten seconds. As many again may be taken to
# complete a search that has succeeded, to search in a part of the log, and to fit all data. Logs of
# 34 families took 5.6e6 at most for all. More are needed if the model does not explain the log, or
# if the joint is so stiff that a sample needs many steps. At 1.1e7 an axis logged at 2 kHz for 22 s
# lost its exact fit, and took 37 s with disturbances for 11 s without.
_MOST_STEPS = 2.2e7
_FEWEST_IN_PART = 300  # samples of a piece of the log: several periods of the resonance
_BY_DELAY = "all of which is a delay between the encoders"
_BY_DISTURBANCES = "the input is low-passed to the joint's band, where all holds are alike"
_RETREAT = (
    "the fit to all data does not converge, so the values come from the data before the "
    "held-out end: check that end of the log"
)


@dataclass(frozen=True, eq=False)
class Answer:
    """Answer from a log: the fits, the estimate with all doubts, and their main causes."""

    fits: FinalFits  # fits to all data
    validation: Validation  # of the structure fitted to the data before the held-out ends
    estimate: Estimate  # with all doubts in its covariance
    disturbances: Disturbances | None = None  # None for an exact fit
    cost: float = np.nan  # -2 log likelihood of a fit with disturbances
    widest: Mapping[str, str] = field(default_factory=dict)  # main cause of each interval's width
    # reasons why coefficients are unknown in spite of their intervals
    doubts: tuple[Caution, ...] = ()
    # the unknown coefficients, of one balance or both
    doubted: frozenset[str] = frozenset()
    prediction: str = ""  # text on how well the spring predicts the deflection
    retreat: tuple[str, ...] = ()  # warning if the values do not come from all data


def answer(job: Job) -> Answer:
    """Return the exact fit or the fit with disturbances, whichever determines more."""
    if job.exact:
        choice, validation = predicting(job)
        return _exact(job, _fits_to_all(job, choice, insist=True), validation)
    try:
        choice, validation = _searched(job)
        with within(_MOST_STEPS):
            fits, exact = _exact_fits(job, choice), None
    except (ConvergenceError, BudgetError):
        return _disturbed(job)
    if fits is not None and (
        _explains(fits.reported, job) or nearly_explains(fits.reported, job.thresholds)
    ):
        exact = _exact(job, fits, validation)
        if final := _final_exact(job, exact):
            return final
    short = exact if exact and _is_short(exact, job) else None
    explains_nearly = exact and nearly_explains(exact.fits.reported, job.thresholds)
    nearly = exact if explains_nearly and not short else None
    well_known = 0.5 * job.thresholds.noted_width  # two deviations are half an interval
    if nearly and _core_width(nearly) <= well_known:
        return _judged(nearly, nearly.fits.choice.fitted, job)
    disturbed = None
    with suppress(ConvergenceError):
        disturbed = _disturbed(job)
    if disturbed is None:
        return exact or _exact(job, fits or _fits_to_all(job, choice, insist=True), validation)
    if nearly and _core_width(nearly) <= _core_width(disturbed):
        return _judged(nearly, nearly.fits.choice.fitted, job)
    if short and _core_width(disturbed) > 0.5 * job.thresholds.determined_width:
        return short
    return disturbed


def _searched(job: Job) -> tuple[Choice, Validation]:
    """Return the structure and its predictions; of a log that is too long, from a part of it."""
    # A structure from a part must explain it, since the part may not show every term.
    try:
        with within(_MOST_STEPS):
            return predicting(job)
    except BudgetError:
        part = replace(job, in_part=True)
        if min(map(len, part.training.samples)) < _FEWEST_IN_PART:
            raise
        with within(_MOST_STEPS):
            found = predicting(part)
        if not explains(found[0].fitted, job.thresholds):
            raise
        return found


def answer_again(job: Job, before: Answer) -> Answer:
    """Return the answer with a corrected input, after that with the logged one.

    The search for an exact fit is repeated only if disturbances leave little, so it may succeed.
    """
    if before.disturbances is not None:
        found = _disturbed(job)
        if found.disturbances and max(found.disturbances.shares.values()) > _LEFT_BY_EXACT:
            return found
    return answer(job)


def _exact_fits(job: Job, choice: Choice) -> FinalFits | None:
    """Return the exact fits to all data; None if they leave too much, or do not converge."""
    if not is_acceptable(choice.fitted, job.thresholds):
        return None
    with suppress(ConvergenceError):
        return _fits_to_all(job, choice, insist=_explains(choice.fitted, job))
    return None


def _fits_to_all(job: Job, choice: Choice, *, insist: bool) -> FinalFits:
    """Return the exact fits to all data; see `final_fits`."""
    job.progress("fit to all data")
    rest = job.settings.filter_rate, job.thresholds
    return final_fits(choice, job.whole, job.recordings, *rest, insist=insist)


def _explains(fitted: Fitted, job: Job) -> bool:
    """Whether a fit leaves no more than noise, or lies at a bound that may explain the rest."""
    return fitted.excess <= job.thresholds.sensor_excess or bool(fitted.at_bound)


def _final_exact(job: Job, exact: Answer) -> Answer | None:
    """Return the exact fit if it is final; None if a fit with disturbances may determine more."""
    reported = exact.fits.reported
    # Disturbances would hide that the log contradicts a bound; the exact fit shows it.
    if reported.at_bound:
        return exact
    if reported.excess > job.thresholds.sensor_excess or not reported.converged:
        return None
    doubts = delay_doubts(job, job.whole, entirely=True)
    if doubts:
        return replace(exact, doubts=doubts, doubted=POSITIVE, prediction=_BY_DELAY)
    return None if _is_short(exact, job) else exact


def _is_short(exact: Answer, job: Job) -> bool:
    """Whether a fit explains a log only over segments too short to show what it lacks."""
    fitted, thresholds = exact.fits.reported, job.thresholds
    has_longer = exact.fits.choice.by_length.has_longer(fitted) and fitted.duration < TURNING
    is_noise = fitted.excess <= thresholds.sensor_excess and fitted.converged
    if not (has_longer and is_noise) or fitted.structure.joint.kind == "rigid":
        return False
    if not is_acceptable(exact.fits.lengths_fitted[-1], thresholds):
        return True
    chance = 1.0 + _BY_CHANCE * np.sqrt(2.0 / fitted.problem.degrees_of_freedom)
    return fitted.excess > chance and not nearly_explains(fitted, thresholds)


def _core_width(found: Answer) -> float:
    """Return the geometric mean of the core's relative deviations; infinite if not converged."""
    widths = core_deviations(found.estimate)
    if not found.fits.reported.converged or not len(widths):
        return np.inf
    return float(np.exp(np.mean(np.log(np.maximum(widths, np.finfo(float).tiny)))))


def _exact(job: Job, fits: FinalFits, validation: Validation) -> Answer:
    """Return the answer of the exact fits, which assume sensor noise alone."""
    choice, thresholds = fits.choice, job.thresholds
    if hardly_known(fits.reported, thresholds):
        job.progress("trying each term's absence")
        leaner, gone = one_by_one(fits.reported, job.kept, thresholds)
        if gone and (fitted := fit_like(leaner.structure, choice.fitted)):
            terms = latest(choice.terms, gone)
            choice = replace(choice, structure=leaner.structure, fitted=fitted, terms=terms)
            with suppress(ConvergenceError):
                fits = _fits_to_all(job, choice, insist=False)
    job.progress("removed terms")
    estimate = with_doubts(fits, job.delay_in_doubt, thresholds)
    reported = fits.reported
    doubts = OF_AN_EXACT_FIT + OF_A_VOLTAGE * job.is_voltage
    if reported.excess > thresholds.sensor_excess:
        doubts += (another_law,)
    doubted = Doubted(reported, {}, {}, job.is_voltage)
    errors = [(covariance_of(doubt(doubted)), DOUBTS[doubt]) for doubt in doubts]
    errors.append((covariance_of(between_lengths(fits, thresholds)), OF_A_LENGTH))
    estimate, widest = widened(estimate, errors)
    return Answer(fits, validation, estimate, widest=widest)


def between_lengths(fits: FinalFits, thresholds: Thresholds) -> FloatArray:
    """Return directions of errors, shape (k, n), from fits over segments of other lengths.

    They apply to a rigid joint that does not explain long segments. Over short segments noise hides
    the model error, but the values change with the length. With two encoders the deflection shows
    the error instead.
    """
    own, every = fits.reported, fits.lengths_fitted
    explained = every[-1].excess <= thresholds.sensor_excess
    if explained or own.structure.joint.kind != "rigid":
        return np.zeros((len(own.names), 0))
    first, *others = (
        Repeat(each.values, each.unit_deviations**2 * max(each.excess, 1.0))
        for each in (own, *(each for each in every if each.duration != own.duration))
    )
    return between_bands(first, others)


def _disturbed(job: Job) -> Answer:
    """Return the answer of the fit with disturbances."""
    # Imported late: a log that its model explains needs none of these modules.
    from flexid.identification.estimation.disturbed import fit_disturbed, fit_disturbed_to, follower
    from flexid.identification.estimation.disturbed_estimate import disturbed_estimate

    job.progress("fit with disturbances")
    training, whole = job.training, job.whole
    holds = job.holds if job.joint.kind == "link" else (MEASURED_HOLD, "zero")
    fitted = fit_disturbed(
        job.structure,
        training,
        job.kept,
        holds,
        job.thresholds,
        with_shapes=job.settings.terms == "auto" and job.joint.kind != "rigid",
    )
    # The fit's values in a motion without observer, over the data as logged.
    own = fitted.fitted
    problem, _ = motion_at(own.ended, training, lengths(training)[-1], own.by_name, None)
    undisturbed = replace(own, problem=problem, data=training)
    follow = follower(fitted, whole)
    validation = validate(undisturbed, whole, job.recordings.starts, follow=follow)
    retreat: tuple[str, ...] = ()
    try:
        refitted = fit_disturbed_to(fitted, whole)
    except ConvergenceError:
        refitted, whole, retreat = fitted, training, (_RETREAT,)
    fits = _fits(refitted, job)
    # Every drive has friction, and disturbances may hide it.
    hidden = hidden_covariance(fits, certain=DISSIPATIVE)
    estimate, widest = disturbed_estimate(refitted, whole, hidden, is_voltage=job.is_voltage)
    sample_time = refitted.fitted.data.samples[0].sample_time
    best, removed = refitted.best, refitted.input.removed_from(whole)
    disturbances = Disturbances(best.shares, sample_time, removed)
    found = Answer(fits, validation, estimate, disturbances, best.cost, widest, retreat=retreat)
    return _judged(found, undisturbed, job)


def _judged(found: Answer, fitted: Fitted, job: Job) -> Answer:
    """Add doubts about the stiffness to an answer that does not explain the log."""
    if job.joint.kind == "rigid":
        return found
    shares = {} if found.disturbances is None else found.disturbances.shares
    own = doubts_of_spring(fitted, found.fits.reported.data, shares, job)
    return replace(found, **own._asdict())


def _fits(found: "Disturbed", job: Job) -> FinalFits:
    """Return a fit with disturbances as `FinalFits`."""
    fitted, full = found.fitted, found.full
    by_length = FitsByLength((), (), True, tuple(job.holds), _BY_DISTURBANCES)
    choice = Choice(full.structure, fitted.structure, fitted, found.terms, (), by_length)
    rate = suited_rate(fitted, job.settings.filter_rate)
    return FinalFits(choice, job.recordings, fitted, full, rate)
