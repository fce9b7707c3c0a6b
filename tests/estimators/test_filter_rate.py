"""The rate of the filter, chosen from the data."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_joint import joint_samples, worst_error

from flexid.errors import SettingError
from flexid.estimators.filter_rate import (
    FASTEST,
    candidate_rates,
    check_filter_rate,
    choose_filter_rate,
)
from flexid.estimators.recursive_least_squares import recursive_least_squares
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


def test_the_fastest_filter_is_about_the_fastest_that_noise_allows():
    """Assert that noise makes a bias of a thousandth there, ten times that four times beyond."""
    samples = joint_samples()
    noise = 1e-4 * np.random.default_rng(3).standard_normal(samples.positions.shape)
    rows = np.column_stack((samples.positions + noise, samples.inputs))

    def error(product: float) -> float:
        h = samples.sample_time
        estimator = recursive_least_squares(JOINT, h, product / h)
        return worst_error(estimator.coefficients(estimator.replay(estimator.init({}), rows).state))

    assert error(FASTEST) < 0.3
    assert error(4.0 * FASTEST) > 10.0 * error(FASTEST)


@pytest.mark.parametrize("rate", [0.0099, 501.0, -1.0, float("nan")])
def test_filters_that_do_not_suit(rate):
    """Assert that the sentence says which do, and that these do."""
    with pytest.raises(SettingError, match=r"give 0\.01 to 500 1/s"):
        check_filter_rate(rate, 1e-3)
    check_filter_rate(0.0101, 1e-3)
    check_filter_rate(499.0, 1e-3)


def test_filters_beside_it_count():
    """Assert that neither the slowest nor the fastest of several may be beyond the limits."""
    with pytest.raises(SettingError, match=r"give 0\.04 to 125 1/s"):
        check_filter_rate(126.0, 1e-3, slowest=0.25, fastest=4.0)
