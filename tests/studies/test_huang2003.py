"""Huang (2003): its claims, Theorem 1 in three cases, and the readings of its control law."""

import numpy as np
import pytest

from flexid.estimators.excitation import LOST_CONDITION
from flexid.studies.reproduction import Finding
from flexid.studies.runs import closed_loop_poles


@pytest.mark.parametrize(
    ("value", "relation", "expected"),
    [(1.0, "<=", True), (1.1, "<=", False), (0.9, ">=", False), (float("nan"), "<=", False)],
)
def test_a_finding_compares_its_value_with_the_limit(value, relation, expected):
    """Assert both relations, and that NaN does not confirm a finding."""
    assert Finding("any", "number", value, relation, 1.0).holds is expected


def test_errors_vanish_where_a4_holds(reproduction):
    """Assert that along Table I's reference, run for 300 s, all four errors converge to zero."""
    (case,) = (case for case in reproduction.cases if case.name == "(A4) holds")
    assert case.vanished
    assert {limit.coefficient for limit in case.limits} == {"theta1", "theta2", "alpha1", "alpha2"}


def test_small_sinusoid_leaves_the_direction_it_does_not_see(reproduction):
    """Assert that θ̃ settles on the part of θ̃(0) orthogonal to f.

    For a small amplitude f is proportional to (1, d) with d = (ω² - θ1)/θ2, from eq. (4.2); the
    first instants, with their other motion, move the limit by a few thousandths.
    """
    (case,) = (case for case in reproduction.cases if case.name == "(A4) nearly fails")
    assert case.worst_condition > LOST_CONDITION
    assert case.settled
    unseen = np.array([-(25.0 - 5.0) / 100.0, 1.0])
    unseen /= np.linalg.norm(unseen)
    expected = unseen * (unseen @ [-2.5, -50.0])
    np.testing.assert_allclose([limit.last for limit in case.limits], expected, rtol=5e-3)


@pytest.mark.parametrize(("exponents", "slope"), [((1, 2, 3), -1.17), ((2, 2, 3), -1.0)])
def test_a_square_in_the_second_gain_moves_the_poles_left(exponents, slope):
    """Assert that the slowest pole follows k, whether or not the stray 2 is read as a square."""
    for k in (200.0, 400.0, 800.0):
        assert closed_loop_poles(exponents, k).real.max() / k == pytest.approx(slope, abs=0.01)


def test_poles_are_those_of_the_plant_written_by_hand():
    """Assert that the derived loop has the poles of eq. (4) under u_F in plain coordinates."""
    k, first, second, third = 50.0, 50 * 1.4 / 60, 50.0**2, 50.0**3 * 0.42
    # u_F = -third (x4 + second (x3 + first (x2 + k x1))) at qd = 0, linearised.
    u = -third * np.array([second * first * k, second * first, second, 1.0])
    plant = np.array(
        [[0, 1, 0, 0], [-5 - 100, 0, 100, 0], [0, 0, 0, 1], [100 / 0.3, 0, -100 / 0.3, -0.1 / 0.3]]
    )
    plant[3] += u / 0.3
    expected = np.sort_complex(np.linalg.eigvals(plant))
    np.testing.assert_allclose(np.sort_complex(closed_loop_poles((1, 2, 3))), expected, rtol=1e-6)
