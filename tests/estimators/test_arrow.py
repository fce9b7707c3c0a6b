"""Elimination of the initial states against the same equations solved as a whole."""

import numpy as np
import pytest

from flexid.estimators.normal_equations import solve_arrow

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
