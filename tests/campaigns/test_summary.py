"""Summaries of campaigns: statuses, quantiles, importance, finished or not."""

import numpy as np
import polars as pl
import pytest

from flexid.campaigns.plan import Plan, make_plan
from flexid.campaigns.store import Manifest, open_store
from flexid.campaigns.summary import summarise
from flexid.errors import CampaignError
from flexid.experiments.tables import Distribution, Variation
from flexid.experiments.tables import Plan as Kind

INPUTS = {
    "controller.k": Distribution("uniform", 10.0, 50.0),
    "plant.link_inertia": Distribution("uniform", 0.8, 1.2),
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


def write_campaign(out, kind: Kind = "sobol", runs=400, parts=None):
    """Write a campaign of made-up rows, or some of its parts."""
    plan = make_plan(Variation(kind, runs, 0, INPUTS, (), None), sampled=False)
    manifest = Manifest(
        flexid="1.0",
        experiment="0123",
        plan=plan.digest,
        kind=kind,
        runs=runs,
        inputs=plan.inputs,
        keep=(),
        runs_per_part=50,
        text="the file",
    )
    with open_store(out, manifest) as store:
        for part in manifest.parts if parts is None else parts:
            store.write(part, made_up_rows(plan, manifest.runs_of(part)), None)
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


def test_sobol_indices_where_the_plan_is_for_them(tmp_path):
    """Assert that the one input that acts makes all of the variance, failed runs left out."""
    found = summarise(write_campaign(tmp_path, "sobol-indices", 256 * 4))
    first, second = result(found, "tracking_rms").indices
    assert first.input == "controller.k"
    assert first.total == pytest.approx(1.0, abs=0.1)
    assert second.total == pytest.approx(0.0, abs=0.01)
    assert result(summarise(tmp_path), "steps").indices == ()


def test_an_unfinished_campaign_is_summarised(tmp_path):
    """Assert that what is there counts, also where points of indices lie across a missing part."""
    found = summarise(write_campaign(tmp_path / "some", parts=[0, 3]))
    assert not found.complete
    assert (found.done, found.manifest.runs) == (100, 400)
    assert sum(found.statuses.values()) == 100

    found = summarise(write_campaign(tmp_path, "sobol-indices", 256 * 4, parts=[0, 2, 3, 5, 6]))
    assert result(found, "tracking_rms").indices[0].total == pytest.approx(1.0, abs=0.2)


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
