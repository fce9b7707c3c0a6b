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


def test_runs_are_counted_and_their_quantiles_are_of_those_that_finished(tmp_path):
    """Assert that each run counts once, values of diverged runs never, and NaN as missing."""
    finished = summarise(write_campaign(tmp_path))
    assert list(finished.statuses.items()) == [("finished", 360), ("diverged", 40)]
    assert (finished.complete, finished.done, finished.finished) == (True, 400, 360)
    results = {one.name: one for one in finished.results}
    error, settling = (results[f"{name}.theta1"] for name in ("final_error", "settling_time"))
    assert error.quantiles == pytest.approx((-18.0, 0.0, 18.0), abs=3.0)
    assert settling.quantiles == pytest.approx((11.0, 20.0, 29.0), abs=0.5)
    assert settling.missing == pytest.approx(180, abs=10)


def test_an_unfinished_campaign_is_summarised(tmp_path):
    """Assert that what is there counts, that a part that is cut is named, and if there is none."""
    some = write_campaign(tmp_path / "some", parts=[0, 3, 4])
    path = some / "runs" / "part-000004.parquet"
    path.write_bytes(path.read_bytes()[:100])
    found = summarise(some)
    assert found.damaged == ("part-000004.parquet",)
    assert (found.complete, found.done, found.manifest.runs) == (False, 100, 400)
    assert sum(found.statuses.values()) == 100
    with pytest.raises(CampaignError, match="has no rows yet"):
        summarise(write_campaign(tmp_path / "none", parts=[]))
