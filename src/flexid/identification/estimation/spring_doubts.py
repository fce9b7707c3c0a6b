"""Doubts that the deflection is a spring's: it may be moved by other effects, or by a delay."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import NamedTuple

import numpy as np

from flexid.estimators.prediction_error import NEARLY_NOISE
from flexid.identification.full_model.model import Data, Fitted
from flexid.identification.structure.job import Job
from flexid.identification.structure.link_delay import skew
from flexid.identification.structure.validation import validate
from flexid.identification.vocabulary.evidence import balance_of
from flexid.models.flexible_joint import POSITIVE, resonance
from flexid.recording.recording import Caution, Rank

PREDICTED = 25.0  # least per cent of the deflection that a spring predicts; noise alone gives 0
UNEXPLAINED = 0.1  # share of a balance's acceleration; with less unexplained, the spring is real


class SpringDoubts(NamedTuple):
    """How well the spring predicts the deflection, and doubts about it."""

    prediction: str  # text on how well the spring predicts the deflection
    doubts: tuple[Caution, ...] = ()  # reasons why coefficients are unknown
    doubted: frozenset[str] = frozenset()  # the unknown coefficients, of one balance or both


def doubts_of_spring(
    fitted: Fitted, data: Data, shares: Mapping[str, float], job: Job
) -> SpringDoubts:
    """Return doubts about the spring of a fit that does not explain its log.

    `fitted` is the fit in a motion without observer, and `data` what the reported fit used.
    `shares` are the unexplained shares of the balances.
    """
    period, predicted = _over_a_period(fitted, job)
    share = f"{max(predicted, 0.0):.0f} %"
    if np.isnan(predicted):
        share = "an unknown part (no recording is long enough)"
    prediction = (
        f"of which the spring predicts {share} over {period:.2g} s, a period of the resonance"
    )
    skewed = delay_doubts(job, data, entirely=False)
    if skewed:
        return SpringDoubts(prediction, skewed, POSITIVE)
    if predicted >= PREDICTED:
        return SpringDoubts(prediction)
    doubted = frozenset(c for c in POSITIVE if shares.get(balance_of(c), 1.0) > UNEXPLAINED)
    if not doubted:
        return SpringDoubts(prediction)
    what = "joint" if doubted == POSITIVE else balance_of(min(doubted))
    doubt = weak_spring(f"this {what}", f"{period:.2g} s, a period", share)
    return SpringDoubts(prediction, (doubt,), doubted)


def weak_spring(what: str, period: str, share: str) -> Caution:
    """Return the warning about a spring that predicts too little of the deflection."""
    return Caution(
        f"effects outside the model move {what}: over {period} of the resonance, its spring "
        f"predicts {share} of the deflection; look for other axes, loads and backlash",
        Rank.MODEL,
    )


def _over_a_period(fitted: Fitted, job: Job) -> tuple[float, float]:
    """Return the resonance's period in s, and the per cent of the deflection predicted over it."""
    # A prediction begins from the state that fits one period before. A state that fits more periods
    # would be shifted by disturbances.
    whole, ends = job.whole, job.recordings.starts
    period = float(whole.periods(np.array(resonance(fitted.by_name))))

    def predicted_after(starts: Sequence[int]) -> float:
        found = validate(fitted, whole, starts, horizons=(period,), warm_up=period).horizons
        return found[period].get("deflection", np.nan) if found else np.nan

    predicted = predicted_after(ends)
    if np.isnan(predicted):  # the motion may have died out before the held-out end
        starts = (ceil(period / own.sample_time) for own in whole.samples)
        predicted = predicted_after([*map(min, starts, ends)])
    return period, predicted


def delay_doubts(job: Job, data: Data, *, entirely: bool) -> tuple[Caution, ...]:
    """Return the warning that a delay causes the deflection, or, `entirely`, all but noise."""
    # A delay of a deflection's sensor only shifts the deflection.
    if job.joint.kind == "rigid" or job.settings.link_delay != "auto" or job.deflection:
        return ()
    found = skew(job.joint, data)
    if not found.makes_the_deflection or (entirely and found.excess > NEARLY_NOISE):
        return ()
    return (
        Caution(
            f"{100.0 * found.explained:.0f} % of the deflection is a delay of "
            f"{1e3 * abs(found.delay):.2g} ms between the encoders, and no spring: align their "
            f"clocks, then excite the joint harder",
            Rank.SCALE,
        ),
    )
