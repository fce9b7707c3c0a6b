"""The paper's observer over a log, sample by sample, as it would run beside a drive."""

from collections.abc import Sequence

import numpy as np

from flexid.estimators.online import packed
from flexid.estimators.parametric_observer import parametric_observer, suggest_gains
from flexid.estimators.samples import samples_of_recording
from flexid.identification.result import ObserverTrace
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold, Recording

_KEPT = 2000  # samples of the trace that are kept for the figure


def stream(pieces: Sequence[Recording], system: ParametricSystem, hold: Hold) -> ObserverTrace:
    """Run the observer with suggested constant gains over pieces, one after the other.

    Parameters
    ----------
    pieces : sequence of Recording
        With velocities. The estimates at the end of one are where the next begins.
    system : ParametricSystem
        The model.
    hold : {"zero", "linear"}
        Behaviour of the input between samples.

    Returns
    -------
    ObserverTrace
        Starting from zero estimates.
    """
    all_samples = [samples_of_recording(piece) for piece in pieces]
    longest = max(all_samples, key=len)
    gains = suggest_gains(longest, system)
    values = dict.fromkeys(system.coefficients, 0.0)
    estimates = []
    for samples in all_samples:
        observer = parametric_observer(system, gains, samples.sample_time, hold)
        history = observer.replay(observer.init(values), packed(samples)).coefficients
        values = dict(zip(system.coefficients, map(float, history[-1]), strict=True))
        estimates.append(history)
    time = np.concatenate([piece.time for piece in pieces])
    thinning = max(1, len(time) // _KEPT)
    kept = np.r_[0 : len(time) - 1 : thinning, len(time) - 1]
    return ObserverTrace(time[kept], system.coefficients, np.concatenate(estimates)[kept], gains)
