"""Fisher information of positions, against closed forms."""

import numpy as np
import pytest

from flexid.analysis.information import segmented_information
from flexid.errors import SimulationError
from flexid.estimators.samples import Samples
from flexid.estimators.segments import divide
from flexid.models.parametric_system import ParametricSystem, Row

CART = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u", "push": "1"}),))
H, N, NOISE = 0.01, 400, 1e-3


def cart_information(force, duration):
    """Information of the cart, held force, over segments of a duration."""
    samples = Samples(np.zeros((N, 1)), None, force[:, None], H)
    segments = divide([samples], duration)
    states = np.zeros((len(segments), 2))
    return segmented_information(
        CART, np.array([2.0, 0.3]), segments, states, np.array([NOISE]), "zero"
    )


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
    samples = Samples(np.zeros((N, 1)), None, np.zeros((N, 1)), H)
    segments = divide([samples], 4.0)
    with pytest.raises(SimulationError, match="diverges"):
        segmented_information(
            runaway, np.array([1e4]), segments, np.ones((1, 2)), np.array([NOISE]), "zero"
        )
