"""What a campaign shows: statuses and quantiles."""

import numpy as np
import polars as pl
import pytest
from tests.campaigns.tiny import made_manifest

from flexid.errors import CampaignError
from flexid.experiments.campaign_store import open_store, summarise
from flexid.experiments.variation import Distribution, Plan, Variation, make_plan

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
    """Assert that a campaign without a part says so."""
    with pytest.raises(CampaignError, match="has no rows yet"):
        summarise(write_campaign(tmp_path, parts=[]))
