"""Unknowns: coefficients fixed, shared, tied, within bounds, or separate for each group."""

from functools import partial

import numpy as np
import pytest
from made_motion import fall, held_cart, point_of, problem_of
from noisy_joint import TRUTH, VALUES, encoders
from oscillator import by_filter
from scipy.optimize import least_squares

from flexid.estimators.state_variable_filter import (
    LeastSquaresFit,
    filtered_least_squares,
    filtered_signals,
)
from flexid.estimators.unknowns import Unknowns, bounded_fit
from flexid.identification.preparation.joint import flexible
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row

JOINT = flexible_joint()
MORE = flexible_joint(("gravity", "motor_viscous", "link_coulomb", "link_offset"))
PER_RUN = Unknowns(MORE, {"theta_coulomb": 0.0}, ("theta_offset",), (0, 1, 0))


RECORD = encoders(0)


def test_names_and_coefficients_of_a_recording():
    """Assert that a group's own coefficients take the place of shared ones, and fixed ones too."""
    assert PER_RUN.names == (
        *("theta1", "theta2", "theta_offset[1]", "theta_offset[2]"),
        *("alpha1", "alpha2", "beta1"),
    )
    unknowns = Unknowns(MORE, {"theta2": 9.0}, ("theta_offset",), (0, 1))
    p = unknowns.coefficients(np.arange(1.0, 8.0), 1)
    assert p.tolist() == [1.0, 9.0, 2.0, 4.0, 5.0, 6.0, 7.0]
    assert Unknowns(MORE, per_group=("theta_offset",), groups=(1, 1)).names == MORE.coefficients
    unknowns = PER_RUN.fixing({"theta_offset[2]": 0.25})
    assert "theta_offset[1]" in unknowns.names
    assert unknowns.coefficients(np.ones(6), 1)[3] == 0.25
    assert unknowns.coefficients(np.ones(6), 2)[3] == 1.0


DAMPED = flexible().systems[0]
ABSENT = {*DAMPED.coefficients} - {*TRUTH, "theta_damping", "alpha_damping"}
TIED = Unknowns(
    DAMPED,
    dict.fromkeys(ABSENT, 0.0),
    tied={"theta_damping": ("alpha_damping", "theta2", "alpha1")},
)


@pytest.mark.parametrize("fixed", [{}, {"alpha1": 300.0}, {"alpha_damping": 0.4}])
def test_derivatives_of_a_tie(fixed):
    """Assert derivatives by the unknowns against finite differences, for any fixed values.

    theta2/alpha1 = 0.3 in Table I, so 0.7/s on the motor are 0.21/s on the link.
    """
    unknowns = TIED.fixing(fixed)
    assert "theta_damping" not in unknowns.names
    values = np.array([{**TRUTH, "alpha_damping": 0.7}[name] for name in unknowns.names])
    expected = fixed.get("alpha_damping", 0.7) * 100.0 / fixed.get("alpha1", 1000.0 / 3.0)
    place = DAMPED.coefficients.index("theta_damping")
    assert unknowns.coefficients(values, 0)[place] == pytest.approx(expected, rel=1e-12)
    columns = []
    for place in range(len(values)):
        step = np.zeros(len(values))
        step[place] = 1e-6 * values[place]
        high, low = unknowns.coefficients(values + step, 0), unknowns.coefficients(values - step, 0)
        columns.append((high - low) / (2.0 * step[place]))
    expected = np.column_stack(columns)
    assert unknowns.derivatives(values, 0) == pytest.approx(expected, rel=1e-6, abs=1e-8)
    at_ones = unknowns.derivatives(np.ones(len(values)), 0)
    assert np.array_equal(at_ones != 0.0, expected != 0.0)


def test_a_tie_whose_source_is_off_is_off():
    """Assert that without the motor's damping the link has none, even for zero stiffness."""
    unknowns = TIED.fixing({"alpha_damping": 0.0})
    place = DAMPED.coefficients.index("theta_damping")
    for alpha1 in (300.0, 0.0):
        values = np.array([5.0, 100.0, alpha1, 0.3, 3.0])
        assert unknowns.coefficients(values, 0)[place] == 0.0
    for values in ([5.0, 100.0, 300.0, 0.3, 3.0], np.ones(5)):
        assert not unknowns.derivatives(values, 0)[place].any()


def test_a_motion_is_differentiated_by_what_is_tied():
    """Assert that the gradient includes the link's damping through its sources."""
    problem = problem_of(TIED, 3.0 * np.sin(0.05 * np.arange(200)), 0.01, substeps=2)
    at = point_of(
        [{**TRUTH, "alpha_damping": 3.0}[name] for name in TIED.names], 0.3, 0.0, 0.1, 1.0
    )
    gradient = problem.equations(at).gradient.sum(axis=0)
    for place, size in enumerate([*np.ones(4), *at.values]):
        assert gradient[place] == pytest.approx(fall(problem, at, place, 1e-5 * size), rel=1e-4)


BEYOND = {"theta2": (101.0, np.inf), "alpha2": (-np.inf, 0.3)}
CART = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u", "twin": "u", "push": "1"}),))


def cart(unknowns: Unknowns) -> LeastSquaresFit:
    """Fit the cart by least squares, once for each group; gain and twin are confounded."""
    carts = [held_cart()] * (len(unknowns.groups) or 1)
    return filtered_least_squares(carts, CART, unknowns=unknowns, hold="zero")


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
    """Assert that a general minimiser with these bounds gives the same coefficients."""
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
    fit, at_bound = bounded_fit(partial(by_filter, [RECORD]), Unknowns(JOINT), bounds)
    found = dict(zip(fit.names, fit.values.tolist(), strict=True)) | at_bound
    assert [found[name] for name in JOINT.coefficients] == pytest.approx(brute, rel=1e-5)
    assert at_bound


def test_what_the_data_leave_open_keeps_to_its_bounds():
    """Assert that bounds hold despite infinite variances, and for each group's coefficient."""
    fit, at_bound = bounded_fit(cart, Unknowns(CART), {"gain": (1.5, np.inf), "push": (0.0, 1.0)})
    assert at_bound == {"gain": 1.5}
    assert fit.names == ("twin", "push")
    assert fit.values == pytest.approx([0.5, 0.3], rel=1e-3)
    unknowns = Unknowns(CART, {"twin": 0.0}, ("push",), (0, 1))
    _, at_bound = bounded_fit(cart, unknowns, {"push": (0.4, 1.0)})
    assert at_bound == {"push[1]": 0.4, "push[2]": 0.4}
