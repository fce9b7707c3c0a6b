"""flexid's library function `prediction_error`, with segments of a chosen length.

It starts from least squares, is given the hold of the torque, and does not use velocities.
"""

import numpy as np
from scipy.stats import t

from benchmarks.peers.problem import Answer, Log
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.flexible_joint import flexible_joint


def identify(log: Log, segment_duration: float = 1.0) -> Answer:
    # user code begins
    joint, hold = flexible_joint(), "zero" if log.held else "linear"
    record = Samples(log.positions, None, log.torque[:, None], log.sample_time)
    start = filtered_least_squares([record], joint, hold=hold)
    fit = prediction_error([record], joint, start, segment_duration=segment_duration, hold=hold)
    # user code ends
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    freedom = np.array(fit.degrees_of_freedom)
    if not np.all(freedom > 0):
        return Answer(values)
    width = fit.standard_deviations * t.ppf(0.975, freedom)
    low, high = (fit.values - width).tolist(), (fit.values + width).tolist()
    return Answer(values, dict(zip(fit.names, zip(low, high, strict=True), strict=True)))
