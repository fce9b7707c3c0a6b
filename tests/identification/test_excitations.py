"""What a motion does not excite, on Gram matrices whose condition is known."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexid.identification.excitations import unexcited
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


def test_a_row_without_unknowns_loses_nothing():
    """Assert that a row in which all is given says nothing."""
    empty = SimpleNamespace(name="link", coefficients=(), gram=np.empty((0, 0)), count=1)
    assert unexcited([cast(Any, empty)], THRESHOLDS.lost_condition) == frozenset()
