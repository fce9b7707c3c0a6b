"""Estimates, and intervals of coefficients and by the delta method of physical parameters."""

import numpy as np
import pytest
from scipy.stats import t

import flexid.identification.vocabulary.estimate as intervals
from flexid.errors import SettingError
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.physical import physical_parameters

NAMES = ("theta1", "theta2", "alpha1", "alpha2", "beta1")
VALUES = np.array([5.0, 100.0, 1000 / 3, 1 / 3, 10 / 3])


def made(
    values: np.ndarray,
    covariance: np.ndarray,
    names: tuple[str, ...] = NAMES,
    degrees_of_freedom: tuple[float, ...] = (np.inf,) * 5,
) -> Estimate:
    """A fit of which only the result is known."""
    return Estimate(names, values, covariance, degrees_of_freedom)


def of(name: str, fit: Estimate) -> intervals.Propagated:
    """Propagate a fit, the truth standing for what was given."""
    (own,) = (p for p in physical_parameters(NAMES, input_is_torque=True) if p.name == name)
    values = dict(zip(NAMES, VALUES.tolist(), strict=True))
    return intervals.propagated(own, {**values, **fit.by_name}, fit)


def test_symmetrical_interval_is_students():
    """Assert that the half-width is Student's quantile times the standard deviation."""
    low, high = intervals.interval(3.0, 0.5, 7.5)
    assert (high - low) / 2 == pytest.approx(0.5 * t.ppf(0.975, 7.5))
    assert (high + low) / 2 == pytest.approx(3.0)
    assert intervals.interval(0.0, 1.0, np.inf)[1] == pytest.approx(1.959964, rel=1e-6)


@pytest.mark.parametrize(
    ("std", "freedom", "ends", "logarithmic"),
    [
        (np.inf, 5.0, (-np.inf, np.inf), (0.0, np.inf)),
        (1.0, 0.0, (-np.inf, np.inf), (0.0, np.inf)),
        (np.inf, 0.0, (-np.inf, np.inf), (0.0, np.inf)),
        (0.0, 0.0, (2.0, 2.0), (2.0, 2.0)),
    ],
)
def test_nothing_known_is_the_whole_line(std, freedom, ends, logarithmic):
    """Assert that no information gives every number, or every positive one on the logarithm."""
    assert intervals.interval(2.0, std, freedom) == ends
    assert intervals.logarithmic_interval(2.0, std, freedom) == logarithmic


def test_delta_method_of_a_ratio():
    """Assert that the stiffness' relative variance is that of the difference of logarithms."""
    covariance = np.diag((0.01 * VALUES) ** 2)
    covariance[2, 4] = covariance[4, 2] = 0.5 * 1e-4 * VALUES[2] * VALUES[4]
    found = of("joint_stiffness", made(VALUES, covariance))
    assert found.value == pytest.approx(100.0)
    assert found.std == pytest.approx(100.0 * np.sqrt(1e-4 + 1e-4 - 2 * 0.5e-4))
    assert not found.logarithmic


def test_the_least_known_coefficient_decides():
    """Assert that of those involved the fewest degrees of freedom and infinite variances count."""
    covariance = np.diag((0.01 * VALUES) ** 2)
    fit = made(VALUES, covariance, degrees_of_freedom=(2.0, 9.0, 8.0, 2.0, 7.0))
    assert of("joint_stiffness", fit).degrees_of_freedom == 7.0
    covariance[4, 4] = np.inf
    found = of("motor_inertia", made(VALUES, covariance))
    assert (found.std, found.interval) == (np.inf, (0.0, np.inf))
    fit = made(VALUES[:4], np.eye(4), NAMES[:4], (5.0,) * 4)
    assert of("motor_inertia", fit).interval == (0.3, 0.3)


@pytest.mark.parametrize(
    ("name", "fitted", "expected"),
    [
        ("motor_inertia", NAMES, True),
        ("link_inertia", NAMES, True),
        ("link_inertia", NAMES[:4], False),  # alpha1 / theta2, beta1 being given
        ("joint_stiffness", NAMES, False),
        ("joint_stiffness", NAMES[:4], False),
        ("gravity_torque", NAMES, False),
        ("motor_viscous_friction", NAMES, False),
    ],
)
def test_logarithm_where_division_prevails(name, fitted, expected):
    """Assert that positive coefficients of negative degree in all get it, and no others."""
    k = len(fitted)
    fit = made(VALUES[:k], np.diag((0.1 * VALUES[:k]) ** 2), fitted, (20.0,) * k)
    assert of(name, fit).logarithmic is expected


def test_interval_on_the_logarithm():
    """Assert that it is the value times and over one factor, and so above zero at any width."""
    fit = made(VALUES, np.diag((0.8 * VALUES) ** 2))
    low, high = of("motor_inertia", fit).interval
    assert low * high == pytest.approx(0.3**2)
    assert np.log(high / 0.3) == pytest.approx(1.959964 * 0.8, rel=1e-6)
    assert low > 0.0


@pytest.mark.parametrize("logarithmic", [False, True])
def test_an_interval_has_any_level(logarithmic):
    """Assert that a value's interval is that of Student's t at the level asked for."""
    level, freedom = 0.8, 7.0
    half = t.ppf(0.5 + level / 2, freedom) * 0.3
    found = ValueEstimate(
        "x", "m", 2.0, 0.3, (1.0, 3.0), "weak", "", freedom, logarithmic
    ).interval_at(level)
    ends = 2.0 * np.exp(np.array([-half, half]) / 2.0) if logarithmic else (2.0 - half, 2.0 + half)
    assert found == pytest.approx(tuple(ends), rel=1e-12)


@pytest.mark.parametrize("level", [0.0, 1.0, 95, -0.5, float("nan"), "0.95"])
def test_what_is_no_level_is_refused(level):
    """Assert that a percentage or a text is answered with what a level is."""
    with pytest.raises(SettingError, match=r"0\.95"):
        ValueEstimate("x", "m", 2.0, 0.3, (1.0, 3.0), "weak").interval_at(level)


COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, np.inf]])
ESTIMATE = Estimate(("a", "b", "c"), np.array([1.0, 2.0, 3.0]), COVARIANCE, (5.0, 7.0, 0.0))


def test_widening_adds_covariances_and_scaling_keeps_correlations():
    """Assert both, that values and freedom stay, and that what is free stays so, uncorrelated."""
    assert ESTIMATE.deviations.tolist() == [2.0, 3.0, np.inf]
    for more in (2.0, np.nan_to_num(np.inf)):
        found = ESTIMATE.widened(np.array([[1.0, 0.5, more], [0.5, 2.0, more], [more] * 3]))
        assert found.covariance[:2, :2].tolist() == [[5.0, 1.5], [1.5, 11.0]]
        assert found.covariance[2].tolist() == [0.0, 0.0, np.inf]
        assert found.values is ESTIMATE.values
        assert found.degrees_of_freedom == ESTIMATE.degrees_of_freedom
    found = ESTIMATE.scaled(np.array([2.0, 3.0, 5.0]))
    assert found.deviations.tolist() == [4.0, 9.0, np.inf]
    assert found.covariance[0, 1] == 6.0
    assert found.covariance[2, :2].tolist() == [0.0, 0.0]
