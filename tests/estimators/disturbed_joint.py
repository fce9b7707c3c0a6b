"""A linear joint under disturbances, sampled exactly, and the filter of the textbook for it.

Spring, viscous friction and a held torque; each row has a disturbance of the size and rate that
are given. Nothing here comes from the estimators but the container of the samples.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from flexid.estimators.samples import Samples

TRUTH = {"theta2": 100.0, "alpha1": 300.0, "alpha2": 2.0, "beta1": 3.0}
VALUES = np.array(list(TRUTH.values()))
SAMPLE_TIME = 0.02  # s, 16 samples per period of the resonance
NOISE = np.array([2e-4, 2e-4])  # rad
DISTURBANCES = np.array([0.5, 1.0])  # rad/s²
RATES = np.array([8.0, 12.0])  # 1/s


@dataclass(frozen=True, eq=False)
class Sampled:
    """z(k+1) = step z(k) + push u(k) + white noise; y = sees z + white noise."""

    step: np.ndarray
    push: np.ndarray
    noise: np.ndarray
    sees: np.ndarray
    sensors: np.ndarray


def jacobian(values: np.ndarray = VALUES) -> np.ndarray:
    """Derivatives of the rates of x1 to x4 by these."""
    theta2, alpha1, alpha2, _ = values
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-theta2, 0.0, theta2, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [alpha1, 0.0, -alpha1, -alpha2],
        ]
    )


def sampled(values: np.ndarray = VALUES) -> Sampled:
    """Positions, velocities and disturbances from sample to sample, torque and those held."""
    whole = np.zeros((7, 7))
    whole[:4, :4] = jacobian(values)
    whole[1, 4] = whole[3, 5] = 1.0
    whole[3, 6] = values[3]
    moved = np.asarray(expm(SAMPLE_TIME * whole))
    decay = np.exp(-RATES * SAMPLE_TIME)
    step = moved[:6, :6]
    step[4:, 4:] = np.diag(decay)
    noise = np.zeros((6, 6))
    noise[4:, 4:] = np.diag(DISTURBANCES**2 * (1.0 - decay**2))
    sees = np.zeros((2, 6))
    sees[0, 0] = sees[1, 2] = 1.0
    return Sampled(step, moved[:6, 6], noise, sees, np.diag(NOISE**2))


def riccati(system: Sampled) -> np.ndarray:
    """Steady covariance of a predicted state, by SciPy."""
    found = solve_discrete_are(system.step.T, system.sees.T, system.noise, system.sensors)
    return np.asarray(found)


def kalman_gain(values: np.ndarray = VALUES) -> np.ndarray:
    """Of a steady filter, shape (6, 2): positions, velocities and disturbances."""
    system = sampled(values)
    covariance = riccati(system)
    spread = system.sees @ covariance @ system.sees.T + system.sensors
    return covariance @ system.sees.T @ np.linalg.inv(spread)


def innovations(samples: Samples, values: np.ndarray = VALUES) -> np.ndarray:
    """What a steady Kalman filter that starts at rest does not foresee, shape (n, 2)."""
    system, gain = sampled(values), kalman_gain(values)
    state, found = np.zeros(6), []
    for position, torque in zip(samples.positions, samples.inputs[:, 0], strict=True):
        error = position - system.sees @ state
        found.append(error)
        state = system.step @ (state + gain @ error) + system.push * torque
    return np.array(found)


def disturbed_samples(seed: int, n: int = 600) -> Samples:
    """A log from rest under a random torque."""
    rng = np.random.default_rng(seed)
    system = sampled()
    torque = np.repeat(rng.normal(0.0, 6.0, n // 5 + 1), 5)[:n]
    shocks = rng.standard_normal((n, 6)) * np.sqrt(np.diag(system.noise))
    state = np.concatenate((np.zeros(4), DISTURBANCES * rng.standard_normal(2)))
    positions = np.empty((n, 2))
    for k in range(n):
        positions[k] = system.sees @ state
        state = system.step @ state + system.push * torque[k] + shocks[k]
    positions += NOISE * rng.standard_normal((n, 2))
    return Samples(positions, None, torque[:, None], SAMPLE_TIME)
