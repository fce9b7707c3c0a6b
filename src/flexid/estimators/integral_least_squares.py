"""Least squares on positions by integrals over segments: a cross-check of the filter.

From the start t0 of a segment a row v' = rᵀp + k integrates twice to

    q(t) = q0 + v0 (t - t0) + (∬ r)ᵀp + ∬ k.

The start of the segment, q0 and v0, is unknown, and both sides are projected on what a straight
line cannot explain. What is left on the left is the position itself with its noise, white if the
encoder's is; no segment knows of another, and no setting but their length is to be chosen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.row_signals import check_velocities, row_signals, sought_signals
from flexid.estimators.rowwise import RowwiseFit, fit_rows
from flexid.estimators.samples import Samples
from flexid.estimators.segments import Segments, divide
from flexid.estimators.unknowns import Unknowns, unknowns_of
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class IntegralFit(RowwiseFit):
    """As `RowwiseFit`, of positions less straight lines.

    Parameters
    ----------
    segment_duration : float
        Wanted length of a segment in s.
    """

    segment_duration: float


def integral_least_squares(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    segment_duration: float = 1.0,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> IntegralFit:
    """Estimate coefficients from positions integrated over segments.

    Parameters
    ----------
    recordings : sequence of Samples
        One or more contiguous recordings of motion. Velocities are used only where a regressor is
        nonlinear in them.
    system : ParametricSystem
        The model; its constants have the values declared in it.
    segment_duration : float, optional
        Wanted length of a segment in s: a period or so of the slowest motion.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    unknowns : Unknowns, optional
        What is sought, if not every coefficient of the system from all recordings together.

    Returns
    -------
    IntegralFit
        A coefficient that the data leave free has infinite variance. The covariance has a segment
        as its block.

    Raises
    ------
    SettingError
        If the segment duration, the samples or the unknowns cannot be used, or a regressor that is
        nonlinear in velocities meets a recording without velocities and is not fixed at 0.
    """
    unknowns = unknowns_of(system, len(recordings), unknowns)
    segments = divide(recordings, segment_duration)
    used = np.unique(segments.recordings).tolist()
    check_velocities(recordings, used, unknowns)
    accelerations = [row_signals(recordings[place], system, hold) for place in used]
    lengths = segments.lengths.tolist()
    regressors, left_hand_sides = sought_signals(
        _positions(accelerations, segments), unknowns, segments.recordings.tolist(), lengths
    )
    time = [
        start + sample_time * np.arange(n)
        for start, sample_time, n in zip(
            segments.start_times, segments.sample_times, lengths, strict=True
        )
    ]
    values, rows = fit_rows(unknowns, regressors, left_hand_sides, np.concatenate(time))
    return IntegralFit(unknowns.names, values, rows, tuple(lengths), hold, float(segment_duration))


def _positions(accelerations: Sequence[FloatArray], segments: Segments) -> FloatArray:
    """Accelerations of the recordings summed up to positions, straight lines projected out.

    The accelerations are means over the triangle between a sample's neighbours, which is what the
    second difference of a position is. So their double sum is the position, but for a line.

    Returns
    -------
    array, shape (n_signals, n_samples)
        All segments in turn.
    """
    # A recording's first and last sample have no acceleration; a segment needs none at its ends.
    whole = np.concatenate([np.pad(signals, ((0, 0), (1, 1))) for signals in accelerations], axis=1)
    summed = np.zeros_like(whole)
    for start, length, sample_time in zip(
        segments.starts, segments.lengths, segments.sample_times, strict=True
    ):
        part = summed[:, start : start + length]
        inner = whole[:, start + 1 : start + length - 1]
        part[:, 2:] = sample_time**2 * np.cumsum(np.cumsum(inner, axis=1), axis=1)
        line, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), 2))
        part -= (part @ line) @ line.T
    return summed
