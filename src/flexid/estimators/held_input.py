"""Inputs between samples: held, on straight lines or on a smooth curve, and late by any time.

What a joint does within one sampling interval depends on the input's mean and first moment there;
how the input is distributed beyond that changes its position by less than (ωh)² of what a single
sample of input does. So whatever the input does between samples, and however late it acts, each
interval gets the straight line that has the same mean and moment. Both depend smoothly on the
delay, which can therefore be sought like any coefficient.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import spline_filter1d

from flexid.arrays import FloatArray
from flexid.recording.recording import Hold

_OFFSETS: FloatArray = np.arange(-2.0, 4.0)  # samples that a cubic about an interval touches
_NODES = (0.5 * (1.0 - 0.6**0.5), 0.5, 0.5 * (1.0 + 0.6**0.5))  # Gauss and Legendre, degree five
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
_INSIDE = 1e-9  # of an interval: a held input jumps at its ends


def held_input(
    inputs: FloatArray,  # (n, n_inputs)
    sample_time: float,  # in s
    hold: Hold,
    delay: float,
) -> FloatArray:
    """Straight lines that act like a sampled input over each interval, shape (n, n_inputs, 4).

    Value at its start, change over it, and the derivatives of both by the delay in 1/s.
    """
    # A fit that diverges may ask for any delay: beyond the samples all of it is alike.
    reach = sample_time * (len(inputs) + len(_OFFSETS))
    delay = float(np.fmax(np.fmin(delay, reach), -reach))
    whole = int(np.floor(delay / sample_time))
    fraction = min(max(delay / sample_time - whole, _INSIDE), 1.0 - _INSIDE)
    mean, moment = _moments(hold, fraction)
    before, after = _kernel(hold, _OFFSETS - fraction), _kernel(hold, 1.0 + _OFFSETS - fraction)
    mean_slope = (before - after) / sample_time
    moment_slope = (mean - after) / sample_time
    taps = np.column_stack((*_line(mean, moment), *_line(mean_slope, moment_slope)))
    # The samples about an interval stand in turn, and the largest offset is that of the earliest.
    earliest = int(_OFFSETS[-1]) + whole
    room = abs(earliest) + len(_OFFSETS)
    padded = np.pad(inputs, ((room, room), (0, 0)), mode="edge")
    if hold == "cubic":
        padded = spline_filter1d(padded, order=3, axis=0)
    padded = padded[room - earliest :]
    around = sliding_window_view(padded, len(_OFFSETS), axis=0)[: len(inputs)]
    lines = around.reshape(-1, len(_OFFSETS)) @ taps[::-1]
    return lines.reshape(*inputs.shape, 4)


def _line(mean: FloatArray, moment: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Start and change of the line over [0, 1] with a mean and a first moment."""
    return 4.0 * mean - 6.0 * moment, 12.0 * moment - 6.0 * mean


def _moments(hold: Hold, fraction: float) -> tuple[FloatArray, FloatArray]:
    """Mean and first moment over an interval of what each sample contributes."""
    mean, moment = np.zeros(len(_OFFSETS)), np.zeros(len(_OFFSETS))
    for start, stop in ((0.0, fraction), (fraction, 1.0)):
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            place = start + node * (stop - start)
            share = weight * (stop - start) * _kernel(hold, place + _OFFSETS - fraction)
            mean += share
            moment += place * share
    return mean, moment


def _kernel(hold: Hold, at: FloatArray) -> FloatArray:
    """What a sample, or a weight of the spline, contributes at a distance in samples."""
    if hold == "zero":
        return ((at >= 0.0) & (at < 1.0)).astype(np.float64)
    far = np.abs(at)
    if hold == "linear":
        return np.maximum(1.0 - far, 0.0)
    near = (0.5 * far - 1.0) * far**2 + 2.0 / 3.0
    outer = (2.0 - far) ** 3 / 6.0
    return np.where(far <= 1.0, near, np.where(far < 2.0, outer, 0.0))
