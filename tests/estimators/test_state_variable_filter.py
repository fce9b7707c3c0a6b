"""Least squares on positions through the state-variable filter."""

import numpy as np
import pytest
from noisy_joint import VALUES, clean_motion, encoders, joint_samples, torque, worst_error

from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.flexible_joint import flexible_joint

JOINT = flexible_joint()


@pytest.mark.parametrize(("first", "median", "largest"), [(0, 0.012, 0.04), (1000, 0.024, 0.08)])
def test_accuracy_on_the_noisy_joint(first, median, largest):
    """Assert the required accuracy, from rest and from a start in motion."""
    errors = [
        worst_error(filtered_least_squares([encoders(seed, first)], JOINT).values)
        for seed in range(20)
    ]
    assert np.median(errors) <= median
    assert np.max(errors) <= largest


def test_order_in_the_sample_time():
    """Assert fourth-order integration of smooth regressors: half the step, a 16th of the error."""
    time, states = clean_motion()
    errors = []
    for stride in (16, 8, 4):
        part = slice(0, None, stride)
        inputs = torque(time[part])[:, None]
        record = Samples(states[part][:, [0, 2]], None, inputs, 1e-3 * stride)
        values = filtered_least_squares([record], JOINT).values
        errors.append(abs(values[1] / VALUES[1] - 1.0))
    slopes = np.diff(np.log(errors)) / np.log(0.5)
    assert slopes == pytest.approx([4.0, 4.0], abs=0.25)


AT_REST = np.full((500, 2), 0.3), flexible_joint(("motor_viscous",))


@pytest.mark.parametrize(
    ("positions", "joint"),
    [*((joint_samples(0).positions[:n], JOINT) for n in (0, 2, 4, 5)), AT_REST],
)
def test_rest_and_few_samples_determine_nothing(positions, joint):
    """Assert that a joint at rest, or few samples, give infinite variances instead of an error."""
    short = Samples(positions, None, np.zeros((len(positions), 1)), 1e-3)
    fit = filtered_least_squares([short], joint)
    assert np.isfinite(fit.values).all()
    assert np.isinf(fit.standard_deviations).all()
