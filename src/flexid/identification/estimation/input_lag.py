"""First-order lag between the logged input and the motor, in place of its delay.

A current loop or a coil delays an input, and also reduces it. At a resonance ω a lag τ has the gain
1 / sqrt(1 + (ω τ)²), so a fit with a delay makes the inertias too large. The lag replaces a part of
the delay. It is the one with which the fit explains most, at the delay that suits it.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, after_a_lag
from flexid.estimators.prediction_error import NEGLIGIBLE, Steps, minimise
from flexid.identification.estimation.model_error import filtered_input, is_input_delay
from flexid.identification.full_model.model import Fitted

_LONGEST = 1.2  # of a delay: longest lag that is sought in its place
_FINE = 0.03  # of a delay: tolerance of the search
_TRIED = (0.4, 0.8)  # of a delay: lags of which one must explain more after one slow step
# Fall of -2 log(likelihood) that only a lag causes. On logs of a lag it was 86 to 5000, where it is
# ten standard deviations. On one of a delay it was 71, since Stribeck friction was not described.
_DECISIVE = 100.0
_ITERATIONS = 4  # slow Gauss-Newton steps for each lag
_APART = 0.2  # of a squared lag: distance at which its effect and its likelihood are computed


def likely_lag(fitted: Fitted) -> float:
    """Return the lag in s that clearly explains more than the input's delay; 0 if none does."""
    from scipy.optimize import minimize_scalar  # late: it is slow to import, and few logs need it

    delay = fitted.by_name.get(INPUT, 0.0)
    if delay <= 0.0:
        return 0.0
    before = fitted.minimum.equations.cost
    enough = before - _DECISIVE * max(fitted.excess, 1.0)
    if min(_with_lag(fitted, share * delay, 1)[0] for share in _TRIED) > before:
        return 0.0
    least: Any = minimize_scalar(
        lambda lag: min(_with_lag(fitted, lag)[0], 2.0 * before),  # finite if the motion diverges
        bounds=(0.0, _LONGEST * delay),
        method="bounded",
        options={"xatol": _FINE * delay},
    )
    return float(least.x) if least.fun < enough else 0.0


def lag_error(fitted: Fitted, lag: float) -> FloatArray:
    """Return the error of each value, shape (k,), by that of the lag of a corrected input.

    Two further lags in series give the cost and the values as parabolas of the squared lag. The
    error is the distance from the least cost, and the standard deviation by the curvature. It is a
    tenth of the lag at most, since a decisive lag is known better; without a least cost it is that.
    """
    step = _APART * lag**2
    (near, closer), (far, farther) = (
        _with_lag(fitted, np.sqrt(times * step)) for times in (1.0, 2.0)
    )
    here = fitted.minimum.equations.cost
    rate = (4.0 * closer - 3.0 * fitted.values - farther) / (2.0 * step)
    curvature, size = (here - 2.0 * near + far) / step**2, step
    if np.isfinite(curvature) and curvature > 0.0:
        away = (4.0 * near - 3.0 * here - far) / (2.0 * step * curvature)
        deviation = np.sqrt(2.0 * max(fitted.excess, 1.0) / curvature)
        size = min(float(np.hypot(away, deviation)), step)
    return size * np.where(is_input_delay(fitted), 0.0, rate)


def _with_lag(
    fitted: Fitted, lag: float, iterations: int = _ITERATIONS
) -> tuple[float, FloatArray]:
    """Return the least cost and the values, shape (k,), with a lag in s in place of some delay."""
    # The cost is infinite if the motion diverges.
    driven = fitted.problem.driven_by(filtered_input(fitted, after_a_lag, lag))
    start = replace(fitted.minimum.point, values=fitted.values - lag * is_input_delay(fitted))
    try:
        found = minimise(driven, start, Steps(NEGLIGIBLE, insist=False, iterations=iterations))
    except ConvergenceError:
        return np.inf, fitted.values
    return found.equations.cost, found.point.values
