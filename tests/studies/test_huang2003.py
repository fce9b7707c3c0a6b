"""Huang (2003): its claims, Theorem 1 in three cases, and the readings of its control law."""

import numpy as np
import pytest

from flexid.estimators.excitation import LOST_CONDITION, WEAK_CONDITION
from flexid.studies.reproduction import Claim, Finding
from flexid.studies.runs import closed_loop_poles


@pytest.mark.parametrize(
    ("value", "relation", "expected"),
    [(1.0, "<=", True), (1.1, "<=", False), (0.9, ">=", False), (float("nan"), "<=", False)],
)
def test_a_finding_compares_its_value_with_the_limit(value, relation, expected):
    """Assert both relations, and that NaN does not confirm a finding."""
    assert Finding("any", "number", value, relation, 1.0).holds is expected


@pytest.mark.parametrize(
    ("values", "verdict"),
    [((0, 0), "holds"), ((2, 2), "does not hold"), ((0, 2), "depends on the reading")],
)
def test_verdict_of_a_claim(values, verdict):
    """Assert that a claim holds if all findings do, and depends on the reading if they differ."""
    findings = tuple(Finding(str(i), "number", value, "<=", 1.0) for i, value in enumerate(values))
    assert Claim("key", "here", "it is so", findings).verdict == verdict


@pytest.fixture
def cases(reproduction):
    """Return the cases by name."""
    return {case.name: case for case in reproduction.cases}


def test_errors_vanish_where_a4_holds(cases):
    """Assert that along Table I's reference, run for 300 s, all four errors converge to zero."""
    case = cases["(A4) holds"]
    assert case.worst_condition < WEAK_CONDITION
    assert case.vanished
    assert {limit.coefficient for limit in case.limits} == {"theta1", "theta2", "alpha1", "alpha2"}


def test_errors_settle_away_from_zero_at_standstill(cases):
    """Assert that at a constant reference errors become constant, three of four nonzero."""
    case = cases["(A4) fails: standstill"]
    assert case.settled
    left = {limit.coefficient: limit.last / limit.first for limit in case.limits}
    assert left["alpha1"] == pytest.approx(0.0, abs=1e-3)  # x1 - x3 is not zero, but x4 is
    assert left["alpha2"] > 0.9
    assert [left[name] for name in ("theta1", "theta2")] == pytest.approx([1.0, 1.0], rel=1e-5)


def test_small_sinusoid_leaves_the_direction_it_does_not_see(cases):
    """Assert that θ̃ settles on the part of θ̃(0) orthogonal to f.

    For a small amplitude f is proportional to (1, d) with d = (ω² - θ1)/θ2, from eq. (4.2); the
    first instants, with their other motion, move the limit by a few thousandths.
    """
    case = cases["(A4) nearly fails"]
    assert case.worst_condition > LOST_CONDITION
    assert case.settled
    unseen = np.array([-(25.0 - 5.0) / 100.0, 1.0])
    unseen /= np.linalg.norm(unseen)
    expected = unseen * (unseen @ [-2.5, -50.0])
    np.testing.assert_allclose([limit.last for limit in case.limits], expected, rtol=5e-3)


@pytest.mark.parametrize(
    ("exponents", "largest"),
    [((1, 1, 0), 13.8), ((1, 1, 1), 22.7), ((1, 1, 3), 0.011), ((1, 2, 3), -60.0)],
)
def test_largest_real_part_of_the_poles(exponents, largest):
    """Assert the largest real part in 1/s that the derived Jacobian gives each reading."""
    assert closed_loop_poles(exponents).real.max() == pytest.approx(largest, rel=5e-3, abs=5e-4)


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


@pytest.mark.parametrize(("reading", "expected"), [("1,2,3", 8.187e-4), ("1,1,3", 0.272)])
def test_largest_tracking_error_from_20_to_30_s(reproduction, reading, expected):
    """Assert the steady tracking error in rad of each reading that stays bounded for 30 s."""
    found = reproduction.runs[reading].max_tracking_error
    assert found == pytest.approx(expected, rel=2e-4)
