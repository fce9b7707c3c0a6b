"""How fast friction stops the motor: the one number of the friction model that is not linear.

The friction of the term ``motor_stiction`` is linear in its coefficients about a stopping time T.
Least squares over a grid of T finds where to begin; from there each fit says by alpha_holding /
alpha_coulomb how far T is off, which is Gauss and Newton's step in the logarithm of T.

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
_CLOSER = 1e-4  # likewise, for prediction error
_NEGLIGIBLE = 0.1  # or this part of its standard deviation
_FLATTEST = 0.1  # slope of the error over the logarithm, minus one if the fit were linear
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
    for _ in range(_MOST_STEPS):
        place, error = float(np.log(system.constants[STOPPING])), _log_error(fit)
        if abs(error) < _settled(fit):
            return system, fit
        tried.append((place, error))
        values = dict(zip(fit.names, map(float, fit.values), strict=True))
        system = with_stopping_time(system, float(np.exp(place + _step(tried))), values)
        check = filtered_least_squares(pieces, system, start.filter_rate, hold)
        fit = prediction_error(pieces, system, check, segment_duration, hold)
    raise ConvergenceError(
        "stopping time",
        f"it still moves by {abs(tried[-1][1]):.1%} after {_MOST_STEPS} fits: use the term "
        f"motor_coulomb",
    )


def _log_error(fit: LeastSquaresFit | PredictionErrorFit) -> float:
    """How far the logarithm of the stopping time is off, by the fit's own account."""
    values = dict(zip(fit.names, map(float, fit.values), strict=True))
    ratio = values["alpha_holding"] / values["alpha_coulomb"]
    return float(np.log(np.clip(ratio, 1 / _LARGEST_STEP, _LARGEST_STEP)))


def _settled(fit: PredictionErrorFit) -> float:
    place = fit.names.index("alpha_holding")
    deviation = np.sqrt(fit.gauss_newton_covariance[place, place]) / abs(fit.values[place])
    return max(_CLOSER, _NEGLIGIBLE * float(np.nan_to_num(deviation, posinf=0.0)))


def _step(tried: list[tuple[float, float]]) -> float:
    """By the secant through the last two; the error alone where they show no way to zero."""
    (other, before), (place, error) = tried[-2:] if len(tried) > 1 else tried * 2
    slope = (error - before) / (place - other) if place != other else 0.0
    step = -error / slope if slope < -_FLATTEST else error
    return float(np.clip(step, -np.log(_LARGEST_STEP), np.log(_LARGEST_STEP)))


def _misfit(fit: LeastSquaresFit) -> float:
    return next(row.residual_sum for row in fit.rows if "alpha_coulomb" in row.coefficients)
