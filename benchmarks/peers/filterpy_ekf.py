"""filterpy's extended Kalman filter for the states and the logarithms of the coefficients.

The filter has the true noise of the sensors and starts from half the true coefficients. Its final
covariance gives the intervals.
"""

from math import cos, exp, sin

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from benchmarks.peers.problem import COEFFICIENTS, Answer, Log

# Process noise per sample: shares of the variances of position and velocity; of the logarithms.
_POSITION_DRIFT, _VELOCITY_DRIFT, _LOGARITHM_DRIFT = 1e-4, 1e-4, 1e-14


def identify(log: Log) -> Answer:
    # user code begins
    h = log.sample_time

    def rates(z, torque):
        x1, x2, x3, x4, *logarithms = z.tolist()
        theta1, theta2, alpha1, alpha2, beta1 = map(exp, logarithms)
        link = -theta1 * sin(x1) - theta2 * (x1 - x3)
        motor = alpha1 * (x1 - x3) - alpha2 * x4 + beta1 * torque
        return np.array([x2, link, x4, motor, 0.0, 0.0, 0.0, 0.0, 0.0])

    def advance(z, torque):
        k1 = rates(z, torque)
        k2 = rates(z + 0.5 * h * k1, torque)
        k3 = rates(z + 0.5 * h * k2, torque)
        k4 = rates(z + h * k3, torque)
        return z + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def transition(z, torque):
        x1, _, x3, x4, *logarithms = z.tolist()
        theta1, theta2, alpha1, alpha2, beta1 = map(exp, logarithms)
        A = np.zeros((9, 9))
        A[0, 1] = A[2, 3] = 1.0
        A[1] = [-theta1 * cos(x1) - theta2, 0, theta2, 0,
                -theta1 * sin(x1), -theta2 * (x1 - x3), 0, 0, 0]  # fmt: skip
        A[3] = [alpha1, 0, -alpha1, -alpha2, 0, 0,
                alpha1 * (x1 - x3), -alpha2 * x4, beta1 * torque]  # fmt: skip
        return np.eye(9) + h * A + 0.5 * h * h * A @ A

    position, velocity = log.position_noise**2, 1e4 * log.position_noise**2
    if log.velocities is None:
        measured, H, variances = log.positions, np.eye(9)[[0, 2]], [position] * 2
    else:
        velocity = log.velocity_noise**2
        measured, H = np.column_stack([log.positions, log.velocities]), np.eye(9)[[0, 2, 1, 3]]
        variances = [position] * 2 + [velocity] * 2
    kalman = ExtendedKalmanFilter(dim_x=9, dim_z=len(H))
    start = np.polynomial.polynomial.polyfit(h * np.arange(50), log.positions[:50], 3)[:2]
    guess = [log.guess[name] for name in COEFFICIENTS]
    kalman.x = np.concatenate([start.T.ravel(), np.log(guess)])
    kalman.P = np.diag([position, velocity] * 2 + [0.5**2] * 5)
    drift = [_POSITION_DRIFT * position, _VELOCITY_DRIFT * velocity] * 2
    kalman.Q = np.diag(drift + [_LOGARITHM_DRIFT] * 5)
    kalman.R = np.diag(variances)
    for sample, torque in zip(measured[1:], log.mean_torque.tolist(), strict=True):
        F = transition(kalman.x, torque)
        kalman.x = advance(kalman.x, torque)
        kalman.P = F @ kalman.P @ F.T + kalman.Q
        kalman.update(sample, lambda _: H, lambda z: H @ z)
    logarithms, deviations = kalman.x[4:], np.sqrt(np.diag(kalman.P)[4:])
    # user code ends
    low, high = np.exp([logarithms - 1.96 * deviations, logarithms + 1.96 * deviations])
    return Answer(
        dict(zip(COEFFICIENTS, np.exp(logarithms).tolist(), strict=True)),
        dict(zip(COEFFICIENTS, zip(low.tolist(), high.tolist(), strict=True), strict=True)),
    )
