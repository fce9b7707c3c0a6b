"""The noisy flexible joint on which estimators are tested, simulated with SciPy."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from scipy.stats import t
from tests.made_estimates import TRUE as TRUTH

from flexid.estimators.samples import Samples

VALUES = np.array(list(TRUTH.values()))
SAMPLE_TIME = 1e-3
POSITION_NOISE = 1e-4
VELOCITY_NOISE = 1e-2


def torque(time):
    """Return the sum of two sines, in N m."""
    return 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time)


def joint_rates(x: np.ndarray, u: float) -> list[float]:
    """Return the rates of the states x1 to x4 under a torque, written by hand from eq. (4)."""
    theta1, theta2, alpha1, alpha2, beta1 = VALUES
    twist = x[0] - x[2]
    link = -theta1 * np.sin(x[0]) - theta2 * twist
    return [x[1], link, x[3], alpha1 * twist - alpha2 * x[3] + beta1 * u]


@cache
def clean_motion() -> tuple[np.ndarray, np.ndarray]:
    """Return time, shape (n,), and states x1 to x4, shape (n, 4), from rest."""
    time = np.arange(30_001) * SAMPLE_TIME
    run = (0.0, time[-1]), np.zeros(4), "DOP853", time
    solution = solve_ivp(lambda t, x: joint_rates(x, torque(t)), *run, rtol=1e-11, atol=1e-12)
    return time, solution.y.T


def joint_samples(seed: int | None = None, first: int = 0) -> Samples:
    """Return the samples from `first` on, clean or with white noise of the given seed."""
    time, states = clean_motion()
    states = states.copy()
    if seed is not None:
        generator = np.random.default_rng(seed)
        n = len(time)
        states[:, [0, 2]] += POSITION_NOISE * generator.standard_normal((n, 2))
        states[:, [1, 3]] += VELOCITY_NOISE * generator.standard_normal((n, 2))
    return Samples(
        states[first:, [0, 2]],
        states[first:, [1, 3]],
        torque(time[first:])[:, None],
        SAMPLE_TIME,
        time[first],
    )


def encoders(seed: int | None, first: int = 0) -> Samples:
    """Return the same samples as `joint_samples`, without velocities."""
    return replace(joint_samples(seed, first), velocities=None)


def late_motion(
    at: np.ndarray, input_delay: float, link_delay: float, by_deflection: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return link, motor and torque at some times, with the torque and link or deflection late."""
    time, states = clean_motion()
    link, motor = (make_interp_spline(time, states[:, column], k=5) for column in (0, 2))
    seen = link(at - link_delay)
    if by_deflection:
        seen += motor(at) - motor(at - link_delay)
    return seen, motor(at), torque(at + input_delay)


def holding(fit, truth: np.ndarray = VALUES) -> np.ndarray:
    """Return whether each 95 % interval of a fit contains the true value."""
    quantile = t.ppf(0.975, np.array(fit.degrees_of_freedom))
    return np.abs(fit.values - truth) <= quantile * fit.standard_deviations


def worst_error(values) -> float:
    """Return the largest relative error of the coefficients, in per cent."""
    return 100.0 * float(np.max(np.abs(np.asarray(values) / VALUES - 1.0)))
