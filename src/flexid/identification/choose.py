"""What is chosen for the user: terms, smoothing of friction, filter rate, segments, estimator.

Nothing here sees the data that the final free run is tested on: the part before it is cut again,
into one part to fit and one to choose by.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from flexid.identification.alignment import Alignment
from flexid.identification.candidate import Candidate, Trial, attempt
from flexid.identification.joint import Joint
from flexid.identification.preparation import Pieces
from flexid.identification.result import SegmentEvidence, TermEvidence
from flexid.identification.segment_choice import (
    DURATIONS,
    best_segments,
    segment_evidence,
    segment_shifts,
    try_segments,
)
from flexid.identification.settings import Settings
from flexid.identification.term_choice import (
    choose_coulomb_velocity,
    choose_stiction,
    choose_terms,
    with_stiction,
    without_idle_terms,
)

_CHOICE_SHARES = (1 / 3, 1 / 2)  # of the fitted data that choices are tested on
_MANY_SAMPLES = 10_000  # from which on one cut is enough: short records say little at each
_MOST_SAMPLES = 40_000  # that choices look at; more change no choice
_FIRST_DURATION = 2.0  # s, segments while terms are chosen
_FIRST_RATE = 20.0  # 1/s, until one is chosen

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Choice:
    """The candidate to fit, and how it was found.

    Parameters
    ----------
    candidate : Candidate
        With everything chosen.
    terms : tuple of TermEvidence
        What each term buys.
    segments : tuple of SegmentEvidence
        What each length of the segments gives.
    shifts : mapping of str to float
        How far each coefficient moves with the length of the segments, beyond noise.
    error : float
        Error of the free run over the data to choose by.
    """

    candidate: Candidate
    terms: tuple[TermEvidence, ...]
    segments: tuple[SegmentEvidence, ...]
    shifts: Mapping[str, float]
    error: float


def choose(
    joint: Joint,
    pieces: Pieces,
    alignment: Alignment,
    fixed: Mapping[str, float],
    settings: Settings,
    progress: Progress,
) -> Choice:
    """Choose what the settings leave open.

    Parameters
    ----------
    joint : Joint
        Flexible or rigid.
    pieces : Pieces
        Aligned; their held-out ends are not looked at.
    alignment : Alignment
        Hold of the input.
    fixed : mapping of str to float
        Coefficients whose value is given.
    settings : Settings
        What is not ``auto`` stays.
    progress : callable
        Told of each step in words.
    """
    cuts = [pieces.inner(share, _MOST_SAMPLES) for share in _CHOICE_SHARES]
    if sum(map(len, cuts[0].recorded)) > _MANY_SAMPLES:
        cuts = cuts[:1]
    if settings.coulomb_velocity != "auto":
        joint = joint.with_coulomb_velocity(settings.coulomb_velocity)
    candidate = Candidate(
        joint,
        tuple(joint.terms) if settings.terms == "auto" else _first_terms(settings.terms),
        alignment.hold,
        _FIRST_RATE if settings.filter_rate == "auto" else settings.filter_rate,
        _first_duration(settings),
        fixed,
        settings.bounds,
    )
    if settings.filter_rate == "auto":
        progress("filter rate")
        candidate = candidate.with_own_filter_rate(cuts[0])
    best, terms = _with_terms(candidate, cuts, settings, progress)
    trials = try_segments(best, cuts, _durations(settings), progress)
    chosen = _wanted(trials, settings)
    final = replace(best.candidate, segment_duration=chosen.candidate.segment_duration)
    if settings.filter_rate == "auto":
        final = final.with_own_filter_rate(pieces)
    shifts = segment_shifts(chosen, trials)
    return Choice(final, terms, segment_evidence(trials), shifts, chosen.error)


def _with_terms(
    candidate: Candidate, cuts: Sequence[Pieces], settings: Settings, progress: Progress
) -> tuple[Trial, tuple[TermEvidence, ...]]:
    if settings.terms != "auto":
        best = attempt(candidate, cuts)
        if "motor_stiction" in settings.terms:
            best = attempt(with_stiction(best, cuts, settings.stopping_time), cuts)
        elif settings.coulomb_velocity == "auto":
            best = choose_coulomb_velocity(best, cuts, progress)
        return best, ()
    given = candidate.joint.terms_with({*settings.known, *settings.bounds})
    best, rejected = choose_terms(replace(candidate, terms=given), cuts, progress)
    if settings.coulomb_velocity == "auto":
        best = choose_coulomb_velocity(best, cuts, progress)
        best = choose_stiction(best, cuts, settings.stopping_time, progress)
    best, kept = without_idle_terms(best, given, cuts, progress)
    return best, (*kept, *rejected)


def _first_terms(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Terms to begin with: stiction is found from Coulomb friction."""
    others = [term for term in terms if term not in ("motor_coulomb", "motor_stiction")]
    return (*others, "motor_coulomb") if len(others) < len(terms) else terms


def _first_duration(settings: Settings) -> float:
    if settings.estimator == "least-squares":
        return 0.0
    return _FIRST_DURATION if settings.segment_duration == "auto" else settings.segment_duration


def _durations(settings: Settings) -> tuple[float, ...]:
    if settings.estimator == "least-squares":
        return ()
    return DURATIONS if settings.segment_duration == "auto" else (settings.segment_duration,)


def _wanted(trials: list[Trial], settings: Settings) -> Trial:
    """The trial to follow; prediction error, converged or not, if the user wants it."""
    if settings.estimator != "prediction-error" and settings.segment_duration == "auto":
        return best_segments(trials)
    converged = [trial for trial in trials if trial.finish is not None]
    return best_segments(converged) if converged else trials[-1]
