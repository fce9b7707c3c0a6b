"""A candidate: a model with the choices made about it, which can be fitted and tried."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexid.errors import ConvergenceError
from flexid.estimators.bounded import Bounds, bounded_fit
from flexid.estimators.filter_rate import choose_filter_rate
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.joint import DRY_FRICTION, Joint
from flexid.identification.preparation import Pieces
from flexid.identification.validation import free_run_error
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold, Recording

FloatArray = NDArray[np.float64]

AnyFit = TypeVar("AnyFit", LeastSquaresFit, PredictionErrorFit)

_BEHIND = 3.0  # times the best error so far, from which on a candidate is out of the running


@dataclass(frozen=True)
class Fitted(Generic[AnyFit]):
    """A fit with what was sought.

    Parameters
    ----------
    fit : LeastSquaresFit or PredictionErrorFit
        What an estimator returned.
    unknowns : Unknowns
        What it sought: less than the candidate's where some ended at their bounds.
    at_bound : mapping of str to float
        Those, with the bound.
    """

    fit: AnyFit
    unknowns: Unknowns
    at_bound: Mapping[str, float]

    def coefficients(self, n_pieces: int) -> list[FloatArray]:
        """All coefficients of the system, piece by piece."""
        return [self.unknowns.coefficients(self.fit.values, piece) for piece in range(n_pieces)]


@dataclass(frozen=True)
class Candidate:
    """A model and how it is to be fitted.

    Parameters
    ----------
    joint : Joint
        Flexible or rigid, with its smoothing of Coulomb friction.
    terms : tuple of str
        Terms that are on.
    hold : {"zero", "linear"}
        Behaviour of the input between samples.
    filter_rate : float
        λ of least squares in 1/s.
    segment_duration : float
        Length of the segments of the prediction error in s; 0 for least squares alone.
    fixed : mapping of str to float, optional
        Coefficients whose value is given.
    bounds : mapping of str to tuple of float, optional
        Coefficients that are to stay within bounds.
    """

    joint: Joint
    terms: tuple[str, ...]
    hold: Hold
    filter_rate: float
    segment_duration: float
    fixed: Mapping[str, float] = field(default_factory=dict)
    bounds: Bounds = field(default_factory=dict)

    @property
    def system(self) -> ParametricSystem:
        """The model as it is computed.

        Friction that is off gets an infinite width: of its kernel's time, half a free run's goes
        into hyperbolic tangents, and that of zero is free.
        """
        if DRY_FRICTION & set(self.terms):
            return self.joint.system
        return self.joint.with_coulomb_velocity(np.inf).system

    def unknowns(self, groups: Sequence[int]) -> Unknowns:
        """What is sought in pieces from the given logs."""
        return self.joint.unknowns(self.terms, self.fixed, groups)

    def samples(self, recordings: Sequence[Recording]) -> list[Samples]:
        """Pieces as the estimators take them."""
        return [self.joint.samples(recording) for recording in recordings]

    def least_squares(
        self, recordings: Sequence[Recording], groups: Sequence[int]
    ) -> Fitted[LeastSquaresFit]:
        """Least squares at this candidate's filter rate."""
        samples = self.samples(recordings)
        return self._fitted(groups, lambda unknowns: self._start(samples, unknowns))

    def prediction_error(
        self,
        recordings: Sequence[Recording],
        groups: Sequence[int],
        known_start: Fitted[LeastSquaresFit] | None = None,
    ) -> Fitted[PredictionErrorFit]:
        """Prediction error at this candidate's segment length, started from least squares.

        Parameters
        ----------
        recordings : sequence of Recording
            Pieces.
        groups : sequence of int
            The log of each.
        known_start : Fitted, optional
            This candidate's least squares of the same, if it has been computed.

        Raises
        ------
        ConvergenceError
            If it does not converge, or where least squares contradicts it.
        """
        samples = self.samples(recordings)

        def fit_with(unknowns: Unknowns) -> PredictionErrorFit:
            if known_start is not None and known_start.unknowns == unknowns:
                start = known_start.fit
            else:  # some coefficients are at their bounds
                start = self._start(samples, unknowns)
            return prediction_error(
                samples, self.system, start, self.segment_duration, self.hold, unknowns=unknowns
            )

        return self._fitted(groups, fit_with)

    def with_own_filter_rate(self, pieces: Pieces) -> "Candidate":
        """The same with the filter rate that suits the fitted parts of some pieces."""
        rate = choose_filter_rate(
            self.samples(pieces.fitted),
            self.system,
            self.hold,
            self.unknowns(pieces.groups),
        )
        return replace(self, filter_rate=rate)

    def _start(self, samples: Sequence[Samples], unknowns: Unknowns) -> LeastSquaresFit:
        return filtered_least_squares(samples, self.system, self.filter_rate, self.hold, unknowns)

    def _fitted(
        self, groups: Sequence[int], fit_with: Callable[[Unknowns], AnyFit]
    ) -> Fitted[AnyFit]:
        unknowns = self.unknowns(groups)
        fit, at_bound = bounded_fit(fit_with, unknowns, self.active_bounds())
        return Fitted(fit, unknowns.fixing(at_bound), at_bound)

    def active_bounds(self) -> Bounds:
        """Bounds of the coefficients whose terms are on."""
        off = {c for t, names in self.joint.terms.items() if t not in self.terms for c in names}
        return {c: bound for c, bound in self.bounds.items() if c not in off}


@dataclass(frozen=True)
class Trial:
    """A candidate fitted to the first parts of some pieces and run freely over their ends.

    Parameters
    ----------
    candidate : Candidate
        What was tried.
    error : float
        Error of the free runs relative to the motion, mean over the channels and the cuts.
    start : Fitted
        Least squares, at the first cut.
    finish : Fitted or None
        Prediction error there; None where it did not converge or was not asked for.
    """

    candidate: Candidate
    error: float
    start: Fitted[LeastSquaresFit]
    finish: Fitted[PredictionErrorFit] | None

    @property
    def fitted(self) -> Fitted[LeastSquaresFit] | Fitted[PredictionErrorFit]:
        """The finish, or the start where there is none."""
        return self.finish or self.start


def attempt(candidate: Candidate, cuts: Sequence[Pieces], rival: float = np.inf) -> Trial:
    """Fit a candidate and see how well it repeats what was held out.

    Parameters
    ----------
    candidate : Candidate
        What to try.
    cuts : sequence of Pieces
        The same pieces, cut differently into a part to fit and an end for the free runs. The first
        cut gives the fits.
    rival : float, optional
        Error of the best so far. A model whose least squares is far behind it is wrong, and
        prediction error, which takes long to say so, is spared.
    """
    starts = [candidate.least_squares(cut.fitted, cut.groups) for cut in cuts]
    start_error = np.inf
    if candidate.segment_duration == 0 or np.isfinite(rival):
        start_error = _error(candidate, cuts, starts)
    if candidate.segment_duration > 0 and not start_error > _BEHIND * rival:
        try:
            finishes = [
                candidate.prediction_error(cut.fitted, cut.groups, start)
                for cut, start in zip(cuts, starts, strict=True)
            ]
            return Trial(candidate, _error(candidate, cuts, finishes), starts[0], finishes[0])
        except ConvergenceError:  # least squares stands in
            start_error = _error(candidate, cuts, starts)
    return Trial(candidate, start_error, starts[0], None)


def _error(
    candidate: Candidate,
    cuts: Sequence[Pieces],
    fits: Sequence[Fitted[LeastSquaresFit]] | Sequence[Fitted[PredictionErrorFit]],
) -> float:
    """Mean over the cuts of the free runs' error."""
    joint = replace(candidate.joint, system=candidate.system)
    errors = [
        free_run_error(joint, cut, fitted.coefficients(len(cut.recorded)), candidate.hold)
        for cut, fitted in zip(cuts, fits, strict=True)
    ]
    return float(np.mean(errors))
