"""Prediction error, block by block."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from noisy_joint import SAMPLE_TIME, VALUES, joint_samples, worst_error

from flexid.errors import SettingError
from flexid.estimators.block_prediction_error import block_prediction_error
from flexid.estimators.online import Status
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.models.flexible_joint import flexible_joint

JOINT = flexible_joint()


@cache
def replayed(seed: int | None, **settings):
    """History over the noisy record without its velocities, and the estimator."""
    estimator = block_prediction_error(JOINT, SAMPLE_TIME, **settings)
    samples = replace(joint_samples(seed), velocities=None)
    return estimator.replay(estimator.init(), estimator.pack(samples)), estimator


def test_accuracy():
    """Assert 0.003 % at the end, median of 20 seeds of the worst coefficient, encoders only."""
    last = [worst_error(replayed(seed)[0].coefficients[-1]) for seed in range(20)]
    assert np.median(last) <= 0.003


def test_least_squares_until_the_first_block():
    """Assert that in the first second the estimates are those of recursive least squares."""
    history, estimator = replayed(0)
    least_squares = recursive_least_squares(JOINT, SAMPLE_TIME)
    alone = least_squares.replay(
        least_squares.init(), estimator.pack(joint_samples(0))[: estimator.block_samples - 1]
    )
    count = len(alone.coefficients)
    assert np.array_equal(history.coefficients[:count], alone.coefficients)
    assert not np.array_equal(history.coefficients[count], alone.coefficients[-1])


def test_still_between_blocks():
    """Assert that estimates change at the end of a block only, once the first one is done."""
    history, _ = replayed(0)
    changed = np.flatnonzero(np.any(np.diff(history.coefficients[1000:], axis=0) != 0.0, axis=1))
    assert np.all((changed + 2) % 1000 == 0)
    assert len(changed) == 29


def test_standard_deviations_are_those_of_the_errors():
    """Assert that errors over 20 seeds are as large as their standard deviations, within 40 %."""
    ratios = []
    for seed in range(20):
        history, estimator = replayed(seed)
        deviations = estimator.standard_deviations(history.state)
        ratios.append((history.coefficients[-1] - VALUES) / deviations)
    sizes = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((sizes > 0.6) & (sizes < 1.4))


def test_a_wrong_estimate_is_replaced_by_least_squares():
    """Assert that an estimate that least squares contradicts is named, and given up."""
    history, estimator = replayed(0)
    state = history.state.copy()
    place = len(estimator.least_squares.init()) + 3
    assert np.array_equal(state[place : place + 5], history.coefficients[-1])
    state[place : place + 5] *= 10.0
    samples = estimator.pack(joint_samples(0))[-6000:]
    state, _ = estimator.step(state, np.full(3, np.nan))
    after = estimator.replay(state, samples)
    named = np.flatnonzero(after.status == Status.CONTRADICTED)
    assert len(named) == 1
    assert worst_error(after.coefficients[-1]) < 0.1


def test_forgetting_costs_accuracy():
    """Assert that with a memory of 3 s the deviations grow and the end is within 0.05 %."""
    lasting, estimator = replayed(0)
    fading, forgetful = replayed(0, memory_time=3.0)
    ratio = forgetful.standard_deviations(fading.state) / estimator.standard_deviations(
        lasting.state
    )
    assert np.all(ratio > 1.2)
    assert worst_error(fading.coefficients[-1]) < 0.05


@pytest.mark.parametrize("duration", [0.0, 0.01, float("nan"), float("inf")])
def test_blocks_that_are_none(duration):
    """Assert that a block too short, or of no length, is refused."""
    with pytest.raises(SettingError, match="block duration"):
        block_prediction_error(JOINT, SAMPLE_TIME, block_duration=duration)
