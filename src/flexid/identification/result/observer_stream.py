"""The paper's observer over a log, sample by sample, as it would run next to a drive."""

from collections.abc import Sequence

import numpy as np

from flexid.estimators.online import packed
from flexid.estimators.parametric_observer import parametric_observer, suggest_gains
from flexid.estimators.samples import Samples
from flexid.estimators.unknowns import Unknowns
from flexid.identification.vocabulary.evidence import ObserverTrace
from flexid.recording.recording import Hold

_KEPT = 2000  # samples of the trace that are kept for the figure


def stream(recordings: Sequence[Samples], unknowns: Unknowns, hold: Hold) -> ObserverTrace:
    """Run the observer with suggested constant gains over recordings, one after the other.

    Returns of the coefficients that are sought, starting from zero estimates.
    """
    system = unknowns.system
    sought = [c for c in system.coefficients if c not in unknowns.fixed]
    gains = _gains(max(recordings, key=len), unknowns, sought)
    values = {c: unknowns.fixed.get(c, 0.0) for c in system.coefficients}
    estimates = []
    for samples in recordings:
        observer = parametric_observer(system, gains, samples.sample_time, hold)
        history = observer.replay(observer.init(values), packed(samples)).coefficients
        values = dict(zip(system.coefficients, map(float, history[-1]), strict=True))
        estimates.append(history)
    time = np.concatenate([samples.time for samples in recordings])
    thinning = max(1, len(time) // _KEPT)
    kept = np.r_[0 : len(time) - 1 : thinning, len(time) - 1]
    places = [system.coefficients.index(c) for c in sought]
    return ObserverTrace(
        time[kept],
        tuple(sought),
        np.concatenate(estimates)[np.ix_(kept, places)],
        {c: gains[c] for c in sought},
    )


def _gains(samples: Samples, unknowns: Unknowns, sought: Sequence[str]) -> dict[str, float]:
    """Suggested gains, shared among what is sought of each row; none for the rest."""
    suggested = suggest_gains(samples, unknowns.system)
    gains = dict.fromkeys(suggested, 0.0)
    for row in unknowns.system.rows:
        here = [c for c in row.coefficients if c in sought]
        gains |= {c: suggested[c] * len(row.coefficients) / len(here) for c in here}
    return gains
