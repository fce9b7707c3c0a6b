"""Coefficients that change while they are estimated: a load that is picked up."""

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


@cache
def payload() -> Samples:
    """Noisy encoders of a joint whose load is picked up after 15 s of 35 s."""
    inputs = torque(np.arange(CHANGE + 20_001) * SAMPLE_TIME)[:, None]
    before = free_run(JOINT, TRUTH, np.zeros(4), inputs[: CHANGE + 1], SAMPLE_TIME)
    after = free_run(JOINT, LOADED, before[-1], inputs[CHANGE:], SAMPLE_TIME)
    positions = np.concatenate((before[:-1], after))[:, ::2]
    noise = POSITION_NOISE * np.random.default_rng(4).standard_normal(positions.shape)
    return Samples(positions + noise, None, inputs, SAMPLE_TIME)


def replayed(memory_time: float) -> np.ndarray:
    """Coefficients of recursive least squares with that memory, sample by sample."""
    estimator = recursive_least_squares(JOINT, SAMPLE_TIME, memory_time=memory_time)
    return estimator.replay(estimator.init(), estimator.pack(payload())).coefficients


def test_a_payload_is_followed():
    """Assert that a memory of 2 s has theta2 within 5 % after 7 s, 1 % after 10 s, theta1 too.

    The motor's coefficients, which did not change, stay within 1 % throughout.
    """
    found = replayed(2.0)[CHANGE:]
    errors = np.abs(found / [*LOADED.values()] - 1.0)
    link = errors[:, :2].max(axis=1)
    assert link[0] > 0.3
    assert link[7_000:].max() < 0.05
    assert link[10_000:].max() < 0.01
    assert errors[:, 2:].max() < 0.01
