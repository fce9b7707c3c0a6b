"""How fast friction stops the motor: the one number of the friction model that is not linear.

The friction of the term ``motor_stiction`` is linear in its coefficients about a stopping time T.
Least squares over a grid of T finds where to begin; from there each fit says by alpha_holding /
alpha_coulomb how far T is off in the logarithm.

Least squares needs velocities, and derived ones are smooth where friction changes sign: its T is a
few per cent short. Prediction error over short segments is right to the noise.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.models.flexible_joint import STOPPING, with_stopping_time
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_CANDIDATES = np.geomspace(5e-4, 5e-2, 9)  # s; within a factor of 1.8 of any value between
_LARGEST_STEP = 2.0  # factor of the stopping time per step
_CLOSE = 1e-2  # relative change of the stopping time that ends the iteration
_CLOSER = 3e-3  # likewise, for prediction error
_USUAL_SLOPE = 0.5  # of the error over the logarithm; 1 if the friction were linear in it
_FLATTEST = 0.1  # slope below which a line says nothing
_FEWEST_FOR_A_LINE = 3
_MOST_STEPS = 8


def find_stopping_time(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    values: Mapping[str, float],
    filter_rate: float,
    hold: Hold = "linear",
) -> tuple[ParametricSystem, LeastSquaresFit]:
    """Set the stopping time of the friction to what explains the motor's row best.

    Parameters
    ----------
    pieces : sequence of Samples
        With velocities.
    system : ParametricSystem
        A flexible joint with the term ``motor_stiction``.
    values : mapping of str to float
        Coefficients of the same joint with ``motor_coulomb`` in its place.
    filter_rate : float
        Rate of the state-variable filter in 1/s.
    hold : {"linear", "zero"}
        Whether the inputs run linearly between samples or are constant until the next one.

    Returns
    -------
    system : ParametricSystem
        With the constants of the friction set.
    fit : LeastSquaresFit
        With them.
    """

    def fit_at(
        time: float, nominal: Mapping[str, float]
    ) -> tuple[ParametricSystem, LeastSquaresFit]:
        about = with_stopping_time(system, time, nominal)
        return about, filtered_least_squares(pieces, about, filter_rate, hold)

    candidates = [fit_at(float(time), values) for time in _CANDIDATES]
    about, fit = min(candidates, key=lambda candidate: _misfit(candidate[1]))
    for _ in range(_MOST_STEPS):
        error = _log_error(fit)
        found = dict(zip(fit.names, map(float, fit.values), strict=True))
        about, fit = fit_at(about.constants[STOPPING] * float(np.exp(error)), found)
        if abs(error) < _CLOSE:
            break
    return about, fit


def fit_stopping_time(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    start: LeastSquaresFit,
    segment_duration: float = 0.5,
    hold: Hold = "linear",
) -> tuple[ParametricSystem, PredictionErrorFit]:
    """Fit the stopping time along with the coefficients, by prediction error.

    Parameters
    ----------
    pieces : sequence of Samples
        One or more contiguous pieces of motion.
    system, start : ParametricSystem, LeastSquaresFit
        From `find_stopping_time`.
    segment_duration : float, optional
        Wanted length of a segment in s. Beyond half a second the iteration may need many steps.
    hold : {"linear", "zero"}
        Whether the inputs run linearly between samples or are constant until the next one.

    Returns
    -------
    system : ParametricSystem
        With the stopping time found.
    fit : PredictionErrorFit
        About it. The stopping time's uncertainty is that of alpha_holding, and its part in the
        others' is in their covariance.

    Raises
    ------
    ConvergenceError
        If prediction error or the stopping time does not converge.
    """
    fit = prediction_error(pieces, system, start, segment_duration, hold)
    tried: list[tuple[float, float]] = []
    step = 0.0
    for _ in range(_MOST_STEPS):
        tried.append((float(np.log(system.constants[STOPPING])), _log_error(fit)))
        step = _step(tried)
        if abs(step) < _CLOSER:
            return system, fit
        values = dict(zip(fit.names, map(float, fit.values), strict=True))
        system = with_stopping_time(system, float(np.exp(tried[-1][0] + step)), values)
        check = filtered_least_squares(pieces, system, start.filter_rate, hold)
        fit = prediction_error(pieces, system, check, segment_duration, hold)
    raise ConvergenceError(
        "stopping time",
        f"it still moves by {abs(step):.1%} after {_MOST_STEPS} fits: use the term motor_coulomb",
    )


def _log_error(fit: LeastSquaresFit | PredictionErrorFit) -> float:
    """How far the logarithm of the stopping time is off, by the fit's own account."""
    values = dict(zip(fit.names, map(float, fit.values), strict=True))
    ratio = values["alpha_holding"] / values["alpha_coulomb"]
    return float(np.log(np.clip(ratio, 1 / _LARGEST_STEP, _LARGEST_STEP)))


def _step(tried: list[tuple[float, float]]) -> float:
    """Step of the logarithm of the stopping time to where the error would vanish.

    The friction switches within a sample or two, so that the error is not smooth in the stopping
    time: a line through all that was tried averages over its jumps.
    """
    place, error = tried[-1]
    if len(tried) < _FEWEST_FOR_A_LINE:
        step = error / _USUAL_SLOPE
    else:
        places, errors = np.array(tried).T
        slope, height = np.polyfit(places - place, errors, 1)
        step = -height / slope if slope < -_FLATTEST else error / _USUAL_SLOPE
    return float(np.clip(step, -np.log(_LARGEST_STEP), np.log(_LARGEST_STEP)))


def _misfit(fit: LeastSquaresFit) -> float:
    return next(row.residual_sum for row in fit.rows if "alpha_coulomb" in row.coefficients)
