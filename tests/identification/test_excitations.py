"""What a motion does not excite, on Gram matrices whose condition is known."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexid.identification.excitations import row_excitation, unexcited
from flexid.identification.judgement import THRESHOLDS

SPRING = ("theta_cubic", "alpha_cubic", "theta_damping", "alpha_damping")


def row(names, correlation) -> Any:
    """A row whose first two regressors correlate."""
    gram = np.eye(len(names))
    gram[0, 1] = gram[1, 0] = correlation
    return SimpleNamespace(name="link", coefficients=tuple(names), gram=gram, count=1)


# Of two regressors with correlation c the condition number is (1 + c)/(1 - c).
@pytest.mark.parametrize(("condition", "lost"), [(0.9e5, False), (1.1e5, True)])
def test_a_condition_number_of_a_hundred_thousand_is_the_edge(condition, lost):
    """Assert that beyond it the confounded pair is lost, and what the spring couples with it."""
    correlation = (condition - 1.0) / (condition + 1.0)
    rows = [cast(Any, row(("theta1", "theta2", "theta_viscous"), correlation))]
    found = unexcited(rows, THRESHOLDS.lost_condition)
    assert found == (
        frozenset({"theta1", "theta2", "alpha1", "beta1", *SPRING}) if lost else frozenset()
    )


def made_row(zero: float, *, constant: bool, moved: float = 1e-3) -> Any:
    """Sums of a row whose spring's regressor has its zero elsewhere, over two logs."""
    rng = np.random.default_rng(8)
    gravity, deflection, viscous = rng.standard_normal((3, 400))
    first = np.arange(400) < 150
    columns = {"theta1": gravity, "theta2": moved * deflection + zero, "theta_viscous": viscous}
    if constant:
        columns |= {"theta_offset[0]": 1.0 * first, "theta_offset[1]": 1.0 * ~first}
    regressors = np.array([*columns.values()])
    gram = regressors @ regressors.T
    return SimpleNamespace(name="link", coefficients=tuple(columns), gram=gram, count=400)


@pytest.mark.parametrize("zero", [0.2, -6.3, 20.0])
def test_zeros_of_encoders_are_no_lack_of_motion(zero: float):
    """Assert that with constants sought the excitation is that of a deflection about its mean."""
    there, here = (row_excitation(made_row(z, constant=True), ()) for z in (zero, 0.0))
    assert there.condition_number == pytest.approx(here.condition_number, rel=1e-4)
    assert there.singular_values == pytest.approx(here.singular_values, rel=1e-4)
    assert unexcited([made_row(zero, constant=True)], THRESHOLDS.lost_condition) == frozenset()


@pytest.mark.parametrize("moved", [1e-6, 1e-12, 1e-16, 0.0])
def test_a_joint_that_does_not_bend_is_not_excited(moved: float):
    """Assert that noise and rounding of a deflection are no motion, though constants are sought."""
    row = made_row(0.3, constant=True, moved=moved)
    assert row_excitation(row, ()).condition_number > 1e9
    assert "theta2" in unexcited([row], THRESHOLDS.lost_condition)


def test_a_constant_deflection_without_constants_is_one():
    """Assert that nothing is taken off where no constant is sought."""
    near, far = (row_excitation(made_row(z, constant=False), ()) for z in (0.0, 6.0))
    assert far.level > 10.0 * near.level


def test_a_row_without_unknowns_loses_nothing():
    """Assert that a row in which all is given says nothing."""
    empty = SimpleNamespace(name="link", coefficients=(), gram=np.empty((0, 0)), count=1)
    assert unexcited([cast(Any, empty)], THRESHOLDS.lost_condition) == frozenset()
