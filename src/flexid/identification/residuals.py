"""What a fit leaves unexplained, beside what the noise of the positions accounts for.

Noise of a position enters a row's filtered equation through the second difference on its left and
through the regressors on its right. Both ways are linear for small noise, so the residual that
noise alone would leave can be predicted. A residual far above it means that the model lacks
something, or that the recorded input is not the one that acted; no interval covers that.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.estimators.streamed_least_squares import StreamedFit
from flexid.estimators.unknowns import Unknowns
from flexid.recording.velocities import position_noise
from flexid.simulation.free_run import free_run_kernel
from flexid.simulation.linearisation import jacobian

FloatArray = NDArray[np.float64]

_INSTANTS = 100  # of the motion at which the model is linearised
_MEMORY = 40.0  # time constants of the filter after which its response has vanished


def residual_excess(
    fit: LeastSquaresFit | StreamedFit, unknowns: Unknowns, pieces: Sequence[Samples]
) -> dict[str, float]:
    """Residual of each row over the residual that noise of the positions would leave.

    Parameters
    ----------
    fit : LeastSquaresFit or StreamedFit
        Of these pieces, or of a record that begins with them.
    unknowns : Unknowns
        What it sought.
    pieces : sequence of Samples
        With velocities.

    Returns
    -------
    dict of str to float
        Ratio of root mean squares by row; near 1 for a right model with white noise.
    """
    place = max(range(len(pieces)), key=lambda i: len(pieces[i]))
    longest = pieces[place]
    noise = np.array([position_noise(position) for position in longest.positions.T])
    stiffness, damping = _linearised(unknowns, unknowns.coefficients(fit.values, place), longest)
    smooth, first, second = _responses(fit.filter_rate, longest.sample_time, len(longest))
    excess = {}
    for place, row in enumerate(fit.rows):
        variance = 0.0
        for coordinate, sigma in enumerate(noise):
            response = -stiffness[place, coordinate] * smooth - damping[place, coordinate] * first
            if coordinate == place:
                response = response + second
            variance += float(sigma**2 * np.sum(response**2))
        residual = row.residual_sum / max(1, row.count)
        excess[row.name] = float(np.sqrt(residual / max(variance, np.finfo(float).tiny)))
    return excess


def _responses(
    filter_rate: float, sample_time: float, most_samples: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Impulse responses of the filter alone, with the first and with the second difference."""
    pole = np.exp(-filter_rate * sample_time)
    count = int(min(_MEMORY / (filter_rate * sample_time), most_samples)) + 10
    smooth = np.zeros(count)
    smooth[2:] = (1 - pole) ** 2 * np.arange(1, count - 1) * pole ** np.arange(count - 2)
    before, twice = (np.concatenate((np.zeros(n), smooth[:-n])) for n in (1, 2))
    first = (smooth - twice) / (2 * sample_time)
    return smooth, first, (smooth - 2.0 * before + twice) / sample_time**2


def _linearised(
    unknowns: Unknowns, coefficients: FloatArray, samples: Samples
) -> tuple[FloatArray, FloatArray]:
    """Mean derivatives of the accelerations by positions and velocities, each (rows, rows)."""
    system = unknowns.system
    assert samples.velocities is not None
    states = np.empty((len(samples), len(system.states)))
    states[:, 0::2], states[:, 1::2] = samples.positions, samples.velocities
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    kernel = free_run_kernel(system)
    instants = np.linspace(0, len(samples) - 1, _INSTANTS).round().astype(int)
    about = (
        jacobian(kernel, states[i], samples.inputs[i], coefficients, constants) for i in instants
    )
    mean = np.mean(list(about), axis=0)[1::2]
    return mean[:, 0::2], mean[:, 1::2]
