"""Block normal equations against the dense problem, symmetric matrices, Gauss-Newton's end."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexid.errors import ConvergenceError
from flexid.estimators.normal_equations import (
    eigen,
    least_with,
    pseudo_inverse,
    scaled_inverse,
    solve_arrow,
)
from flexid.estimators.prediction_error import FLAT, ITERATIONS, Steps, minimise
from flexid.estimators.segmented_motion import By, Point

N_SEGMENTS, N_STATES, N_COEFFICIENTS = 5, 4, 3


def random_problem(seed: int = 2) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return derivatives and residuals of every segment."""
    generator = np.random.default_rng(seed)
    size = N_STATES + N_COEFFICIENTS
    derivatives = [generator.standard_normal((30, size)) for _ in range(N_SEGMENTS)]
    residuals = [generator.standard_normal(30) for _ in range(N_SEGMENTS)]
    return derivatives, residuals


def blockwise(derivatives, residuals):
    """Return normal matrices and right-hand sides by segment."""
    return (
        np.array([d.T @ d for d in derivatives]),
        np.array([d.T @ r for d, r in zip(derivatives, residuals, strict=True)]),
    )


def whole(derivatives, residuals) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix of all unknowns, initial states first, and the right-hand side."""
    states = N_SEGMENTS * N_STATES
    matrix = np.zeros((30 * N_SEGMENTS, states + N_COEFFICIENTS))
    for s, d in enumerate(derivatives):
        rows = slice(30 * s, 30 * (s + 1))
        matrix[rows, N_STATES * s : N_STATES * (s + 1)] = d[:, :N_STATES]
        matrix[rows, states:] = d[:, N_STATES:]
    return matrix, np.concatenate(residuals)


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_solution_and_inverse_of_the_whole(damping: float):
    """Assert that elimination gives the step, decrease and inverse of the dense solution.

    Damping is Levenberg and Marquardt's for all unknowns together, and multiplies the diagonal.
    `by_states` is the decrease of a segment's sum by its initial state alone.
    """
    derivatives, residuals = random_problem()
    matrix, right = whole(derivatives, residuals)
    normal = matrix.T @ matrix
    expected = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), matrix.T @ right)
    reduced = solve_arrow(*blockwise(derivatives, residuals), N_STATES, damping=damping)
    step = np.concatenate((reduced.states_step.ravel(), reduced.values_step))
    assert step == pytest.approx(expected, rel=1e-9)
    if damping:
        return
    for d, r, alone in zip(derivatives, residuals, reduced.by_states, strict=True):
        own = d[:, :N_STATES]  # of its segment's sum, fitted without the coefficients
        left = r - own @ np.linalg.lstsq(own, r, rcond=None)[0]
        assert alone == pytest.approx(r @ r - left @ left, rel=1e-9)
    fall = right @ right - np.sum((right - matrix @ expected) ** 2)
    assert reduced.decrement == pytest.approx(fall, rel=1e-9)
    expected = np.linalg.inv(normal)[-N_COEFFICIENTS:, -N_COEFFICIENTS:]
    assert reduced.inverse == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert reduced.information @ expected == pytest.approx(np.eye(N_COEFFICIENTS), abs=1e-9)


def test_a_direction_that_initial_states_explain_is_free():
    """Assert that a coefficient equivalent to initial states is free, and others are not."""
    derivatives, residuals = random_problem()
    for d in derivatives:
        d[:, -1] = d[:, 0] - 2.0 * d[:, 1]
    reduced = solve_arrow(*blockwise(derivatives, residuals), N_STATES)
    assert reduced.free.tolist() == [False, False, True]
    assert reduced.values_step[-1] == pytest.approx(0.0, abs=1e-9)


def test_the_rest_follows_what_is_zero():
    """Assert that the gradient of the constrained minimum vanishes, in any units."""
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


def test_an_unknown_without_effect_is_free():
    """Assert a finite inverse, zero for an unknown that acts by less than numbers can square."""
    matrix = np.diag([4.0, 1e-315])
    inverse, free = scaled_inverse(matrix, np.sqrt(np.diag(matrix)))
    assert inverse == pytest.approx(np.diag([0.25, 0.0]))
    assert free.tolist() == [False, True]


def test_nothing_moves_along_an_open_direction():
    """Assert that two values seen in their sum share the change equally, and are both free."""
    columns = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 2.0]])
    values = np.array([1.0, 3.0, 0.5])
    found = least_with(np.array([True, True, False]), columns.T @ columns, values)
    assert found.values == pytest.approx([1.25, 3.25])
    assert found.free.tolist() == [True, True]
    found = least_with(np.array([True, True]), np.diag([4.0, 0.0]), values[:2])
    assert found.values.tolist() == [1.0, 3.0]
    assert found.free.tolist() == [False, True]


THREE_DEVIATIONS = round(9.0 / (0.5 * FLAT))  # degrees of freedom for a flat step of this length


@dataclass
class _Rough:
    """A sum of squares whose predicted decrease is too optimistic.

    Each step is predicted to save a share of the cost, and saves a part of that share.
    """

    promised: float
    kept: float
    degrees_of_freedom: int = 10_000
    variance: float = 1.0
    counted: list[float] = field(default_factory=list)

    def equations(self, point: Point, by: By = "everything") -> Any:
        steps = point.values[0]
        if by == "everything":
            self.counted.append(steps)
        cost = self.variance * self.degrees_of_freedom * (1.0 - self.promised * self.kept) ** steps
        return SimpleNamespace(cost=cost)

    def solve(self, equations: Any, _damping: float = 0.0) -> Any:
        step = np.array([1.0])
        decrement = self.promised * equations.cost
        return SimpleNamespace(values_step=step, states_step=np.zeros((1, 2)), decrement=decrement)


def steps_of(problem: _Rough, tolerance: float = 1.0, **options: Any) -> int:
    """Return the number of steps taken."""
    point = Point(np.zeros(1), np.zeros((1, 2)))
    return minimise(cast("Any", problem), point, Steps(tolerance, **options)).iterations


@pytest.mark.parametrize(
    ("problem", "options", "steps"),
    [
        # Two successive steps with less than a quarter of the prediction end a flat search.
        (_Rough(0.5 * FLAT, 0.24), {}, 2),
        (_Rough(0.5 * FLAT, 0.3), {}, ITERATIONS),
        # Three standard deviations suffice for an intermediate fit, and not for the last.
        (_Rough(0.5 * FLAT, 0.24, THREE_DEVIATIONS), {"tolerance": 1e-2}, ITERATIONS),
        (_Rough(0.5 * FLAT, 0.24, THREE_DEVIATIONS), {"tolerance": 1.0}, 2),
        # Four successive steps with less than a hundredth end the search at a rough minimum.
        (_Rough(0.5 * FLAT, 1e-4, THREE_DEVIATIONS), {"tolerance": 1e-2}, 4),
        (_Rough(0.5, 1e-4), {"insist": False}, 4),
        # Two successive steps below the required gain end an exploratory search.
        (_Rough(0.5, 0.5), {"insist": False, "least_gain": 0.26}, 2),
        (_Rough(0.5, 0.5), {"insist": False, "least_gain": 0.24}, ITERATIONS),
        (_Rough(0.5, 0.02), {"insist": False}, ITERATIONS),
        # Below the requested variance, none of these is a failure.
        (_Rough(0.5, 1e-4), {"enough": 1.1}, 4),
        (_Rough(0.5, 0.24), {"enough": 1.1}, ITERATIONS),
    ],
)
def test_steps_end(problem: _Rough, options: dict[str, Any], steps: int):
    """Assert after how many steps a minimum, or a sufficient fit, ends the search."""
    assert steps_of(problem, **options) == steps


@pytest.mark.parametrize(
    ("problem", "options", "reason"),
    [
        # A predicted decrease beyond chance with poor steps is no minimum.
        (_Rough(2.0 * FLAT, 0.24), {}, f"within {ITERATIONS}"),
        (_Rough(0.5, 1e-4), {}, "4 steps in a row gained almost nothing"),
        # A plateau: residuals exceed the noise.
        (_Rough(0.5 * FLAT, 1e-4, THREE_DEVIATIONS, 1.6), {"tolerance": 1e-2}, "4 steps in a row"),
        (_Rough(0.5, 1e-4), {"enough": 0.9 * (1.0 - 0.5e-4) ** ITERATIONS}, "4 steps in a row"),
        (_Rough(0.5, 0.24), {"enough": 0.9 * (1.0 - 0.12) ** ITERATIONS}, "within"),
        (_Rough(0.5, 0.9), {"iterations": 3}, "within 3"),
    ],
)
def test_steps_that_lead_nowhere(problem: _Rough, options: dict[str, Any], reason: str):
    """Assert the reason of each failure, and that no more steps are taken."""
    with pytest.raises(ConvergenceError, match=reason):
        steps_of(problem, **options)
    if reason.startswith("4 steps"):
        assert len(problem.counted) == 1 + 4
    if "iterations" in options:
        assert len(problem.counted) == 1 + 3


def test_a_fit_on_its_way_is_not_stopped():
    """Assert that steps which halve the sum of squares are not limited in number."""
    problem = _Rough(0.6, 0.9, degrees_of_freedom=10**9)
    assert steps_of(problem, tolerance=1e-3, iterations=3) > 10


def _gives_up(_):
    raise np.linalg.LinAlgError("Eigenvalues did not converge")


@pytest.mark.parametrize("gives_up", [False, True])
def test_eigenvalues_ascend_and_give_the_matrix_back(monkeypatch, gives_up):
    """Assert that both algorithms give ordered eigenvalues and vectors, and a pseudo-inverse.

    It inverts a regular matrix, and has the rank of another one. An empty matrix is its own.
    """
    roots = np.random.default_rng(1).standard_normal((5, 4, 4))
    roots[-1, :, 2:] = 0.0  # of rank 2
    matrices = roots @ roots.swapaxes(-1, -2)
    if gives_up:
        monkeypatch.setattr(np.linalg, "eigh", _gives_up)
    eigenvalues, vectors = eigen(matrices)
    assert np.all(np.diff(eigenvalues, axis=-1) > -1e-9)
    back = (vectors * eigenvalues[..., None, :]) @ vectors.swapaxes(-1, -2)
    assert back == pytest.approx(matrices, abs=1e-9)
    orthogonal = np.broadcast_to(np.eye(4), matrices.shape)
    assert vectors @ vectors.swapaxes(-1, -2) == pytest.approx(orthogonal, abs=1e-9)
    inverses = pseudo_inverse(matrices, 1e-9)
    assert matrices @ inverses @ matrices == pytest.approx(matrices, abs=1e-9)
    assert inverses @ matrices @ inverses == pytest.approx(inverses, rel=1e-6)
    assert np.linalg.matrix_rank(inverses[-1], tol=1e-9) == 2
    assert pseudo_inverse(np.zeros((3, 0, 0)), 1e-9).shape == (3, 0, 0)


def test_another_algorithm_is_not_asked_for_what_is_not_finite(monkeypatch):
    """Assert that a matrix with NaN or infinity is refused without the second algorithm."""
    monkeypatch.setattr(np.linalg, "eigh", _gives_up)
    with pytest.raises(np.linalg.LinAlgError):
        eigen(np.array([[1.0, np.inf], [np.inf, 1.0]]))
