"""Segmented prediction error: the model's own motion, fitted to the measured one.

The record is cut into segments. Each starts from an initial state of its own, which is unknown;
from there the model runs freely under the recorded input, and coefficients and initial states are
sought for which all the motions come closest to the measured positions. With white noise this is
maximum likelihood. It needs starting values, which least squares gives, and is checked against it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.block_sandwich import covariance_of
from flexid.estimators.channel_timing import Timing
from flexid.estimators.cluster_covariance import cluster_influences
from flexid.estimators.gauss_newton import Minimum, approach, minimise, output_weights, refinement
from flexid.estimators.rowwise import LeastSquaresFit
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, SegmentedMotion, segmented_motion
from flexid.estimators.segments import divide
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.estimators.unknowns import Unknowns, unknowns_of
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.recording.velocities import position_noise, velocity

_COARSE, _FINE = 1.0, 1e-2  # length of a step, in standard deviations, that ends the iteration
_AGREEMENT = 10.0  # standard deviations of least squares within which an estimate may end
_SLACK = 1.0  # and this part of the value besides, for what the model leaves out
_EFFECT = 0.05  # and this part of the row's acceleration, for coefficients that are about zero
_WORSE = 1e-3  # rise of the misfit that shows a minimum to be another one


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
    start: Mapping[str, float] | LeastSquaresFit,
    segment_duration: float = 1.0,
    hold: Hold = "linear",
    use_velocities: bool = False,
    unknowns: Unknowns | None = None,
) -> PredictionErrorFit:
    """Fit the model's free motion over segments to measured positions.

    Parameters
    ----------
    recordings : sequence of Samples
        One or more contiguous recordings of motion.
    system : ParametricSystem
        The model; its constants have the values declared in it.
    start : LeastSquaresFit or mapping of str to float
        Where to start: a least-squares fit of the same record, or a value for each unknown. The
        second is fitted from least squares as well, which must not explain the record better.
    segment_duration : float, optional
        Wanted length of a segment in s. Longer segments hold more information and forgive
        less: what the model leaves out adds up over a segment.
    hold : {"linear", "zero", "cubic"}, optional
        Whether the inputs run linearly between samples, are constant until the next one, or smooth.
    use_velocities : bool, optional
        Fit measured velocities besides the positions. Do so only if a sensor gave them.
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
    segments = divide(recordings, segment_duration, use_velocities)
    check = _least_squares(recordings, unknowns, hold) if isinstance(start, Mapping) else start
    problem = segmented_motion(system, segments, Timing(hold), unknowns)
    problem, found = _best_fit(problem, _start_values(unknowns, start))
    if isinstance(start, Mapping):
        rival_problem, rival = _best_fit(problem, _start_values(unknowns, check))
        if _misfit(problem, found) > _misfit(rival_problem, rival) + _WORSE:
            raise ConvergenceError(
                "prediction error",
                "another minimum explains the record better than the one that the starting values "
                "lead to: start from a least-squares fit",
            )
    _compare(unknowns, found.point.values, check)
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
    coarse = approach(problem, point, _COARSE)
    problem = problem.at(coarse.point, output_weights(coarse.noise(problem), outputs))
    found = minimise(problem, coarse.point, _FINE)
    finer = refinement(problem, found)
    if finer > 1:
        problem = problem.at(found.point, problem.weights, finer)
        found = minimise(problem, found.point, _FINE)
    return problem, found


def _start_values(unknowns: Unknowns, start: Mapping[str, float] | LeastSquaresFit) -> FloatArray:
    if isinstance(start, LeastSquaresFit):
        if start.names != unknowns.names:
            raise SettingError(
                "start", "it is a fit of another model or of other unknowns: fit these first"
            )
        start = start.by_name
    if set(start) != set(unknowns.names):
        names = ", ".join(unknowns.names)
        raise SettingError("start", f"give one value for each unknown of the model: {names}")
    values = np.array([start[name] for name in unknowns.names], dtype=np.float64)
    if not np.isfinite(values).all():
        raise SettingError("start", "not every value is a finite number: correct it")
    return values


def _least_squares(
    recordings: Sequence[Samples], unknowns: Unknowns, hold: Hold
) -> LeastSquaresFit:
    """Least squares of the record, which needs no starting values."""
    complete = [
        replace(
            recording,
            velocities=np.column_stack(
                [velocity(q, recording.sample_time) for q in recording.positions.T]
            ),
        )
        if recording.velocities is None and len(recording) > 4
        else recording
        for recording in recordings
    ]
    return filtered_least_squares(complete, unknowns.system, hold=hold, unknowns=unknowns)


def _misfit(problem: SegmentedMotion, found: Minimum) -> float:
    """Log of the residuals' mean squares, summed over the outputs: what only noise explains."""
    return -2.0 * float(
        np.sum(np.log(output_weights(found.noise(problem), problem.segments.outputs)))
    )


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
