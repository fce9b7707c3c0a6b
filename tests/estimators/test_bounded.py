"""Fits that keep to bounds, against brute force."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_joint import VALUES, joint_samples
from scipy.optimize import least_squares

from flexid.estimators.bounded import bounded_fit
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.rowwise import LeastSquaresFit
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares, filtered_signals
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row

JOINT = flexible_joint()
ALL = Unknowns(JOINT)
RECORD = replace(joint_samples(0), velocities=None)
BEYOND = {"theta2": (101.0, np.inf), "alpha2": (-np.inf, 0.3)}
CART = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u", "twin": "u", "push": "1"}),))


def by_filter(unknowns: Unknowns) -> LeastSquaresFit:
    """Least squares of the noisy joint."""
    return filtered_least_squares([RECORD], JOINT, unknowns=unknowns)


def by_motion(unknowns: Unknowns) -> PredictionErrorFit:
    """Prediction error of the noisy joint, from least squares."""
    return prediction_error([RECORD], JOINT, by_filter(unknowns), unknowns=unknowns)


def cart_samples() -> Samples:
    """A cart with gain 2 and push 0.3, in closed form."""
    time = np.arange(1000) * 1e-2
    force = np.sin(time) + 0.5 * np.sin(2.7 * time)
    position = 0.15 * time**2 - 2.0 * np.sin(time) - np.sin(2.7 * time) / 2.7**2
    return Samples(position[:, None], None, force[:, None], 1e-2)


def cart(unknowns: Unknowns) -> LeastSquaresFit:
    """Least squares of the cart, whose gain and its twin cannot be distinguished."""
    return filtered_least_squares([cart_samples()], CART, unknowns=unknowns)


@pytest.mark.parametrize("fit_with", [by_filter, by_motion])
def test_a_value_beyond_its_bound_ends_at_it(fit_with):
    """Assert that the bound takes the place of the value, and the others follow from it."""
    fit, at_bound = bounded_fit(fit_with, ALL, {"alpha2": (0.4, 1.0)})
    assert at_bound == {"alpha2": 0.4}
    fixed = fit_with(ALL.fixing({"alpha2": 0.4}))
    assert fit.names == fixed.names
    assert np.array_equal(fit.values, fixed.values)
    assert np.array_equal(fit.covariance, fixed.covariance)


@pytest.mark.parametrize(
    "bounds",
    [
        BEYOND,
        {"theta1": (-np.inf, 4.9), "theta2": (0.0, 99.9)},
        {"beta1": (3.4, 4.0), "alpha1": (0.0, 335.0), "alpha2": (0.0, 10.0)},
        {"alpha1": (0.0, 330.0), "alpha2": (0.33, np.inf), "beta1": (0.0, 3.35)},
    ],
)
def test_brute_force_finds_the_same(bounds):
    """Assert that a general minimiser under the same bounds ends at the same coefficients."""
    signals = filtered_signals([RECORD], JOINT, 20.0, "linear")
    lower, upper = np.array([bounds.get(n, (-np.inf, np.inf)) for n in JOINT.coefficients]).T

    def residuals(p):
        link = signals[5] - p[:2] @ signals[:2]
        return np.concatenate((link, signals[6] - p[2:] @ signals[2:5]))

    brute = least_squares(
        residuals,
        np.clip(VALUES, lower + 1e-6, upper - 1e-6),
        bounds=(lower, upper),
        x_scale=VALUES,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    ).x
    fit, at_bound = bounded_fit(by_filter, ALL, bounds)
    found = dict(zip(fit.names, fit.values.tolist(), strict=True)) | at_bound
    assert [found[name] for name in JOINT.coefficients] == pytest.approx(brute, rel=1e-5)
    assert at_bound


def test_what_the_data_leave_open_keeps_to_its_bounds():
    """Assert that infinite variance does no harm: twins share what the bounds leave them."""
    fit, at_bound = bounded_fit(cart, Unknowns(CART), {"gain": (1.5, np.inf), "push": (0.0, 1.0)})
    assert at_bound == {"gain": 1.5}
    assert fit.names == ("twin", "push")
    assert fit.values == pytest.approx([0.5, 0.3], rel=1e-3)


def test_bounds_hold_in_every_group():
    """Assert that the bounds of a coefficient sought for each group bind each group's own."""
    unknowns = Unknowns(CART, {"twin": 0.0}, ("push",), (0, 1))
    bounds = {"push": (0.4, 1.0)}

    def fit_with(unknowns: Unknowns) -> LeastSquaresFit:
        return filtered_least_squares([cart_samples()] * 2, CART, unknowns=unknowns)

    _, at_bound = bounded_fit(fit_with, unknowns, bounds)
    assert at_bound == {"push[1]": 0.4, "push[2]": 0.4}
