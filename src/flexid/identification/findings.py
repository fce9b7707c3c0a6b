"""What least squares of all data says about the model: the evidence for the verdicts."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexid.analysis.excitation import Excitation, excitation_of_gram
from flexid.estimators.prediction_error import PredictionErrorFit
from flexid.estimators.rowwise import RowSums
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.candidate import Candidate, Fitted
from flexid.identification.estimates import estimator_shifts, filter_shifts, row_evidence
from flexid.identification.intervals import Fitted as IntervalFit
from flexid.identification.preparation import Pieces
from flexid.identification.residuals import residual_excess
from flexid.identification.verdict import Evidence

# Other filter rates at which a right model gives the same answer. Slower ones see another part of
# the motion and hardly any noise; beyond twice the rate noise in the regressors biases the answer.
_RATE_FACTORS = (0.125, 0.25, 0.5, 2.0)


@dataclass(frozen=True)
class Findings:
    """Least squares of all data and the evidence from it.

    Parameters
    ----------
    start : LeastSquaresFit
        Of the same unknowns as what is reported.
    excitation : mapping of str to Excitation
        By row.
    residual_excess : mapping of str to float
        By row.
    evidence : mapping of str to Evidence
        By coefficient.
    """

    start: LeastSquaresFit
    excitation: Mapping[str, Excitation]
    residual_excess: Mapping[str, float]
    evidence: Mapping[str, Evidence]


def findings(
    candidate: Candidate,
    pieces: Pieces,
    reported: Fitted[LeastSquaresFit] | Fitted[PredictionErrorFit],
    judged: IntervalFit,
    known: Collection[str],
    segment_shifts: Mapping[str, float],
    fit_percent: Mapping[str, float],
    deflection_doubt: float,
) -> Findings:
    """Collect the evidence.

    Parameters
    ----------
    candidate : Candidate
        What was fitted.
    pieces : Pieces
        To all of these.
    reported : Fitted
        The fit that is reported.
    judged : Fitted
        The same with all that widens its intervals, and what is known joined to it.
    known : collection of str
        Coefficients known beforehand with an uncertainty: nothing is confounded with these.
    segment_shifts : mapping of str to float
        How far coefficients move with the length of the segments, beyond noise.
    fit_percent : mapping of str to float
        Of the free run, by channel.
    deflection_doubt : float
        Share of the deflection that another delay between the encoders could make.
    """
    # What ended at a bound is fixed there for least squares too, so that the unknowns agree.
    same = replace(candidate, fixed={**candidate.fixed, **reported.at_bound}, bounds={})
    start = same.least_squares(pieces.whole, pieces.groups).fit
    excitation = {row.name: row_excitation(row, ()) for row in start.rows if row.coefficients}
    excess = residual_excess(start, reported.unknowns, candidate.samples(pieces.whole))
    if candidate.segment_duration == 0:
        shifts = rate_shifts(same, pieces, start)
    else:
        between = estimator_shifts(reported.fit, start)
        shifts = {c: max(between[c], _of(c, segment_shifts)) for c in between}
    of_rows = excess
    if candidate.segment_duration > 0:
        # Prediction error couples the rows: what one lacks is made up for by the others too.
        of_rows = dict.fromkeys(excess, max(excess.values()))
    evidence = row_evidence(
        judged,
        start,
        shifts,
        of_rows,
        {row.name: row_excitation(row, known) for row in start.rows if row.coefficients},
        fit_percent,
        deflection_doubt,
    )
    return Findings(start, excitation, excess, evidence)


def rate_shifts(candidate: Candidate, pieces: Pieces, fit: LeastSquaresFit) -> dict[str, float]:
    """How far a candidate's least squares of some pieces moves with the filter rate.

    Beyond noise, as of `filter_shifts`.
    """
    others = [
        replace(candidate, filter_rate=factor * candidate.filter_rate)
        .least_squares(pieces.whole, pieces.groups)
        .fit
        for factor in _RATE_FACTORS
    ]
    return filter_shifts(fit, others)


def row_excitation(row: RowSums, known: Collection[str]) -> Excitation:
    """Excitation of a row beside what is known of it."""
    sought = [place for place, name in enumerate(row.coefficients) if name not in known]
    if not sought:
        return Excitation(row.name, (), np.ones(1), 0.0, (), np.empty(0), 0.0, ())
    names = [row.coefficients[place] for place in sought]
    return excitation_of_gram(row.name, names, row.gram[np.ix_(sought, sought)] / row.count)


def _of(name: str, shifts: Mapping[str, float]) -> float:
    """Shift of a coefficient; choices that looked at one log alone know it without its number."""
    return shifts.get(name, shifts.get(name.partition("[")[0], 0.0))
