"""The exact fit of a log; or, where that does not explain it, the fit with disturbances.

The exact fit knows nothing but the sensors' noise, and reaches the Cramér-Rao bound on a log that
the model explains. Where it leaves more, its intervals allow for the worst error that may hide in
what is left. The fit with disturbances expects to be wrong. Of the two that is reported which knows
the inertias, the stiffness and gravity better.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import NEARLY_NOISE
from flexid.identification.estimation.doubts import (
    DOUBTS,
    OF_A_VOLTAGE,
    OF_AN_EXACT_FIT,
    Doubted,
    Repeat,
    between_bands,
    covariance_of,
    widened,
)
from flexid.identification.estimation.final_fits import (
    RETREAT,
    FinalFits,
    final_fits,
    hidden_covariance,
    with_doubts,
)
from flexid.identification.estimation.model_error import lagged
from flexid.identification.full_model.fits_by_length import (
    FitsByLength,
    may_stand,
    nearly_explains,
)
from flexid.identification.full_model.fitting import fit_like, lengths, motion_at
from flexid.identification.full_model.model import Data, Fitted
from flexid.identification.full_model.starting import suited_rate
from flexid.identification.structure.elimination import (
    Choice,
    core_deviations,
    hardly_known,
    latest,
    one_by_one,
)
from flexid.identification.structure.job import MEASURED_HOLD, Job, predicting
from flexid.identification.structure.link_delay import skew
from flexid.identification.structure.validation import validate
from flexid.identification.vocabulary.evidence import (
    Disturbances,
    Estimate,
    ModelError,
    Validation,
    balance_of,
)
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import DISSIPATIVE, POSITIVE, resonance
from flexid.recording.recording import Caution, Rank

if TYPE_CHECKING:
    from flexid.identification.estimation.disturbed import Disturbed

PREDICTED = 25.0  # per cent of the deflection that a spring predicts at least: noise alone, 0
UNEXPLAINED = 0.1  # of a balance's acceleration: with less, its spring is there all the same
OF_A_LENGTH = "segments of other lengths give other values"
_BY_DELAY = "all of which is a delay between the encoders"
_BY_DISTURBANCES = "the input is low-passed to the joint's band, where no hold can be told"


@dataclass(frozen=True, eq=False)
class Answer:
    """What a log says."""

    fits: FinalFits  # to all data
    validation: Validation  # of the same structure, fitted to the data before the held-out ends
    estimate: Estimate  # with all that is doubted in its covariance
    disturbances: Disturbances | None = None  # of the fit with disturbances, if that is it
    cost: float = np.nan  # of that fit: twice the negative logarithm of its likelihood
    widest: Mapping[str, str] = field(default_factory=dict)  # what makes most of an interval
    # why some coefficient is not known, whatever its interval says
    doubts: tuple[Caution, ...] = ()
    # which these are, in one balance or in both: of the motor, as the link may be part of it, all
    doubted: frozenset[str] = POSITIVE
    prediction: str = ""  # how well the spring predicts the deflection


def answer(job: Job) -> Answer:
    """The fit that knows more."""
    try:
        chosen = predicting(job)
    except ConvergenceError:
        if job.exact:
            raise
        return _disturbed(job)
    exact = _standing(job, chosen)
    if exact is not None and (settled := _settled(job, exact)):
        return settled
    nearly = exact if exact and nearly_explains(exact.fits.reported, job.thresholds) else None
    well_known = 0.5 * job.thresholds.noted_width  # two deviations are half an interval
    if nearly and _core_width(nearly) <= well_known:
        return _judged(nearly, nearly.fits.choice.fitted, job)
    disturbed = _if_possible(job)
    if disturbed is None:
        return exact or _exact(job, chosen, anyhow=True)
    if nearly and _core_width(nearly) <= _core_width(disturbed):
        return _judged(nearly, nearly.fits.choice.fitted, job)
    return disturbed


def _standing(job: Job, chosen: tuple[Choice, Validation]) -> Answer | None:
    """The exact fit; None where it may not stand, or does not end and another may."""
    fitted, thresholds = chosen[0].fitted, job.thresholds
    if not (job.exact or may_stand(fitted, thresholds)):
        return None
    anyhow = job.exact or _explains(fitted, job)
    try:
        return _exact(job, chosen, anyhow=anyhow)
    except ConvergenceError:
        if anyhow:
            raise
        return None


def _explains(fitted: Fitted, job: Job) -> bool:
    """Whether a fit leaves no more than noise, or what contradicts its bound."""
    return fitted.excess <= job.thresholds.sensor_excess or bool(fitted.at_bound)


def _settled(job: Job, exact: Answer) -> Answer | None:
    """The exact fit where no other is asked; None where one with disturbances may know more."""
    reported = exact.fits.reported
    # Disturbances would follow any bound; the exact fit says what contradicts it.
    if job.exact or reported.at_bound:
        return exact
    if reported.excess > job.thresholds.sensor_excess:
        return None
    doubts = _skewed(job, job.whole, entirely=True)
    return replace(exact, doubts=doubts, prediction=_BY_DELAY) if doubts else exact


def _core_width(found: Answer) -> float:
    """Geometric mean of the core's relative deviations; infinite where one is not known."""
    widths = core_deviations(found.estimate)
    if not found.fits.reported.converged or not len(widths):
        return np.inf
    return float(np.exp(np.mean(np.log(np.maximum(widths, np.finfo(float).tiny)))))


def _exact(job: Job, chosen: tuple[Choice, Validation], *, anyhow: bool) -> Answer:
    """The fit that knows of the sensors' noise alone."""
    choice, validation = chosen
    job.progress("fit to all data")
    rate, thresholds = job.settings.filter_rate, job.thresholds
    rest = rate, thresholds
    fits = final_fits(choice, job.whole, job.recordings, *rest, anyhow=anyhow)
    if hardly_known(fits.reported, thresholds):
        job.progress("trying each term's absence")
        leaner, gone = one_by_one(fits.reported, job.kept, thresholds)
        if gone and (fitted := fit_like(leaner.structure, choice.fitted)):
            terms = latest(choice.terms, gone)
            choice = replace(choice, structure=leaner.structure, fitted=fitted, terms=terms)
            fits = final_fits(choice, job.whole, job.recordings, *rest, anyhow=anyhow)
    job.progress("what the model does without")
    estimate = with_doubts(fits, job.delay_in_doubt, thresholds)
    doubts = OF_AN_EXACT_FIT + OF_A_VOLTAGE * (job.input_unit == "V")
    doubted = Doubted(fits.reported, {}, {}, job.input_unit, None, by_lag=lagged(fits.reported))
    errors = [(covariance_of(doubt(doubted)), DOUBTS[doubt]) for doubt in doubts]
    errors.append((covariance_of(between_lengths(fits, thresholds)), OF_A_LENGTH))
    estimate, widest = widened(estimate, errors)
    return Answer(fits, validation, estimate, widest=widest)


def between_lengths(fits: FinalFits, thresholds: Thresholds) -> FloatArray:
    """Directions of errors of a model that does not explain long segments, shape (k, n).

    Noise hides over short segments what is missing, but not what that does to the values: these
    change with the length. Of two encoders the deflection tells how much it is.
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


def _if_possible(job: Job) -> Answer | None:
    """The fit with disturbances; None where it leads nowhere."""
    try:
        return _disturbed(job)
    except ConvergenceError:
        return None


def _disturbed(job: Job) -> Answer:
    """The fit with disturbances."""
    # Late: a log that its model explains needs none of their five modules.
    from flexid.identification.estimation.disturbed import fit_disturbed, fit_disturbed_to, follower
    from flexid.identification.estimation.disturbed_estimate import disturbed_estimate

    job.progress("what disturbs the drive")
    training, whole = job.training, job.whole
    holds = job.holds if job.joint.kind == "link" else (MEASURED_HOLD, "zero")
    fitted = fit_disturbed(
        job.structure,
        training,
        job.kept,
        holds,
        job.thresholds,
        with_play=job.settings.terms == "auto" and job.joint.kind != "rigid",
    )
    undisturbed = _undisturbed(fitted.fitted, training)
    follow = follower(fitted, whole)
    validation = validate(undisturbed, whole, job.recordings.starts, follow=follow)
    retreat: tuple[str, ...] = ()
    try:
        refitted = fit_disturbed_to(fitted, whole)
    except ConvergenceError:
        refitted, whole, retreat = fitted, training, (RETREAT,)
    fits = _fits(refitted, retreat, job)
    # Every drive has friction; what no term describes may hide it.
    hidden = hidden_covariance(fits, certain=DISSIPATIVE)
    estimate, widest = disturbed_estimate(refitted, whole, job.input_unit, hidden)
    disturbances = Disturbances(refitted.shares, refitted.fitted.data.samples[0].sample_time)
    found = Answer(fits, validation, estimate, disturbances, refitted.cost, widest)
    return _judged(found, undisturbed, job)


def _judged(found: Answer, fitted: Fitted, job: Job) -> Answer:
    """An answer that does not explain the log, with what speaks against its stiffness."""
    if job.joint.kind == "rigid":
        return found
    period, predicted = _over_a_period(fitted, job)
    share = f"{max(predicted, 0.0):.0f} %"
    if np.isnan(predicted):
        share = "an unknown part (no recording is long enough)"
    prediction = (
        f"of which the spring predicts {share} over {period:.2g} s, a period of the resonance"
    )
    found = replace(found, prediction=prediction)
    skewed = _skewed(job, found.fits.reported.data, entirely=False)
    if skewed or predicted >= PREDICTED:
        return replace(found, doubts=skewed)
    shares = {} if found.disturbances is None else found.disturbances.shares
    doubted = {c for c in POSITIVE if shares.get(balance_of(c), 1.0) > UNEXPLAINED}
    if not doubted:
        return found
    what = "joint" if doubted == POSITIVE else balance_of(min(doubted))
    doubt = weak_spring(f"this {what}", f"{period:.2g} s, a period", share, _whole_drive(job))
    return replace(found, doubts=(doubt,), doubted=frozenset(doubted))


def weak_spring(what: str, period: str, share: str, otherwise: str = "") -> Caution:
    """That a spring predicts too little of the deflection to be one."""
    return Caution(
        f"more moves {what} than the model has: over {period} of the resonance, its spring "
        f"predicts {share} of the deflection; look for other axes, loads and backlash{otherwise}",
        Rank.MODEL,
    )


def _over_a_period(fitted: Fitted, job: Job) -> tuple[float, float]:
    """Period of the resonance in s, and per cent of the deflection that is predicted over it.

    It begins from the state that fits the period before: what acts besides the spring shifts a
    state that has to fit many.
    """
    whole, starts = job.whole, job.recordings.starts
    period = float(whole.periods(np.array(resonance(fitted.by_name))))
    found = validate(fitted, whole, starts, horizons=(period,), warm_up=period).horizons
    return period, found[period].get("deflection", np.nan) if found else np.nan


def _skewed(job: Job, data: Data, *, entirely: bool) -> tuple[Caution, ...]:
    """That a delay makes the deflection: most of it, or, `entirely`, all but noise."""
    # A delay of a deflection's sensor shifts the deflection, and makes none.
    if job.joint.kind == "rigid" or job.settings.link_delay != "auto" or job.deflection:
        return ()
    found = skew(job.joint, data)
    if not found.makes_the_deflection or (entirely and found.excess > NEARLY_NOISE):
        return ()
    return (
        Caution(
            f"{100.0 * found.explained:.0f} % of the deflection is a delay of "
            f"{1e3 * abs(found.delay):.2g} ms between the encoders, and no spring: align their "
            f"clocks, then excite the joint harder{_whole_drive(job)}",
            Rank.SCALE,
        ),
    )


def _whole_drive(job: Job) -> str:
    """What a log without a stiffness knows all the same, if an input drives it."""
    if job.joint.kind == "link":
        return ""
    return "; `--model rigid` reports the inertia and friction of the whole drive"


def _undisturbed(fitted: Fitted, data: Data) -> Fitted:
    """The values of a fit in a motion that nothing corrects, of data as they were logged."""
    segments = lengths(data)[-1]
    problem, _ = motion_at(fitted.ended, data, segments, fitted.by_name, None)
    return replace(fitted, problem=problem, data=data)


def _fits(found: "Disturbed", retreat: tuple[str, ...], job: Job) -> FinalFits:
    """The fit as all fits are reported."""
    fitted, full = found.fitted, found.full
    by_length = FitsByLength((), (), True, tuple(job.holds), _BY_DISTURBANCES)
    choice = Choice(full.structure, fitted.structure, fitted, found.terms, (), by_length)
    rate = suited_rate(fitted, job.settings.filter_rate)
    nothing = ModelError(0.0, 0.0, 0.0)
    return FinalFits(
        choice,
        job.recordings,
        fitted,
        (fitted,),
        retreat,
        nothing,
        frozenset(),
        full,
        rate,
    )
