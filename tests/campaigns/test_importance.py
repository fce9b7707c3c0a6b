"""Which input matters, on functions whose answer is known."""

import numpy as np
import pytest

from flexid.campaigns.plan import make_plan
from flexid.campaigns.summary import rank_correlations, sobol_indices
from flexid.experiments.tables import Distribution, Variation

ANGLE = Distribution("uniform", -np.pi, np.pi)


def test_rank_correlation_follows_any_monotonic_law():
    """Assert that a rising curve has 1, a falling one -1, and that noise is not significant."""
    rng = np.random.default_rng(0)
    values = rng.uniform(0.0, 1.0, (400, 2))
    for result, sign in ((np.exp(9.0 * values[:, 0]), 1.0), (1.0 / (1e-3 + values[:, 0]), -1.0)):
        first, second = rank_correlations(["a", "b"], values, result)
        assert (first.input, first.value) == ("a", pytest.approx(sign))
        assert first.significant
        assert second.input == "b"
        assert not second.significant


def test_significance_is_shared_by_all_inputs():
    """Assert that of results that depend on nothing about one in twenty seems to, not more."""
    rng = np.random.default_rng(1)
    names = [f"p{n}" for n in range(10)]
    found = 0
    for _ in range(200):
        correlations = rank_correlations(names, rng.random((60, 10)), rng.random(60))
        found += any(one.significant for one in correlations)
    assert 1 <= found <= 22


def test_runs_without_a_result_are_left_out():
    """Assert that NaN and infinity change nothing."""
    values = np.random.default_rng(2).random((50, 1))
    result = values[:, 0] ** 2
    spoiled = result.copy()
    spoiled[::7], spoiled[3] = np.nan, np.inf
    assert rank_correlations(["a"], values, spoiled)[0].value == pytest.approx(1.0)


def test_what_does_not_vary_matters_nowhere():
    """Assert that a constant input is not listed, and a constant result has no list."""
    values = np.column_stack([np.ones(30), np.arange(30.0)])
    assert [one.input for one in rank_correlations(["a", "b"], values, np.arange(30.0))] == ["b"]
    assert rank_correlations(["a", "b"], values, np.ones(30)) == ()


@pytest.fixture(scope="module")
def ishigami():
    """Ishigami's function on the plan for Sobol indices, point by point."""
    inputs = {"a": ANGLE, "b": ANGLE, "c": ANGLE}
    plan = make_plan(Variation("sobol-indices", 1024 * 5, 0, inputs, (), None), sampled=False)
    a, b, c = plan.values.T
    return (np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)).reshape(-1, 5)


def test_sobol_indices_of_ishigamis_function(ishigami):
    """Assert that first and total indices meet the textbook's within their intervals."""
    truth = {"a": (0.3139, 0.5576), "b": (0.4424, 0.4424), "c": (0.0, 0.2437)}
    found = sobol_indices(["a", "b", "c"], ishigami)
    assert [one.input for one in found] == ["a", "b", "c"]
    for one in found:
        first, total = truth[one.input]
        assert one.first == pytest.approx(first, abs=1.5 * one.first_half_width)
        assert one.total == pytest.approx(total, abs=1.5 * one.total_half_width)
        assert one.total_half_width < 0.1
    assert sobol_indices(["a", "b", "c"], ishigami) == found


def test_sobol_indices_do_without_failed_runs(ishigami):
    """Assert that points with a failed run are left out whole, and the rest still answers."""
    spoiled = ishigami.copy()
    spoiled[::3, 2] = np.nan
    found = {one.input: one.total for one in sobol_indices(["a", "b", "c"], spoiled)}
    assert found == pytest.approx({"a": 0.5576, "b": 0.4424, "c": 0.2437}, abs=0.06)
    assert sobol_indices(["a", "b", "c"], np.full((64, 5), np.nan)) == ()
