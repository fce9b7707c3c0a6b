"""All online estimators, built alike, and motions of an oscillator that is solved exactly."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.linalg import expm

from flexid.estimators.online import OnlineEstimator
from flexid.estimators.parametric_observer import parametric_observer, suggest_gains
from flexid.estimators.recursive_least_squares import (
    recursive_least_squares,
)
from flexid.estimators.samples import Samples
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.recording.recording import Hold

TRUE = {"spring": 4.0, "friction": 0.5, "gain": 2.0}
REGRESSORS = {"spring": "-q", "friction": "-v", "gain": "u"}
SAMPLE_TIME = 2e-3
Builder = Callable[[ParametricSystem, Hold], OnlineEstimator]


def _observer(system: ParametricSystem, hold: Hold) -> OnlineEstimator:
    gains = suggest_gains(oscillator_motion(20.0), system, convergence_rate=30.0)
    return parametric_observer(system, gains, SAMPLE_TIME, hold)


def _least_squares(velocities: bool, system: ParametricSystem, hold: Hold) -> OnlineEstimator:
    return recursive_least_squares(system, SAMPLE_TIME, hold=hold, velocities=velocities)


ONLINE: dict[str, Builder] = {
    "parametric observer": _observer,
    "recursive least squares": lambda s, hold: recursive_least_squares(s, SAMPLE_TIME, hold=hold),
    "least-squares observer": lambda s, hold: recursive_least_squares(
        s, SAMPLE_TIME, hold=hold, velocities=True
    ),
}
"""Builders by name; each takes the model and the hold of its input."""


def oscillator(names=("spring", "friction", "gain"), known: float | None = None):
    """A mass on a spring; with a known gain the input is the row's known part."""
    regressors = {name: REGRESSORS[name] for name in names if known is None or name != "gain"}
    part = "0" if known is None else f"{known}*u"
    return ParametricSystem("oscillator", (Row("mass", "q", "v", regressors, part),))


def oscillator_motion(duration: float, hold: Hold = "linear", noise: float = 0.0) -> Samples:
    """The oscillator from rest under two sines, held or linear between samples, to rounding."""
    force, states = _oscillator_states(round(duration / SAMPLE_TIME), hold)
    measured = states + noise * np.random.default_rng(5).standard_normal(states.shape)
    return Samples(measured[:, :1], measured[:, 1:], force[:, None].copy(), SAMPLE_TIME)


@cache
def _oscillator_states(n: int, hold: Hold) -> tuple[np.ndarray, np.ndarray]:
    """Force, shape (n,), and states, shape (n, 2)."""
    h = SAMPLE_TIME
    time = np.arange(n) * h
    force = 3.0 * np.sin(1.1 * time) + 4.0 * np.sin(3.7 * time)
    # States q, v, u, u': over an interval the input runs from u at the slope u'.
    rates = np.zeros((4, 4))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :3] = -TRUE["spring"], -TRUE["friction"], TRUE["gain"]
    over_interval = expm(rates * h)
    states = np.zeros((n, 2))
    for k in range(n - 1):
        slope = 0.0 if hold == "zero" else (force[k + 1] - force[k]) / h
        states[k + 1] = (over_interval @ [*states[k], force[k], slope])[:2]
    return force, states


def with_rest(samples: Samples, duration: float, noise: float, level: float = 0.3) -> Samples:
    """The motion, a missing sample, then the mass held still by a constant force, with noise."""
    n = round(duration / samples.sample_time)
    generator = np.random.default_rng(7)
    positions = level + noise * generator.standard_normal((n, 1))
    velocities = noise * generator.standard_normal((n, 1))
    force = np.full((n, 1), TRUE["spring"] * level / TRUE["gain"])
    missing = np.full((1, 1), np.nan)
    assert samples.velocities is not None
    return replace(
        samples,
        positions=np.concatenate((samples.positions, missing, positions)),
        velocities=np.concatenate((samples.velocities, missing, velocities)),
        inputs=np.concatenate((samples.inputs, missing, force)),
    )
