"""Which terms a log shows: chosen by what they do to the free run over held-out data.

Terms are added one at a time. Least squares says which candidates promise most; the best of them
are fitted in full and run freely over data that the fit has not seen, and the one that repeats it
best stays, if it repeats it better than the model without. A friction that feeds energy in stands
for something else and is no candidate. In the end each term is left out once: what the others can
replace goes again.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.estimators.stopping_time import find_stopping_time, fit_stopping_time
from flexid.identification.candidate import Candidate, Trial, attempt
from flexid.identification.joint import SMOOTHED_FRICTION, flexible
from flexid.identification.preparation import Pieces
from flexid.identification.result import TermEvidence
from flexid.identification.settings import Auto
from flexid.identification.verdict import DISSIPATIVE, NEGATIVE_DEVIATIONS
from flexid.models.flexible_joint import STOPPING
from flexid.models.flexible_joint import with_stopping_time as about_stopping_time
from flexid.recording.recording import Recording

WORTH = 0.005
"""Part of the free run's error that a term has to save."""

_OBVIOUS = 0.2  # part of the error that a term saves which even least squares shows
_TRIED = 3  # of the most promising candidates in each round
_WIDTHS = (0.3, 0.03, 0.01, 0.003)  # rad/s, smoothings of Coulomb friction beside the usual one
_STOPPING_DURATION = 0.5  # s, segments while the stopping time is sought

Progress = Callable[[str], None]
Cuts = Sequence[Pieces]


def choose_terms(
    candidate: Candidate, cuts: Cuts, progress: Progress
) -> tuple[Trial, tuple[TermEvidence, ...]]:
    """Add terms of a joint while they pay.

    Parameters
    ----------
    candidate : Candidate
        With the terms to begin with, which stay.
    cuts : sequence of Pieces
        Fitted parts and ends that none of the final tests uses.
    progress : callable
        Told of each step in words.

    Returns
    -------
    best : Trial
        With the terms that were chosen.
    evidence : tuple of TermEvidence
        For the last terms that were tried and not chosen.
    """
    # The terms that matter most show in least squares, which is faster by far.
    best = attempt(replace(candidate, segment_duration=0.0), cuts)
    best, _ = _grown(best, cuts, progress, _OBVIOUS)
    best = attempt(replace(candidate, terms=best.candidate.terms), cuts)
    best, rejected = _grown(best, cuts, progress, WORTH)
    others = (
        TermEvidence(term, False, trial.error, best.error)
        for trial in rejected
        for term in trial.candidate.terms
        if term not in best.candidate.terms
    )
    return best, tuple(others)


def choose_coulomb_velocity(best: Trial, cuts: Cuts, progress: Progress) -> Trial:
    """Try other smoothings of Coulomb friction, if there is any, and take the best."""
    if not SMOOTHED_FRICTION & set(best.candidate.terms):
        return best
    usual = best.error
    for width in _WIDTHS:
        progress(f"Coulomb friction smoothed over {width:g} rad/s")
        joint = best.candidate.joint.with_coulomb_velocity(width)
        trial = attempt(replace(best.candidate, joint=joint), cuts)
        if trial.error < min(best.error, usual * (1 - WORTH)):
            best = trial
    return best


def _grown(best: Trial, cuts: Cuts, progress: Progress, worth: float) -> tuple[Trial, list[Trial]]:
    """Add terms while they pay; and the last trials, of terms that did not."""
    while True:
        progress(f"terms: {', '.join(best.candidate.terms) or 'spring alone'}")
        trials = [attempt(c, cuts, best.error) for c in _most_promising(best, cuts)]
        possible = [trial for trial in trials if not _feeds_energy(trial)]
        better = min(possible, key=lambda trial: trial.error, default=best)
        if not better.error < best.error * (1 - worth):
            return best, trials
        best = better


def choose_stiction(
    best: Trial, cuts: Cuts, stopping_time: float | Auto, progress: Progress
) -> Trial:
    """Try friction that holds the motor at rest in the place of Coulomb friction, if there is any.

    Its stopping time, if it is not given, is found on the fitted data.
    """
    if "motor_coulomb" not in best.candidate.terms:
        return best
    progress("friction that holds the motor at rest")
    try:
        trial = attempt(with_stiction(best, cuts, stopping_time), cuts)
    except ConvergenceError:
        return best
    return trial if trial.error < best.error * (1 - WORTH) else best


def with_stiction(best: Trial, cuts: Cuts, stopping_time: float | Auto) -> Candidate:
    """A candidate with ``motor_stiction`` in the place of ``motor_coulomb``.

    With a given stopping time alpha_holding, which stands for the uncertainty of that, is fixed.

    Raises
    ------
    ConvergenceError
        If no stopping time explains the log.
    """
    candidate, pieces = best.candidate, cuts[0]
    joint = flexible("motor_stiction")
    terms = {*candidate.terms, "motor_stiction"} - {"motor_coulomb"}
    held = _with_terms(replace(candidate, joint=joint), tuple(terms))
    values = best.fitted.coefficients(len(pieces.recorded))[0]
    nominal = dict(zip(candidate.joint.system.coefficients, values.tolist(), strict=True))
    if stopping_time != "auto":
        system = about_stopping_time(joint.system, stopping_time, nominal)
        fixed = {**held.fixed, "alpha_holding": 0.0}
        return replace(held, joint=replace(joint, system=system), fixed=fixed)
    system, _ = find_stopping_time(
        held.samples(pieces.fitted),
        joint.system,
        nominal,
        held.filter_rate,
        held.hold,
        held.unknowns(pieces.groups),
    )
    held = replace(held, joint=replace(joint, system=system))
    return with_stopping_time(held, pieces.fitted, pieces.groups)


def with_stopping_time(
    candidate: Candidate, recordings: Sequence[Recording], groups: Sequence[int]
) -> Candidate:
    """The same with the stopping time of its friction, if one is sought, fitted to some data.

    Raises
    ------
    ConvergenceError
        If prediction error leads away from what was found before.
    """
    if "motor_stiction" not in candidate.terms or "alpha_holding" in candidate.fixed:
        return candidate
    start = candidate.least_squares(recordings, groups)
    system, fit = fit_stopping_time(
        candidate.samples(recordings),
        candidate.joint.system,
        start.fit,
        _STOPPING_DURATION,
        candidate.hold,
        start.unknowns,
    )
    # The motor's acceleration without friction, too, is that of the better fit.
    values = start.unknowns.coefficients(fit.values, 0).tolist()
    nominal = dict(zip(system.coefficients, values, strict=True))
    system = about_stopping_time(system, system.constants[STOPPING], nominal)
    return replace(candidate, joint=replace(candidate.joint, system=system))


def _with_terms(candidate: Candidate, terms: Sequence[str]) -> Candidate:
    ordered = tuple(term for term in candidate.joint.terms if term in terms)
    return replace(candidate, terms=ordered)


def _most_promising(best: Trial, cuts: Cuts) -> list[Candidate]:
    """The candidates with one more term whose least squares leaves the least residual."""
    candidate, cut = best.candidate, cuts[0]
    all_terms = replace(candidate, terms=tuple(candidate.joint.terms))
    every = all_terms.least_squares(cut.fitted, cut.groups).fit
    larger = [
        _with_terms(candidate, (*candidate.terms, term))
        for term in candidate.joint.terms
        if term not in candidate.terms
    ]
    return sorted(larger, key=lambda c: _misfit(every, c.unknowns(cut.groups).names))[:_TRIED]


def _misfit(fit: LeastSquaresFit, names: Collection[str]) -> float:
    """Log of the residuals of least squares if only some names were sought, summed over the rows.

    What the others save follows from the normal equations of all, so that nothing is fitted anew.
    """
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    misfit = 0.0
    for row in fit.rows:
        kept = np.array([name in names for name in row.coefficients], dtype=np.bool_)
        others = np.array([values[name] for name in row.coefficients if name not in names])
        shared = row.gram[np.ix_(kept, ~kept)]
        scale = np.sqrt(np.diag(row.gram)[kept])
        inverse, _ = scaled_inverse(row.gram[np.ix_(kept, kept)], np.where(scale > 0, scale, 1.0))
        alone = row.gram[np.ix_(~kept, ~kept)] - shared.T @ inverse @ shared
        saved = max(float(others @ alone @ others), 0.0)
        misfit += float(np.log(max(row.residual_sum + saved, np.finfo(float).tiny)))
    return misfit


def _feeds_energy(trial: Trial) -> bool:
    """Whether a friction or damping came out negative beyond its uncertainty."""
    fit = trial.fitted.fit
    deviations = np.sqrt(np.diag(fit.covariance))
    return any(
        name in DISSIPATIVE and value < -NEGATIVE_DEVIATIONS * deviation
        for name, value, deviation in zip(fit.names, fit.values, deviations, strict=True)
    )


def without_idle_terms(
    best: Trial, given: Sequence[str], cuts: Cuts, progress: Progress
) -> tuple[Trial, tuple[TermEvidence, ...]]:
    """Drop, one by one, terms whose absence costs nothing; and say what each of the others saves.

    Terms in `given` stay.
    """
    while True:
        progress("terms: leaving out each in turn")
        terms = best.candidate.terms
        fewer = {
            term: attempt(
                _with_terms(best.candidate, [t for t in terms if t != term]), cuts, best.error
            )
            for term in terms
            if term not in given
        }
        idle = min(fewer.values(), key=lambda trial: trial.error, default=best)
        if idle is best or idle.error * (1 - WORTH) >= best.error:
            break
        best = idle
    evidence = (TermEvidence(t, True, best.error, trial.error) for t, trial in fewer.items())
    return best, tuple(sorted(evidence, key=lambda e: -e.without_term))
