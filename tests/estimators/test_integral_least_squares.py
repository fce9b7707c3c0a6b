"""Least squares on positions by integrals over segments."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_joint import VALUES, clean_motion, joint_samples, torque, worst_error
from scipy.stats import t

from flexid.errors import SettingError
from flexid.estimators.integral_least_squares import integral_least_squares
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row

JOINT = flexible_joint()
CART = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u", "push": "1"}),))


def record(seed: int, first: int = 0) -> Samples:
    """The noisy joint as two encoders see it."""
    return replace(joint_samples(seed, first), velocities=None)


def pushed_cart(before: np.ndarray, after: np.ndarray, h: float = 0.01) -> Samples:
    """A cart of gain 2 whose force runs linearly over each interval, integrated exactly."""
    start, end = 2.0 * before + 0.3, 2.0 * after + 0.3
    velocity = np.concatenate(([0.7], 0.7 + h * np.cumsum(0.5 * (start + end))))
    step = h * velocity[:-1] + h * h * (start / 3.0 + end / 6.0)
    position = np.concatenate(([0.1], 0.1 + np.cumsum(step)))
    return Samples(position[:, None], None, np.append(before, after[-1])[:, None], h)


@pytest.mark.parametrize("duration", [0.5, 1.0])
@pytest.mark.parametrize("first", [0, 1000])
def test_accuracy_on_the_noisy_joint(duration, first):
    """Assert 0.02 and 0.06 % from rest and from motion, as it knows of no start."""
    errors = [
        worst_error(integral_least_squares([record(seed, first)], JOINT, duration).values)
        for seed in range(20)
    ]
    assert np.median(errors) <= 0.02
    assert np.max(errors) <= 0.06


def test_held_input_is_integrated_exactly():
    """Assert that hold "zero" makes no error at all where only the input accelerates."""
    force = np.random.default_rng(1).standard_normal(400)
    fit = integral_least_squares([pushed_cart(force, force)], CART, hold="zero")
    assert fit.values == pytest.approx([2.0, 0.3], rel=1e-9)
    wrong = integral_least_squares([pushed_cart(force, force)], CART, hold="linear")
    assert abs(wrong.values[0] / 2.0 - 1.0) > 1e-3


def test_linear_input_is_integrated_exactly():
    """Assert that hold "linear" makes no error where the input runs linearly in between."""
    force = np.random.default_rng(2).standard_normal(400)
    fit = integral_least_squares([pushed_cart(force[:-1], force[1:])], CART)
    assert fit.values == pytest.approx([2.0, 0.3], rel=1e-9)


def test_order_in_the_sample_time():
    """Assert order 4 where positions accelerate, and 2 where a linear input is a smooth one."""
    time, states = clean_motion()
    errors = []
    for stride in (16, 8, 4):
        part = slice(0, None, stride)
        sampled = Samples(states[part][:, [0, 2]], None, torque(time[part])[:, None], 1e-3 * stride)
        errors.append(np.abs(integral_least_squares([sampled], JOINT).values / VALUES - 1.0))
    slopes = np.diff(np.log(errors), axis=0) / np.log(0.5)
    assert slopes[:, :2] == pytest.approx(4.0, abs=0.25)
    assert slopes[:, 2:] == pytest.approx(2.0, abs=0.25)


def test_a_velocity_is_integrated_to_second_order():
    """Assert that friction, integrated once, converges with the square of the sample time."""
    drag = ParametricSystem("drag", (Row("cart", "q", "v", {"gain": "u", "drag": "-v"}),))
    errors = []
    for n in (500, 1000, 2000):
        time = np.linspace(0.0, 10.0, n + 1)
        position = np.sin(3.0 * time) + np.cos(1.3 * time)
        velocity = 3.0 * np.cos(3.0 * time) - 1.3 * np.sin(1.3 * time)
        acceleration = -9.0 * np.sin(3.0 * time) - 1.69 * np.cos(1.3 * time)
        force = 0.5 * (acceleration + 0.8 * velocity)
        samples = Samples(position[:, None], None, force[:, None], 10.0 / n)
        errors.append(abs(integral_least_squares([samples], drag).values[1] / 0.8 - 1.0))
    assert np.diff(np.log(errors)) / np.log(0.5) == pytest.approx([2.0, 2.0], abs=0.2)


def test_coverage():
    """Assert that nominal 95 % intervals hold the truth in 88 to 99 % of 200 cases.

    Forty seeds, five coefficients: were the cases independent, the standard error would be 1.5 %.
    """
    held = []
    for seed in range(40):
        fit = integral_least_squares([record(seed)], JOINT)
        quantile = t.ppf(0.975, np.array(fit.degrees_of_freedom))
        held.append(np.abs(fit.values - VALUES) <= quantile * fit.standard_deviations)
    assert 0.88 <= np.mean(held) <= 0.99


def test_the_filter_agrees():
    """Assert that both ways of least squares agree within their noise, which is another one."""
    for seed in range(10):
        integral = integral_least_squares([record(seed)], JOINT)
        filtered = filtered_least_squares([record(seed)], JOINT)
        noise = np.sqrt(np.diag(integral.covariance + filtered.covariance))
        assert np.all(np.abs(integral.values - filtered.values) < 3.0 * noise)
        assert not np.array_equal(integral.values, filtered.values)


def test_prediction_error_starts_from_it():
    """Assert that it serves as a start, and leads where the filter leads."""
    start = integral_least_squares([record(0)], JOINT)
    found = prediction_error([record(0)], JOINT, start)
    other = prediction_error([record(0)], JOINT, filtered_least_squares([record(0)], JOINT))
    assert found.values == pytest.approx(other.values, rel=1e-6)


def test_fixed_is_known():
    """Assert that a fixed coefficient does what a model with it known does."""
    unknowns = Unknowns(JOINT, {"beta1": VALUES[4]})
    fixed = integral_least_squares([record(1)], JOINT, unknowns=unknowns)
    known = integral_least_squares([record(1)], flexible_joint(known=unknowns.fixed))
    assert fixed.names == known.names
    assert fixed.values == pytest.approx(known.values, rel=1e-9)
    assert fixed.covariance == pytest.approx(known.covariance, rel=1e-6)


def test_segments_keep_to_their_recordings():
    """Assert that a record with a hole, and a run with an offset of its own, are fitted as well."""
    force = np.random.default_rng(3).standard_normal((2, 400))
    first, second = (pushed_cart(f, f) for f in force)
    aside = replace(second, positions=second.positions + 0.1 * (second.time**2)[:, None])
    unknowns = Unknowns(CART, per_group=("push",), groups=(0, 1))
    fit = integral_least_squares([first, aside], CART, hold="zero", unknowns=unknowns)
    assert fit.names == ("gain", "push[1]", "push[2]")
    assert fit.values == pytest.approx([2.0, 0.3, 0.5], rel=1e-9)


def test_rows_speak_of_positions():
    """Assert that Gram matrix, residual and series belong together, sample by sample."""
    fit = integral_least_squares([record(4)], JOINT, 0.5)
    link = fit.rows[0]
    assert len(link.time) == len(record(4))
    assert np.all(np.diff(link.time) > 0.0)
    assert link.residual_sum == pytest.approx(np.sum((link.left_hand_side - link.fitted) ** 2))
    assert fit.values[:2] @ link.gram @ fit.values[:2] == pytest.approx(np.sum(link.fitted**2))
    # What is left is the encoder's noise, 1e-4 rad.
    assert np.sqrt(link.residual_sum / len(link.time)) == pytest.approx(1e-4, rel=0.05)


def test_missing_velocities_are_named():
    """Assert that a term nonlinear in velocity says that it needs one, and which term it is."""
    with pytest.raises(SettingError, match="alpha_coulomb"):
        integral_least_squares([record(0)], flexible_joint(("motor_coulomb",)))


def test_equal_columns_are_undetermined():
    """Assert that two equal regressors get infinite variance and share their sum evenly."""
    twins = ParametricSystem("twins", (Row("cart", "q", "v", {"a": "u", "b": "u", "c": "1"}),))
    force = np.random.default_rng(4).standard_normal(400)
    fit = integral_least_squares([pushed_cart(force, force)], twins, hold="zero")
    assert fit.rows[0].undetermined == ("a", "b")
    assert np.isinf(fit.standard_deviations[:2]).all()
    assert fit.values == pytest.approx([1.0, 1.0, 0.3], rel=1e-6)
