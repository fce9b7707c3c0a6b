"""What a campaign shows: statuses, distributions, and which input matters."""

import numpy as np
import polars as pl
import pytest
from tests.campaigns.tiny import made_manifest

from flexid.campaigns.store import open_store
from flexid.campaigns.summary import rank_correlations, summarise
from flexid.errors import CampaignError
from flexid.experiments.variation import Distribution, Plan, Variation, make_plan


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


INPUTS = {
    "controller.k": Distribution(uniform=[10.0, 50.0]),
    "plant.link_inertia": Distribution(uniform=[0.8, 1.2]),
}


def made_up_rows(plan: Plan, runs: range) -> pl.DataFrame:
    """Return rows whose results are known functions of the inputs; every tenth run diverges."""
    table = plan.table(runs)
    k, inertia = table["controller.k"].to_numpy(), table["plant.link_inertia"].to_numpy()
    diverged = table["run"].to_numpy() % 10 == 7
    results = {
        "final_error.theta1": np.where(diverged, 1e9, (inertia - 1.0) * 100.0),
        "settling_time.theta1": np.where(k > 30.0, np.nan, k),
        "tracking_rms": 1.0 / k,
    }
    return table.with_columns(
        status=pl.Series(["diverged" if one else "finished" for one in diverged]),
        error=pl.lit(None, pl.String),
        reached=pl.lit(1.0),
        steps=pl.lit(10, pl.Int64),
        **{name: pl.Series(values) for name, values in results.items()},
    )


def write_campaign(out, parts=None):
    """Write a campaign of made-up rows, or some of its parts."""
    plan = make_plan(Variation(kind="sobol", runs=400, vary=INPUTS), sampled=False)
    manifest = made_manifest(plan, "sobol", 50)
    with open_store(out, manifest) as store:
        for part in manifest.parts if parts is None else parts:
            store.write(part, made_up_rows(plan, manifest.runs_of(part)))
    return out


def result(summary, name):
    """Return a result by name."""
    return next(one for one in summary.results if one.name == name)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The summary of a finished campaign."""
    return summarise(write_campaign(tmp_path_factory.mktemp("finished")))


def test_runs_are_counted_and_their_quantiles_are_of_those_that_finished(finished):
    """Assert that each run counts once, values of diverged runs never, and NaN as missing."""
    assert list(finished.statuses.items()) == [("finished", 360), ("diverged", 40)]
    assert (finished.complete, finished.done, finished.finished) == (True, 400, 360)

    error = result(finished, "final_error.theta1")
    assert error.quantiles == pytest.approx((-18.0, 0.0, 18.0), abs=3.0)
    settling = result(finished, "settling_time.theta1")
    assert settling.quantiles == pytest.approx((11.0, 20.0, 29.0), abs=0.5)
    assert settling.missing == pytest.approx(180, abs=10)


def test_the_input_that_matters_comes_first(finished):
    """Assert that a falling law has rank correlation -1, and others, or signed errors, none."""
    first, second = result(finished, "tracking_rms").correlations
    assert (first.input, first.value) == ("controller.k", pytest.approx(-1.0))
    assert first.significant
    assert not second.significant
    for one in result(finished, "final_error.theta1").correlations:
        assert abs(one.value) < 0.2


def test_an_unfinished_campaign_is_summarised(tmp_path):
    """Assert that what is there counts."""
    found = summarise(write_campaign(tmp_path / "some", parts=[0, 3]))
    assert not found.complete
    assert (found.done, found.manifest.runs) == (100, 400)
    assert sum(found.statuses.values()) == 100


def test_a_damaged_part_is_named(tmp_path):
    """Assert that a cut part is left out and named."""
    write_campaign(tmp_path)
    path = tmp_path / "runs" / "part-000002.parquet"
    path.write_bytes(path.read_bytes()[:100])
    found = summarise(tmp_path)
    assert found.damaged == ("part-000002.parquet",)
    assert (found.done, found.complete) == (350, False)


def test_nothing_to_summarise_is_one_sentence(tmp_path):
    """Assert that a campaign without a part, or with one that is not like the others, says so."""
    with pytest.raises(CampaignError, match="has no rows yet"):
        summarise(write_campaign(tmp_path, parts=[]))
    write_campaign(tmp_path, parts=[0, 1])
    path = tmp_path / "runs" / "part-000001.parquet"
    pl.read_parquet(path).drop("steps").write_parquet(path)
    with pytest.raises(CampaignError, match="do not belong together"):
        summarise(tmp_path)
