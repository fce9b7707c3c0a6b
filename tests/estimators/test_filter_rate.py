"""The rate of the filter, chosen from the data."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_joint import joint_samples, worst_error

from flexid.estimators.filter_rate import candidate_rates, choose_filter_rate
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.flexible_joint import flexible_joint

JOINT = flexible_joint()


@pytest.mark.parametrize("seed", range(4))
def test_as_accurate_as_the_best_rate(seed):
    """Assert that on the right model the chosen rate meets the accuracy of the default one."""
    samples = joint_samples(seed)
    rate = choose_filter_rate([samples], JOINT)
    assert worst_error(filtered_least_squares([samples], JOINT, rate).values) <= 0.04


def test_noise_slows_the_filter():
    """Assert that a hundred times more noise brings a slower filter."""
    samples = joint_samples(0)
    noise = 1e-2 * np.random.default_rng(5).standard_normal(samples.positions.shape)
    noisy = replace(samples, positions=samples.positions + noise)
    assert choose_filter_rate([noisy], JOINT) < choose_filter_rate([samples], JOINT)


def test_candidates_suit_the_record():
    """Assert that candidates leave ten blocks at the slow end and samples at the fast end."""
    rates = candidate_rates([joint_samples()])
    assert rates[0] == pytest.approx(100.0 / 30.001)
    assert rates[-1] <= 500.0 < rates[-1] * np.sqrt(2.0)


def test_a_tiny_record_has_a_candidate():
    """Assert that ten samples still have one rate to offer."""
    samples = joint_samples()
    short = replace(samples, positions=samples.positions[:10], inputs=samples.inputs[:10])
    assert len(candidate_rates([short])) == 1
