"""What may hide behind a term that was taken away, against the posterior by quadrature."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from flexid.identification.estimation.final_fits import hidden_covariance


def fitted(names, information, values, robust=1.0) -> Any:
    """As much of a fit as counts: its quadratic form, and how far blocks agree with noise."""
    unit = np.sqrt(np.diag(np.linalg.pinv(information)))
    return SimpleNamespace(
        names=tuple(names),
        information=np.asarray(information, dtype=np.float64),
        values=np.asarray(values, dtype=np.float64),
        unit_deviations=unit,
        fit=SimpleNamespace(deviations=robust * unit),
        minimum=SimpleNamespace(reduced=SimpleNamespace(values_step=np.zeros(len(names)))),
    )


def added(information, values, scale, robust=1.0) -> float:
    """Variance that the second of two coefficients adds to the first by its absence."""
    reported = fitted(("kept",), information[:1, :1], values[:1])
    full = fitted(("kept", "gone"), information, values, robust)
    covariance = hidden_covariance(cast(Any, reported), cast(Any, full), {"gone": scale})
    return float(covariance[0, 0])


@pytest.mark.parametrize(("value", "scale"), [(0.0, 3.0), (0.4, 3.0), (1.1, 0.5), (2.5, 20.0)])
def test_it_is_the_mean_square_of_the_posterior(value, scale):
    """Assert that what is added is E[b²] of a term that is there or not, times its leverage.

    The two share 0.6 of their information: one unit of the second moves the first by 0.6.
    """
    information = np.array([[1.0, 0.6], [0.6, 1.0]])
    deviation = 1.0 / np.sqrt(1.0 - 0.36)

    def there(b):
        return norm.pdf(value, b, deviation) * norm.pdf(b, 0.0, scale)

    reach = 12.0 * scale
    evidence = quad(there, -reach, reach, points=[0.0, value], limit=400)[0]
    square = quad(lambda b: b * b * there(b), -reach, reach, points=[0.0, value], limit=400)[0]
    expected = 0.36 * square / (evidence + norm.pdf(value, 0.0, deviation))
    assert added(information, np.array([0.0, value]), scale) == pytest.approx(expected, rel=1e-6)


def test_correlated_residuals_count():
    """Assert that a term whose scores scatter twice as much is twice as uncertain."""
    information = np.array([[1.0, 0.6], [0.6, 1.0]])
    wide = added(information, np.zeros(2), 3.0, robust=2.0)
    narrow = added(information / 4.0, np.zeros(2), 3.0)
    assert wide == pytest.approx(narrow, rel=1e-9)


def test_what_is_left_of_the_information_is_not_lost_in_rounding():
    """Assert that of terms that are all but dependent none hides more than it could.

    Three columns of a thousand rows, scaled to a unit diagonal, whose smallest eigenvalue is 1e-11;
    what the first two leave of the third follows from their singular values.
    """
    rng = np.random.default_rng(3)
    base = rng.standard_normal((1000, 3))
    columns = np.column_stack(
        [base[:, 0], base[:, 0] + 1e-3 * base[:, 1], base @ [1.0, 1e-3, 4e-6]]
    )
    information = columns.T @ columns
    reported = fitted(("a", "b"), information[:2, :2], np.zeros(2))
    full = fitted(("a", "b", "gone"), information, np.zeros(3))
    scale = 1e-3
    covariance = hidden_covariance(cast(Any, reported), cast(Any, full), {"gone": scale})
    orthogonal, _ = np.linalg.qr(columns[:, :2])
    rest = columns[:, 2] - orthogonal @ (orthogonal.T @ columns[:, 2])
    assert 1.0 / np.linalg.norm(rest) > scale  # the log cannot see it
    shift = np.linalg.lstsq(columns[:, :2], columns[:, 2])[0]
    most = scale**2 * np.outer(shift, shift)
    ratio = np.diag(covariance) / np.diag(most)
    assert (ratio > 0.3).all()
    assert (ratio < 0.6).all()
