"""NumPy least squares on regressors and accelerations with the same filter.

This is the practice in robotics: both sides of x2' = ... and x4' = ... get the same filter, which
also differentiates, and `lstsq` solves for the coefficients. The user chooses the filter's rate
near the joint's resonance. The intervals are the textbook ones for independent residuals.
"""

import numpy as np
from scipy.signal import bilinear, lfilter

from benchmarks.peers.problem import COEFFICIENTS, Answer, Log, normal_intervals

_RATE = 20.0  # 1/s


def identify(log: Log) -> Answer:
    # user code begins
    def filtered(signal, order=0):  # order-th derivative, filtered by (rate / (s + rate))^2
        numerator = _RATE**2 * np.eye(3)[2 - order]
        lag = [1.0, 2.0 * _RATE, _RATE**2]
        return lfilter(*bilinear(numerator, lag, 1.0 / log.sample_time), signal)

    (x1, x3), torque = log.positions.T, log.torque
    if log.held:  # so that the filter's trapezoidal rule uses the mean over each interval
        torque = 0.5 * (torque + np.append(torque[0], torque[:-1]))
    if log.velocities is None:
        accelerations, x4 = [filtered(x1, 2), filtered(x3, 2)], filtered(x3, 1)
    else:
        accelerations = [filtered(velocity, 1) for velocity in log.velocities.T]
        x4 = filtered(log.velocities[:, 1])
    link = [filtered(-np.sin(x1)), filtered(x3 - x1)]
    motor = [filtered(x1 - x3), -x4, filtered(torque)]
    values, deviations = [], []
    for signals, acceleration in zip((link, motor), accelerations, strict=True):
        settled = round(20.0 / _RATE / log.sample_time)  # samples until the filter forgot its start
        regressors, wanted = np.column_stack(signals)[settled:], acceleration[settled:]
        row, (misfit,), *_ = np.linalg.lstsq(regressors, wanted, rcond=None)
        covariance = np.linalg.inv(regressors.T @ regressors) * misfit / (len(wanted) - len(row))
        values += row.tolist()
        deviations += np.sqrt(np.diag(covariance)).tolist()
    # user code ends
    named = dict(zip(COEFFICIENTS, values, strict=True))
    return Answer(named, normal_intervals(named, dict(zip(COEFFICIENTS, deviations, strict=True))))
