"""Plans: which values every run has."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from SALib.sample import sobol as salib_sobol

from flexid.campaigns.plan import SEED, make_plan
from flexid.errors import SettingError
from flexid.experiments.variation import Distribution, Variation

UNIFORM = Distribution("uniform", 10.0, 50.0)
LOG_UNIFORM = Distribution("log_uniform", 1e-6, 1e-2)
NORMAL = Distribution("normal", 5.0, 0.5)


def variation(kind, runs, campaign_seed=0, **inputs):
    """Return what varies."""
    return Variation(kind, runs, campaign_seed, inputs, ("final_errors",), None)


def seeds(runs, campaign_seed=0):
    """Return the seeds that the runs of a grid are given."""
    inputs = {"a": tuple(map(float, range(runs)))}
    plan = make_plan(variation("grid", runs, campaign_seed, **inputs), sampled=True)
    return plan.table(range(runs))[SEED].to_numpy()


def test_a_grid_has_every_combination_once():
    """Assert that a grid's runs are the product of its values, the last one changing fastest."""
    plan = make_plan(variation("grid", 6, a=(1.0, 2.0), b=(3.0, 4.0, 5.0)), sampled=False)
    assert plan.values.tolist() == [[1, 3], [1, 4], [1, 5], [2, 3], [2, 4], [2, 5]]


def test_a_latin_hypercube_has_one_run_in_every_slice():
    """Assert that each of n equally likely slices of an input holds exactly one of n runs."""
    plan = make_plan(variation("latin-hypercube", 40, a=UNIFORM, b=LOG_UNIFORM), sampled=False)
    a = (plan.values[:, 0] - 10.0) / 40.0
    b = np.log(plan.values[:, 1] / 1e-6) / np.log(1e4)
    for shares in (a, b):
        assert sorted(np.floor(40 * shares).astype(int)) == list(range(40))


def test_a_sobol_plan_goes_on_where_a_shorter_one_ends():
    """Assert that more runs are the same runs and others behind them, for any number."""
    short = make_plan(variation("sobol", 11, a=UNIFORM, b=NORMAL), sampled=False)
    long = make_plan(variation("sobol", 50, a=UNIFORM, b=NORMAL), sampled=False)
    assert np.array_equal(short.values, long.values[:11])


def test_draws_follow_their_distribution():
    """Assert that mean and deviation of a normal input, and the share of each listed value, fit."""
    plan = make_plan(variation("sobol", 1024, a=NORMAL, b=(1.0, 2.0, 4.0, 8.0)), sampled=False)
    assert plan.values[:, 0].mean() == pytest.approx(5.0, abs=2e-3)
    assert plan.values[:, 0].std() == pytest.approx(0.5, rel=1e-2)
    assert np.unique(plan.values[:, 1], return_counts=True)[1].tolist() == [256] * 4


def test_a_plan_for_sobol_indices_has_salibs_order():
    """Assert that the blocks of runs differ from each other in the columns that SALib expects."""
    plan = make_plan(variation("sobol-indices", 32 * 5, a=UNIFORM, b=UNIFORM, c=UNIFORM), False)
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[10.0, 50.0]] * 3}
    theirs = salib_sobol.sample(problem, 32, calc_second_order=False, seed=0)

    def changes(values):
        points = values.reshape(32, 5, 3)
        return (points == points[:, :1]).all(axis=0).tolist()

    assert changes(plan.values) == changes(theirs)
    assert changes(plan.values)[2] == [True, False, True]


def test_a_number_of_runs_that_makes_no_indices_is_refused():
    """Assert that the sentence names a number that does."""
    with pytest.raises(SettingError, match="take 320") as refused:
        make_plan(variation("sobol-indices", 300, a=UNIFORM, b=UNIFORM, c=UNIFORM), sampled=False)
    assert refused.value.setting == "campaign.runs"
    make_plan(variation("sobol-indices", 320, a=UNIFORM, b=UNIFORM, c=UNIFORM), sampled=False)


@given(
    st.sampled_from(["latin-hypercube", "sobol"]),
    st.integers(1, 70),
    st.integers(0, 2**63),
    st.integers(1, 70),
)
def test_a_run_has_its_values_whatever_the_part(kind, runs, seed, size):
    """Assert that tables of any parts, put together, are the plan, and that values are finite."""
    plan = make_plan(variation(kind, runs, seed, a=UNIFORM, b=NORMAL), sampled=True)
    parts = [plan.table(range(i, min(i + size, runs))) for i in range(0, runs, size)]
    rows = [row for part in parts for row in part.iter_rows()]
    assert rows == list(plan.table(range(runs)).iter_rows())
    assert np.isfinite(plan.values).all()
    again = make_plan(variation(kind, runs, seed, a=UNIFORM, b=NORMAL), sampled=True)
    assert again.digest == plan.digest


def test_every_run_has_a_seed_of_its_own():
    """Assert that seeds differ between runs and campaigns, and not with the number of runs."""
    long = seeds(300)
    assert len(np.unique(long)) == 300
    assert long.min() >= 0
    assert np.array_equal(seeds(3), long[:3])
    assert not np.isin(seeds(3, campaign_seed=1), long).any()


def test_seeds_that_are_varied_are_left_alone():
    """Assert that a plan whose file lists seeds draws none, nor does one without noise."""
    listed = variation("grid", 2, **{SEED: (4.0, 5.0)})  # type: ignore[arg-type]
    plan = make_plan(listed, sampled=True)
    assert plan.table(range(2)).rows() == [(0, 4.0), (1, 5.0)]
    unsampled = make_plan(variation("grid", 1, a=(1.0,)), sampled=False)
    assert unsampled.table(range(1)).columns == ["run", "a"]


def test_another_seed_is_another_plan():
    """Assert that the digest tells plans apart by seed and by name."""
    digests = {
        make_plan(variation("sobol", 8, 0, a=UNIFORM), sampled=False).digest,
        make_plan(variation("sobol", 8, 1, a=UNIFORM), sampled=False).digest,
        make_plan(variation("sobol", 8, 0, b=UNIFORM), sampled=False).digest,
        make_plan(variation("sobol", 8, 0, a=UNIFORM), sampled=True).digest,
    }
    assert len(digests) == 4
