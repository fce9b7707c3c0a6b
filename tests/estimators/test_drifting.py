"""Coefficients that change while they are estimated: a load picked up, a spring that ages."""

from functools import cache

import numpy as np
from noisy_joint import POSITION_NOISE, SAMPLE_TIME, TRUTH, torque

from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import Samples
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run

JOINT = flexible_joint()
LOADED = TRUTH | {"theta2": TRUTH["theta2"] / 1.5}  # mgl and Jl half as large again
CHANGE = 15_000  # samples


def joined(parts) -> Samples:
    """Noisy encoders of a joint that has each set of coefficients for so many samples."""
    count = sum(n for _, n in parts)
    inputs = torque(np.arange(count + 1) * SAMPLE_TIME)[:, None]
    states = np.zeros((count + 1, 4))
    first = 0
    for coefficients, n in parts:
        part = slice(first, first + n + 1)
        states[part] = free_run(JOINT, coefficients, states[first], inputs[part], SAMPLE_TIME)
        first += n
    positions = states[:, ::2]
    noise = POSITION_NOISE * np.random.default_rng(4).standard_normal(positions.shape)
    return Samples(positions + noise, None, inputs, SAMPLE_TIME)


@cache
def payload() -> Samples:
    """The load is picked up after 15 s of 35 s."""
    return joined([(TRUTH, CHANGE), (LOADED, 20_000)])


def replayed(samples: Samples, memory_time: float):
    """History of recursive least squares with that memory."""
    estimator = recursive_least_squares(JOINT, SAMPLE_TIME, memory_time=memory_time)
    return estimator.replay(estimator.init(), estimator.pack(samples))


def test_a_payload_is_followed():
    """Assert that a memory of 2 s has theta2 within 5 % after 7 s, 1 % after 10 s, theta1 too.

    The motor's coefficients, which did not change, stay within 1 % throughout.
    """
    found = replayed(payload(), 2.0).coefficients[CHANGE:]
    errors = np.abs(found / [*LOADED.values()] - 1.0)
    link = errors[:, :2].max(axis=1)
    assert link[0] > 0.3
    assert link[7_000:].max() < 0.05
    assert link[10_000:].max() < 0.01
    assert errors[:, 2:].max() < 0.01


def test_a_shorter_memory_follows_faster_and_is_noisier():
    """Assert the trade: a memory of 1 s settles sooner than one of 4 s, and errs more before."""
    settled, errors = [], []
    for memory_time in (1.0, 4.0):
        found = replayed(payload(), memory_time).coefficients[:, 1]
        off = np.abs(found[CHANGE:] / LOADED["theta2"] - 1.0) > 0.02
        settled.append(np.flatnonzero(off)[-1])
        before = found[8_000:CHANGE] / TRUTH["theta2"] - 1.0
        errors.append(np.sqrt(np.mean(before**2)))
    assert settled[0] < 0.6 * settled[1]
    assert errors[0] > 1.3 * errors[1]


def test_an_ageing_spring_is_followed():
    """Assert that 10 % lost over 40 s is tracked by a memory of 2 s, and worse without."""
    slices = 400
    parts = []
    for place in range(slices):
        left = 1.0 - 0.1 * (place + 0.5) / slices
        aged = {name: left * TRUTH[name] for name in ("theta2", "alpha1")}
        parts.append((TRUTH | aged, 100))
    samples = joined(parts)
    truth = TRUTH["theta2"] * (1.0 - 0.1 * np.arange(len(samples)) / (100 * slices))
    late = slice(10_000, None)
    tracked = replayed(samples, 2.0)
    assert np.abs(tracked.coefficients[late, 1] / truth[late] - 1.0).max() < 0.01
    endless = recursive_least_squares(JOINT, SAMPLE_TIME)
    found = endless.replay(endless.init(), endless.pack(samples)).coefficients[-1, 1]
    assert abs(found / truth[-1] - 1.0) > 0.01
