"""How fast and how slow a filter may be."""

import numpy as np
import pytest
from noisy_joint import joint_samples, worst_error

from flexid.errors import SettingError
from flexid.estimators.filter_rate import FASTEST, check_filter_rate
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.models.flexible_joint import flexible_joint

JOINT = flexible_joint()


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


@pytest.mark.parametrize(
    ("rate", "beside", "words"),
    [
        (0.0099, {}, r"give 0\.01 to 500 1/s"),
        (501.0, {}, r"give 0\.01 to 500 1/s"),
        (-1.0, {}, r"give 0\.01 to 500 1/s"),
        (float("nan"), {}, r"give 0\.01 to 500 1/s"),
        (126.0, {"slowest": 0.25, "fastest": 4.0}, r"give 0\.04 to 125 1/s"),
    ],
)
def test_filters_that_do_not_suit(rate: float, beside: dict[str, float], words: str):
    """Assert that the sentence says which do, also of several side by side, and that these do."""
    with pytest.raises(SettingError, match=words):
        check_filter_rate(rate, 1e-3, **beside)
    check_filter_rate(0.0101, 1e-3)
    check_filter_rate(499.0, 1e-3)
