"""Segmented prediction error: the model's own motion, fitted to the measured one.

The record is cut into segments. Each starts from an initial state of its own, which is unknown;
from there the model runs freely under the recorded input, and coefficients and initial states are
sought for which all the motions come closest to the measured positions. With white noise this is
maximum likelihood. It needs starting values, which least squares gives, and is checked against it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.cluster_covariance import cluster_influences, covariance_of
from flexid.estimators.gauss_newton import Minimum, minimise, output_weights, refinement
from flexid.estimators.rowwise import LeastSquaresFit
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, SegmentedMotion, segmented_motion
from flexid.estimators.segments import divide
from flexid.estimators.unknowns import Unknowns, unknowns_of
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.recording.velocities import position_noise

_COARSE, _FINE = 1.0, 1e-2  # length of a step, in standard deviations, that ends the iteration
_AGREEMENT = 10.0  # standard deviations of least squares within which an estimate may end
_SLACK = 1.0  # and this part of the value besides, for what the model leaves out
_EFFECT = 0.05  # and this part of the row's acceleration, for coefficients that are about zero


@dataclass(frozen=True, eq=False)
class PredictionErrorFit:
    """Coefficients fitted by segmented prediction error. Only converged fits are returned."""

    names: tuple[str, ...]  # what is sought, row by row
    values: FloatArray  # (k,): in the system's units
    # (k, k): from the spread of the scores of blocks of a second or less; right for correlated
    # residuals too. Infinite variance marks what the data leave free, or what one block decides
    covariance: FloatArray
    degrees_of_freedom: tuple[float, ...]  # of each variance, for Student's t; 0 for none
    # (k, k): what residuals of the size `noise` say, the initial states unknown
    information: FloatArray
    noise: FloatArray  # (n_outputs,): standard deviation of the residuals
    residuals: FloatArray  # (n_samples, n_outputs): measured less fitted, all segments in turn

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))


def prediction_error(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    start: LeastSquaresFit,
    segment_duration: float = 1.0,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> PredictionErrorFit:
    """Fit the model's free motion over segments to measured positions.

    Parameters
    ----------
    recordings : sequence of Samples
        One or more contiguous recordings of motion.
    system : ParametricSystem
        The model; its constants have the values declared in it.
    start : LeastSquaresFit
        Least squares of the same record: where to start, and what to end near.
    segment_duration : float, optional
        Wanted length of a segment in s. Longer segments hold more information and forgive
        less: what the model leaves out adds up over a segment.
    hold : {"linear", "zero", "cubic"}, optional
        Whether the inputs run linearly between samples, are constant until the next one, or smooth.
    unknowns : Unknowns, optional
        What is sought, if not every coefficient of the system from all recordings together.

    Returns
    -------
    PredictionErrorFit
        Coefficients that the data leave free have infinite variance.

    Raises
    ------
    SettingError
        If the segment duration, the start, the unknowns or the samples cannot be used.
    ConvergenceError
        If the iteration does not converge, or converges to values that least squares contradicts:
        there are local minima, and a value from one is worth nothing.
    """
    unknowns = unknowns_of(system, len(recordings), unknowns)
    if start.names != unknowns.names:
        raise SettingError(
            "start", "it is a fit of another model or of other unknowns: fit these first"
        )
    segments = divide(recordings, segment_duration)
    problem = segmented_motion(system, segments, Timing(hold), unknowns)
    problem, found = _best_fit(problem, start.values)
    _compare(unknowns, found.point.values, start)
    return described(problem, found)


def described(problem: SegmentedMotion, found: Minimum) -> PredictionErrorFit:
    """What a minimum says about what was sought."""
    reduced = found.reduced
    influences, freedom = cluster_influences(problem.clusters(found.equations, reduced))
    unknown = reduced.free | (freedom == 0.0)
    return PredictionErrorFit(
        problem.names,
        found.point.values,
        covariance_of(influences, unknown),
        tuple(np.where(unknown, 0.0, freedom).tolist()),
        reduced.information,
        found.noise(problem),
        found.equations.residuals[problem.segments.within],
    )


def _best_fit(problem: SegmentedMotion, values: FloatArray) -> tuple[SegmentedMotion, Minimum]:
    """Fit twice: with the noise guessed from the signals, then with that of the residuals."""
    outputs = problem.segments.outputs
    guess = np.array([position_noise(column) for column in outputs.T])
    point = Point(values, problem.start_states)
    problem = problem.at(point, output_weights(guess, outputs))
    coarse = minimise(problem, point, _COARSE)
    problem = problem.at(coarse.point, output_weights(coarse.noise(problem), outputs))
    found = minimise(problem, coarse.point, _FINE)
    finer = refinement(problem, found)
    if finer > 1:
        problem = problem.at(found.point, problem.weights, finer)
        found = minimise(problem, found.point, _FINE)
    return problem, found


def _compare(unknowns: Unknowns, values: FloatArray, check: LeastSquaresFit) -> None:
    """Refuse values that least squares of the same record contradicts."""
    deviations = check.standard_deviations
    effects = [
        np.sqrt(row.total_sum / gram) if gram > 0.0 else np.inf
        for row in check.rows
        for gram in np.diag(row.gram)
    ]
    for place, (name, value) in enumerate(zip(unknowns.names, values.tolist(), strict=True)):
        reference = float(check.values[place])
        allowed = _AGREEMENT * deviations[place] + _SLACK * abs(reference)
        allowed += _EFFECT * effects[place]
        if abs(value - reference) > allowed:
            raise ConvergenceError(
                "prediction error",
                f"{name!r} ended at {value:.4g} where least squares finds {reference:.4g}, so one "
                f"of them is wrong: start from a least-squares fit, or shorten the segments",
            )
