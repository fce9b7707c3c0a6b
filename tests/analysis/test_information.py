"""Fisher information of positions, against closed forms."""

import numpy as np
import pytest

from flexid.analysis.information import information_at
from flexid.errors import SimulationError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, segmented_motion
from flexid.estimators.segments import divide
from flexid.models.parametric_system import ParametricSystem, Row

CART = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u", "push": "1"}),))
H, N, NOISE = 0.01, 400, 1e-3


def information(system, values, force, duration, start):
    """Information of a system, held force, over segments of a duration from one state."""
    segments = divide([Samples(np.zeros((N, 1)), None, force[:, None], H)], duration)
    point = Point(np.array(values), np.tile(start, (len(segments), 1)))
    problem = segmented_motion(system, segments, Timing("zero"))
    return information_at(problem.at(point, np.array([1.0 / NOISE])), point)


def cart_information(force, duration):
    """That of the cart, from rest."""
    return information(CART, [2.0, 0.3], force, duration, np.zeros(2))


def test_closed_form_of_a_cart():
    """Assert that the bound is that of a linear regression with free start and speed."""
    force = np.random.default_rng(3).standard_normal(N)
    t = H * np.arange(N)
    velocity = np.concatenate(([0.0], H * np.cumsum(force[:-1])))
    position = np.concatenate(([0.0], np.cumsum(H * velocity[:-1] + 0.5 * H * H * force[:-1])))
    columns = np.column_stack([np.ones(N), t, position, 0.5 * t * t])
    expected = NOISE**2 * np.linalg.inv(columns.T @ columns)[2:, 2:]
    found = cart_information(force, N * H)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-6)
    np.testing.assert_allclose(found.relative_deviations, np.sqrt(np.diag(expected)) / [2.0, 0.3])


def test_shorter_segments_tell_less():
    """Assert that every unknown initial state costs information."""
    force = np.random.default_rng(3).standard_normal(N)
    whole, parts = cart_information(force, 4.0), cart_information(force, 1.0)
    assert (np.linalg.eigvalsh(whole.matrix - parts.matrix) > 0).all()


def test_two_names_for_one_push():
    """Assert that a constant force confounds gain and push: no bound."""
    found = cart_information(np.ones(N), 4.0)
    assert np.isinf(found.standard_deviations).all()


def test_a_motion_that_runs_away():
    """Assert that a diverging model is an error, not a number."""
    runaway = ParametricSystem("runaway", (Row("arm", "q", "v", {"a": "q"}),))
    with pytest.raises(SimulationError, match="diverges"):
        information(runaway, [1e4], np.zeros(N), 4.0, np.ones(2))
