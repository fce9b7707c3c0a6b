"""What is known beforehand joined to a fit, against closed forms and by coverage."""

import numpy as np
import pytest
from scipy.stats import t

from flexid.errors import SettingError
from flexid.identification.preparation.prior_knowledge import Known, informed
from flexid.identification.vocabulary.estimate import Estimate
from flexid.models.physical import physical_parameters

PARAMETERS = physical_parameters(["alpha1", "beta1"], input_is_torque=True)


def line(seed: int = 0, n: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Regressors of a line and noisy measurements of unit variance."""
    x = np.linspace(0.5, 3.0, n)
    regressors = np.column_stack((np.ones(n), x))
    noise = np.random.default_rng(seed).standard_normal(n)
    return regressors, regressors @ [2.0, -1.0] + noise


def least_squares(regressors: np.ndarray, measured: np.ndarray) -> Estimate:
    """Estimate a line with its covariance for unit variance."""
    covariance = np.linalg.inv(regressors.T @ regressors)
    return Estimate(("a", "b"), covariance @ regressors.T @ measured, covariance, (np.inf,) * 2)


def drive(deviation: float = 0.05) -> Estimate:
    """alpha1 and beta1, equally uncertain and correlated."""
    values = np.array([1000 / 3, 10 / 3])
    correlation = np.array([[1.0, 0.8], [0.8, 1.0]])
    covariance = deviation**2 * np.outer(values, values) * correlation
    return Estimate(("alpha1", "beta1"), values, covariance, (12.0, 12.0))


def test_linear_case_is_one_more_measurement():
    """Assert that knowledge of b equals least squares with one weighted equation more.

    Knowledge of two things gives what the one after the other gives, and certain knowledge fixes.
    """
    regressors, measured = line()
    found = informed(least_squares(regressors, measured), [Known("b", -1.3, 0.2)])[0]
    more = least_squares(np.vstack((regressors, [0.0, 1.0 / 0.2])), np.append(measured, -1.3 / 0.2))
    assert found.values == pytest.approx(more.values, rel=1e-10)
    assert found.covariance == pytest.approx(more.covariance, rel=1e-10)
    first, second = Known("a", 2.2, 0.3), Known("b", -1.1, 0.1)
    fit = least_squares(regressors, measured)
    together, _ = informed(fit, [first, second])
    in_turn, _ = informed(informed(fit, [first])[0], [second])
    assert together.values == pytest.approx(in_turn.values, rel=1e-10)
    assert together.covariance == pytest.approx(in_turn.covariance, rel=1e-10)
    found = informed(fit, [Known("b", -1.3, 0.0)])[0]
    assert found.values == pytest.approx([np.mean(measured + 1.3 * regressors[:, 1]), -1.3])
    assert found.covariance == pytest.approx(np.diag([1.0 / len(measured), 0.0]), abs=1e-15)


def test_a_known_inertia_is_met():
    """Assert that one known exactly is what the joined values give, far off or not.

    What correlates with it follows along their common uncertainty.
    """
    for inertia in (0.1, 0.25, 0.3, 0.6, 1.5):
        found, _ = informed(drive(), [Known("motor_inertia", inertia, 0.0)], PARAMETERS)
        assert 1.0 / found.values[1] == pytest.approx(inertia, rel=1e-9)
    found, _ = informed(drive(), [Known("motor_inertia", 0.3 / 1.02, 0.0)], PARAMETERS)
    assert found.values[0] == pytest.approx(1000 / 3 * (1 + 0.8 * 0.02), rel=1e-9)


def test_what_is_unknown_or_free_is_refused():
    """Assert that a wrong name and a coefficient that the log leaves free are errors."""
    fit = drive()
    with pytest.raises(SettingError, match="unknown here"):
        informed(fit, [Known("inertia", 0.3, 0.01)], PARAMETERS)
    free = Estimate(fit.names, fit.values, np.diag([1.0, np.inf]), (12.0, 0.0))
    with pytest.raises(SettingError, match="give 'beta1' itself without an uncertainty"):
        informed(free, [Known("motor_inertia", 0.3, 0.01)], PARAMETERS)
    with pytest.raises(SettingError, match="give it without an uncertainty"):
        informed(free, [Known("beta1", 3.0, 0.01)], PARAMETERS)
    for std in (-0.1, np.nan, np.inf):
        with pytest.raises(SettingError, match="known"):
            Known("beta1", 3.0, std)
    found, _ = informed(free, [Known("alpha1", 300.0, 0.1)])
    assert np.isinf(found.covariance[1, 1])  # a free neighbour stays free
    assert found.degrees_of_freedom[1] == 0.0


@pytest.mark.parametrize("std", [0.03, 0.3, 3.0])
def test_coverage_with_an_estimated_covariance(std):
    """Assert that joined intervals hold the truth in 93 to 97 % where 12 degrees of freedom do.

    Truth drawn from what is known, covariance from a Wishart distribution; a share of 4000 draws
    has a standard error of 0.35 %.
    """
    generator = np.random.default_rng(8)
    root = np.linalg.cholesky(np.array([[1.0, 0.7], [0.7, 2.0]]))
    freedom, held_count = 12, np.zeros(2)
    for _ in range(4000):
        truth = np.array([0.5, 3.0 + std * generator.standard_normal()])
        values = truth + root @ generator.standard_normal(2)
        samples = root @ generator.standard_normal((2, freedom))
        fit = Estimate(("a", "b"), values, samples @ samples.T / freedom, (float(freedom),) * 2)
        found, _ = informed(fit, [Known("b", 3.0, std)])
        width = t.ppf(0.975, found.degrees_of_freedom) * np.sqrt(np.diag(found.covariance))
        held_count += np.abs(found.values - truth) <= width
    assert np.all(held_count / 4000 > 0.93)
    assert np.all(held_count / 4000 < 0.97)


@pytest.mark.parametrize(
    ("apart", "limit", "said"),
    [
        (2.9, 3.0, False),
        (3.1, 3.0, True),
        (-2.9, 3.0, False),
        (-3.1, 3.0, True),
        (10.0, 9.9, True),
        (10.0, 10.1, False),
    ],
)
def test_a_contradiction_spans_both(apart, limit, said):
    """Assert that beyond the limit one deviation more reaches from the joined value to the log's.

    2 ± 0.4 from the log and 0.3 known: together 0.5 for the difference, and 0.24 for the joined
    value, which lies 0.64 of the difference from the log.
    """
    fit = Estimate(("a",), np.array([2.0]), np.array([[0.16]]), (np.inf,))
    known = Known("a", 2.0 + 0.5 * apart, 0.3)
    found, contradicted = informed(fit, [known], contradiction=limit)
    assert [*contradicted] == (["a"] if said else [])
    moved = 0.64 * 0.5 * apart
    assert found.values == pytest.approx([2.0 + moved])
    assert found.covariance == pytest.approx(np.array([[0.24**2 + said * moved**2]]))
    # Where the log alone decides, two deviations reach what is known.
    sharp = Estimate(("a",), np.array([2.0]), np.array([[1e-6]]), (np.inf,))
    found, contradicted = informed(sharp, [Known("a", 7.0, 1.0)])
    assert contradicted
    assert found.values[0] + 2.0 * found.deviations[0] >= 7.0
