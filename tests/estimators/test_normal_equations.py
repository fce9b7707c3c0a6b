"""Normal equations: of segments, against those of the whole, and beside values that are zero."""

import numpy as np
import pytest

from flexid.estimators.normal_equations import least_with, solve_arrow

N_SEGMENTS, N_STATES, N_COEFFICIENTS = 5, 4, 3


def random_problem(seed: int = 2) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Derivatives and residuals of every segment."""
    generator = np.random.default_rng(seed)
    size = N_STATES + N_COEFFICIENTS
    derivatives = [generator.standard_normal((30, size)) for _ in range(N_SEGMENTS)]
    residuals = [generator.standard_normal(30) for _ in range(N_SEGMENTS)]
    return derivatives, residuals


def equations(derivatives, residuals):
    """Normal matrices and right-hand sides, segment by segment."""
    return (
        np.array([d.T @ d for d in derivatives]),
        np.array([d.T @ r for d, r in zip(derivatives, residuals, strict=True)]),
    )


def whole(derivatives, residuals) -> tuple[np.ndarray, np.ndarray]:
    """One matrix for all unknowns, initial states first, and one right-hand side."""
    states = N_SEGMENTS * N_STATES
    matrix = np.zeros((30 * N_SEGMENTS, states + N_COEFFICIENTS))
    for s, d in enumerate(derivatives):
        rows = slice(30 * s, 30 * (s + 1))
        matrix[rows, N_STATES * s : N_STATES * (s + 1)] = d[:, :N_STATES]
        matrix[rows, states:] = d[:, N_STATES:]
    return matrix, np.concatenate(residuals)


def test_solution_and_inverse_of_the_whole():
    """Assert that eliminating and solving at once give one step, one fall and one inverse."""
    derivatives, residuals = random_problem()
    matrix, right = whole(derivatives, residuals)
    expected = np.linalg.lstsq(matrix, right, rcond=None)[0]
    reduced = solve_arrow(*equations(derivatives, residuals), N_STATES)
    step = np.concatenate((reduced.states_step.ravel(), reduced.values_step))
    assert step == pytest.approx(expected, rel=1e-9)
    fall = right @ right - np.sum((right - matrix @ expected) ** 2)
    assert reduced.decrement == pytest.approx(fall, rel=1e-9)

    expected = np.linalg.inv(matrix.T @ matrix)[-N_COEFFICIENTS:, -N_COEFFICIENTS:]
    assert reduced.inverse == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert reduced.information @ expected == pytest.approx(np.eye(N_COEFFICIENTS), abs=1e-9)


def test_what_each_state_explains_alone():
    """Assert that its part is the fall of its segment's sum, fitted without the coefficients."""
    derivatives, residuals = random_problem()
    reduced = solve_arrow(*equations(derivatives, residuals), N_STATES)
    for d, r, fall in zip(derivatives, residuals, reduced.by_states, strict=True):
        own = d[:, :N_STATES]
        left = r - own @ np.linalg.lstsq(own, r, rcond=None)[0]
        assert fall == pytest.approx(r @ r - left @ left, rel=1e-9)


def test_damping_multiplies_the_diagonal():
    """Assert that damping is Levenberg and Marquardt's of all unknowns together."""
    derivatives, residuals = random_problem()
    matrix, right = whole(derivatives, residuals)
    normal = matrix.T @ matrix
    expected = np.linalg.solve(normal + 0.5 * np.diag(np.diag(normal)), matrix.T @ right)
    reduced = solve_arrow(*equations(derivatives, residuals), N_STATES, damping=0.5)
    assert reduced.values_step == pytest.approx(expected[-N_COEFFICIENTS:], rel=1e-9)
    assert reduced.states_step.ravel() == pytest.approx(expected[:-N_COEFFICIENTS], rel=1e-9)


def test_a_direction_that_initial_states_explain_is_free():
    """Assert that a coefficient that only repeats an initial state is free, and the others not."""
    derivatives, residuals = random_problem()
    for d in derivatives:
        d[:, -1] = d[:, 0] - 2.0 * d[:, 1]
    reduced = solve_arrow(*equations(derivatives, residuals), N_STATES)
    assert reduced.free.tolist() == [False, False, True]
    assert reduced.values_step[-1] == pytest.approx(0.0, abs=1e-9)


def test_the_rest_follows_what_is_zero():
    """Assert that the form's gradient vanishes where values are sought, whatever their units."""
    rng = np.random.default_rng(5)
    factor = rng.normal(size=(5, 5)) * np.array([1e-3, 1.0, 1e3, 10.0, 1.0])
    matrix, values = factor.T @ factor, rng.normal(size=5)
    left = np.array([True, False, True, True, False])
    found = least_with(left, matrix, values)
    whole = np.zeros(5)
    whole[left] = found.values
    gradient = matrix @ (whole - values)
    scale = np.abs(matrix) @ np.abs(values)
    assert np.abs(gradient[left] / scale[left]).max() < 1e-10
    assert np.abs(gradient[~left] / scale[~left]).max() > 1e-3
    part = matrix[np.ix_(left, left)]
    units = np.sqrt(np.outer(np.diag(part), np.diag(part)))
    assert (found.inverse * units) @ (part / units) == pytest.approx(np.eye(3), abs=1e-10)
    assert not found.free.any()


def test_nothing_moves_along_an_open_direction():
    """Assert that of two values whose sum alone counts each takes half of what the third leaves.

    Their difference stays what it was, and both are free.
    """
    columns = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 2.0]])
    values = np.array([1.0, 3.0, 0.5])
    found = least_with(np.array([True, True, False]), columns.T @ columns, values)
    assert found.values == pytest.approx([1.25, 3.25])
    assert found.free.tolist() == [True, True]


def test_without_zeros_all_stays():
    """Assert that values stay where they are, those of which the form knows nothing as well."""
    values = np.array([2.0, 7.0])
    found = least_with(np.array([True, True]), np.diag([4.0, 0.0]), values)
    assert found.values.tolist() == [2.0, 7.0]
    assert found.free.tolist() == [False, True]
