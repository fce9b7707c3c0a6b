"""PySINDy in weak form: a sparse regression that integrates by parts instead of differentiating.

The candidates for either acceleration are both velocities, sin x1, the twist and the torque; the
threshold removes those whose coefficient is small. Velocities that no sensor measured come from
PySINDy's own smoothed differences. It has no intervals.
"""

import numpy as np
import pysindy

from benchmarks.peers.problem import Answer, Log

_WINDOWS, _HALF_WIDTH = 1000, 1.0  # number, and half their width in s


def identify(log: Log) -> Answer:
    # user code begins
    np.random.seed(0)  # noqa: NPY002 - PySINDy places its windows with NumPy's global generator
    (x1, x3), torque = log.positions.T, log.torque
    if log.held:  # integrals take signals as linear between samples
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
