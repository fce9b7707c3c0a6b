"""Eigenvalues and inverses of symmetric matrices, also if divide and conquer fails."""

import numpy as np
import pytest

from flexid.estimators.normal_equations import eigen, pseudo_inverse


def _covariances(seed: int) -> np.ndarray:
    """Return five matrices of shape (4, 4), the last of rank 2."""
    roots = np.random.default_rng(seed).standard_normal((5, 4, 4))
    roots[-1, :, 2:] = 0.0
    return roots @ roots.swapaxes(-1, -2)


def _gives_up(_):
    raise np.linalg.LinAlgError("Eigenvalues did not converge")


@pytest.fixture(params=["converges", "gives up"])
def _divide_and_conquer(request, monkeypatch):
    if request.param == "gives up":
        monkeypatch.setattr(np.linalg, "eigh", _gives_up)


@pytest.mark.usefixtures("_divide_and_conquer")
def test_eigenvalues_ascend_and_give_the_matrix_back():
    """Assert that both algorithms give ordered eigenvalues and vectors of the matrix."""
    matrices = _covariances(1)
    eigenvalues, vectors = eigen(matrices)
    assert np.all(np.diff(eigenvalues, axis=-1) > -1e-9)
    back = (vectors * eigenvalues[..., None, :]) @ vectors.swapaxes(-1, -2)
    assert back == pytest.approx(matrices, abs=1e-9)
    assert vectors @ vectors.swapaxes(-1, -2) == pytest.approx(
        np.broadcast_to(np.eye(4), matrices.shape), abs=1e-9
    )


@pytest.mark.usefixtures("_divide_and_conquer")
def test_a_pseudo_inverse_inverts_what_is_not_null():
    """Assert the inverse of a regular matrix, and a pseudo-inverse of equal rank otherwise."""
    matrices = _covariances(2)
    inverses = pseudo_inverse(matrices, 1e-9)
    assert matrices @ inverses @ matrices == pytest.approx(matrices, abs=1e-9)
    assert inverses @ matrices @ inverses == pytest.approx(inverses, rel=1e-6)
    assert np.linalg.matrix_rank(inverses[-1], tol=1e-9) == 2


def test_another_algorithm_is_not_asked_for_what_is_not_finite(monkeypatch):
    """Assert that a matrix with NaN or infinity is refused without the second algorithm."""
    monkeypatch.setattr(np.linalg, "eigh", _gives_up)
    with pytest.raises(np.linalg.LinAlgError):
        eigen(np.array([[1.0, np.inf], [np.inf, 1.0]]))


def test_an_empty_matrix_has_no_eigenvalues():
    """Assert that an empty matrix is its own inverse."""
    assert pseudo_inverse(np.zeros((3, 0, 0)), 1e-9).shape == (3, 0, 0)
