"""PySINDy in weak form: sparse regression with integration by parts.

The candidates for each acceleration are both velocities, sin x1, the twist and the torque. The
threshold removes candidates with small coefficients. Velocities without a sensor come from
PySINDy's smoothed differences. There are no intervals.
"""

import numpy as np
import pysindy

from benchmarks.peers.problem import Answer, Log

_WINDOWS, _HALF_WIDTH = 1000, 1.0  # number, and half-width in s


def identify(log: Log) -> Answer:
    # user code begins
    np.random.seed(0)  # noqa: NPY002 - PySINDy places its windows with NumPy's global generator
    (x1, x3), torque = log.positions.T, log.torque
    if log.held:  # integrals assume signals linear between samples
        torque = 0.5 * (torque + np.append(torque[0], torque[:-1]))
    velocities = log.velocities
    if velocities is None:
        smoothing = {"window_length": 41, "polyorder": 3}
        differences = pysindy.SmoothedFiniteDifference(smoother_kws=smoothing)
        velocities = np.column_stack([differences(q[:, None], log.time) for q in log.positions.T])
    library = pysindy.WeakPDELibrary(
        pysindy.PolynomialLibrary(degree=1, include_bias=False),
        spatiotemporal_grid=log.time,
        K=_WINDOWS,
        H_xt=[_HALF_WIDTH],
    )
    model = pysindy.SINDy(pysindy.STLSQ(threshold=0.1, alpha=0.0), library)
    model.fit(velocities, log.time, u=np.column_stack([np.sin(x1), x1 - x3, torque]))
    (_, _, gravity, spring, _), (_, friction, _, reaction, gain) = model.coefficients().tolist()
    # user code ends
    return Answer(
        {
            "theta1": -gravity,
            "theta2": -spring,
            "alpha1": reaction,
            "alpha2": -friction,
            "beta1": gain,
        }
    )
