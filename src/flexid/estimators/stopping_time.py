"""How fast friction stops the motor: the one number of the friction model that is not linear.

The stopping time T of the term ``motor_stiction`` is where the misfit is least: that of least
squares over a wide range, which needs velocities, and derived ones are smooth where friction
changes sign, so that its T is some per cent short; and then that of prediction error near it, which
is right to the noise.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import STOPPING, with_stopping_time
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_CANDIDATES = np.log(np.geomspace(5e-4, 5e-2, 9))  # of T in s; a factor of 1.8 apart
_REACH = 0.3  # of ln T, about what least squares finds
_CLOSE = 5e-3  # of ln T, where the search ends; its last parabola ends closer


def find_stopping_time(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    values: Mapping[str, float],
    filter_rate: float,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
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
    unknowns : Unknowns, optional
        What is sought, if not every coefficient of the system; with the coefficients of friction.

    Returns
    -------
    system : ParametricSystem
        With the constants of the friction set.
    fit : LeastSquaresFit
        With them, and alpha_holding not sought.
    """

    def fit_at(log_time: float) -> tuple[ParametricSystem, LeastSquaresFit]:
        about = with_stopping_time(system, float(np.exp(log_time)), values)
        fit = filtered_least_squares(pieces, about, filter_rate, hold, _right(about, unknowns))
        return about, fit

    def misfit(log_time: float) -> float:
        rows = fit_at(log_time)[1].rows
        return next(row.residual_sum for row in rows if "alpha_coulomb" in row.coefficients)

    best = int(np.argmin([misfit(log_time) for log_time in _CANDIDATES]))
    lower, upper = _CANDIDATES[max(best - 1, 0)], _CANDIDATES[min(best + 1, len(_CANDIDATES) - 1)]
    return fit_at(_least(misfit, lower, upper))


def fit_stopping_time(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    start: LeastSquaresFit,
    segment_duration: float = 0.5,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> tuple[ParametricSystem, PredictionErrorFit]:
    """Fit the stopping time along with the coefficients, by prediction error.

    Parameters
    ----------
    pieces : sequence of Samples
        One or more contiguous pieces of motion.
    system, start : ParametricSystem, LeastSquaresFit
        From `find_stopping_time`.
    segment_duration : float, optional
        Wanted length of a segment in s.
    hold : {"linear", "zero"}
        Whether the inputs run linearly between samples or are constant until the next one.
    unknowns : Unknowns, optional
        As in `find_stopping_time`.

    Returns
    -------
    system : ParametricSystem
        With the stopping time found.
    fit : PredictionErrorFit
        With alpha_holding sought: its standard deviation over alpha_coulomb is the relative one of
        the stopping time, and the others' covariance heeds it.

    Raises
    ------
    ConvergenceError
        If prediction error or the stopping time does not converge.
    """
    values = dict(zip(start.names, map(float, start.values), strict=True))

    def fit_at(log_time: float, fixed: bool) -> tuple[ParametricSystem, PredictionErrorFit]:
        about = with_stopping_time(system, float(np.exp(log_time)), values)
        sought = _right(about, unknowns) if fixed else unknowns or Unknowns(about)
        check = filtered_least_squares(pieces, about, start.filter_rate, hold, sought)
        fit = prediction_error(pieces, about, check, segment_duration, hold, unknowns=sought)
        return about, fit

    def misfit(log_time: float) -> float:
        return float(np.sum(np.log(fit_at(log_time, fixed=True)[1].noise)))

    place = float(np.log(system.constants[STOPPING]))
    found = _least(misfit, place - _REACH, place + _REACH)
    if abs(found - place) > _REACH - 2 * _CLOSE:
        raise ConvergenceError(
            "stopping time",
            f"prediction error puts it beyond {np.exp(found):.2g} s, away from least squares: use "
            f"the term motor_coulomb",
        )
    return fit_at(found, fixed=False)


def _right(system: ParametricSystem, unknowns: Unknowns | None) -> Unknowns:
    """Seek the coefficients as if the stopping time were right."""
    return (unknowns or Unknowns(system)).fixing({"alpha_holding": 0.0})


def _least(misfit: Callable[[float], float], lower: float, upper: float) -> float:
    from scipy.optimize import minimize_scalar  # late: it takes a third of a second to import

    found = minimize_scalar(
        misfit, bounds=(lower, upper), method="bounded", options={"xatol": _CLOSE}
    )
    return float(found.x)
