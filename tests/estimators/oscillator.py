"""A mass on a spring with an exact solution, and every estimator of it by name."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from scipy.linalg import expm

from flexid.estimators.online import OnlineEstimator
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.parametric_observer import parametric_observer, suggest_gains
from flexid.recording.recording import Hold

TRUE = {"spring": 4.0, "friction": 0.5, "gain": 2.0}
REGRESSORS = {"spring": "-q", "friction": "-v", "gain": "u"}
SAMPLE_TIME = 2e-3

BatchFit = LeastSquaresFit | PredictionErrorFit
Batch = Callable[..., BatchFit]
Builder = Callable[[ParametricSystem, Hold], OnlineEstimator]
Estimator = Callable[..., dict[str, float]]


def oscillator(names: Sequence[str] = (*TRUE,)) -> ParametricSystem:
    """Return the oscillator with coefficients in this order."""
    regressors = {name: REGRESSORS[name] for name in names}
    return ParametricSystem("oscillator", (Row("mass", "q", "v", regressors),))


def oscillation(
    duration: float, hold: Hold = "linear", noise: float = 0.0, seed: int = 0
) -> Samples:
    """Return exact samples from rest under two sines, held or linear between samples."""
    force, states = _states(round(duration / SAMPLE_TIME), hold, seed)
    measured = states + noise * np.random.default_rng(5 + seed).standard_normal(states.shape)
    return Samples(measured[:, :1], measured[:, 1:], force[:, None].copy(), SAMPLE_TIME)


@cache
def _states(n: int, hold: Hold, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the force, shape (n,), and states, shape (n, 2)."""
    h = SAMPLE_TIME
    slow, fast = np.random.default_rng(seed).uniform(0.0, 6.0, 2) if seed else (0.0, 0.0)
    time = np.arange(n) * h
    force = 3.0 * np.sin(1.1 * time + slow) + 4.0 * np.sin(3.7 * time + fast)
    # States q, v, u, u': within an interval the input starts at u with slope u'.
    rates = np.zeros((4, 4))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :3] = -TRUE["spring"], -TRUE["friction"], TRUE["gain"]
    over_interval = expm(rates * h)
    states = np.zeros((n, 2))
    for k in range(n - 1):
        slope = 0.0 if hold == "zero" else (force[k + 1] - force[k]) / h
        states[k + 1] = (over_interval @ [*states[k], force[k], slope])[:2]
    return force, states


def at_rest(duration: float, noise: float = 0.0, level: float = 0.3) -> Samples:
    """Return samples of the mass held at rest by a constant force."""
    n = round(duration / SAMPLE_TIME)
    positions, velocities = noise * np.random.default_rng(7).standard_normal((2, n, 1))
    force = np.full((n, 1), TRUE["spring"] * level / TRUE["gain"])
    return Samples(level + positions, velocities, force, SAMPLE_TIME)


def by_filter(recordings: Sequence[Samples], unknowns: Unknowns, **settings: Any) -> BatchFit:
    """Fit by state-variable-filter least squares."""
    return filtered_least_squares(recordings, unknowns.system, unknowns=unknowns, **settings)


def by_motion(recordings: Sequence[Samples], unknowns: Unknowns, **settings: Any) -> BatchFit:
    """Fit by segmented prediction error, started from the filter."""
    start = filtered_least_squares(recordings, unknowns.system, unknowns=unknowns, **settings)
    return prediction_error(recordings, unknowns.system, start, unknowns=unknowns, **settings)


def observer(system: ParametricSystem, hold: Hold) -> OnlineEstimator:
    """Return the parametric observer with suggested gains."""
    gains = suggest_gains(oscillation(20.0), system, convergence_rate=30.0)
    return parametric_observer(system, gains, SAMPLE_TIME, hold)


def recursive(system: ParametricSystem, hold: Hold) -> OnlineEstimator:
    """Return recursive least squares."""
    return recursive_least_squares(system, SAMPLE_TIME, hold=hold)


BATCH: Mapping[str, Batch] = {"least squares": by_filter, "prediction error": by_motion}

ONLINE: Mapping[str, Builder] = {"observer": observer, "recursive": recursive}
"""Builders by name; each takes the model and the hold of its input."""


def fitted(batch: Batch, samples: Samples, system: ParametricSystem, hold: Hold) -> dict:
    """Return values by name, from positions alone."""
    fit = batch([replace(samples, velocities=None)], Unknowns(system), hold=hold)
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def replayed(build: Builder, samples: Samples, system: ParametricSystem, hold: Hold) -> dict:
    """Return estimates by name after the last sample, started from zero."""
    built = build(system, hold)
    last = built.replay(built.init(), built.pack(samples)).coefficients[-1]
    return dict(zip(system.coefficients, last.tolist(), strict=True))


ALL: Mapping[str, Estimator] = {
    **{name: partial(fitted, batch) for name, batch in BATCH.items()},
    **{name: partial(replayed, build) for name, build in ONLINE.items()},
}
"""Every estimator as a function from samples, model and hold to values by name."""
