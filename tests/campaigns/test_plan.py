"""The values of every run of a campaign, and its rows of results."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.campaigns.tiny import EXPERIMENT, write_experiment

from flexid.experiments import campaign_rows as rows_module
from flexid.experiments.campaign_rows import Stopped, part_rows
from flexid.experiments.experiment import read_experiment
from flexid.experiments.variation import SEED, Distribution, Variation, make_plan

UNIFORM = Distribution(uniform=[10.0, 50.0])
LOG_UNIFORM = Distribution(log_uniform=[1e-6, 1e-2])
NORMAL = Distribution(normal=[5.0, 0.5])


def listed(*values):
    """Return listed values."""
    return Distribution(values=[float(value) for value in values])


def variation(kind, runs, campaign_seed=0, **inputs):
    """Return the variation of some values."""
    return Variation(kind=kind, runs=runs, seed=campaign_seed, vary=inputs)


def seeds(runs, campaign_seed=0):
    """Return the seeds of the runs of a grid."""
    inputs = {"a": listed(*range(runs))}
    plan = make_plan(variation("grid", runs, campaign_seed, **inputs), sampled=True)
    return plan.table(range(runs))[SEED].to_numpy()


def test_kinds_of_plans():
    """Assert all combinations, one run per slice, extension, and equal shares of listed values."""
    plan = make_plan(variation("grid", 6, a=listed(1, 2), b=listed(3, 4, 5)), sampled=False)
    assert plan.values.tolist() == [[1, 3], [1, 4], [1, 5], [2, 3], [2, 4], [2, 5]]
    plan = make_plan(variation("latin-hypercube", 40, a=UNIFORM, b=LOG_UNIFORM), sampled=False)
    a = (plan.values[:, 0] - 10.0) / 40.0
    b = np.log(plan.values[:, 1] / 1e-6) / np.log(1e4)
    for shares in (a, b):
        assert sorted(np.floor(40 * shares).astype(int)) == list(range(40))
    short = make_plan(variation("sobol", 11, a=UNIFORM, b=NORMAL), sampled=False)
    long = make_plan(variation("sobol", 50, a=UNIFORM, b=NORMAL), sampled=False)
    assert np.array_equal(short.values, long.values[:11])
    plan = make_plan(variation("sobol", 1024, a=listed(1, 2, 4, 8)), sampled=False)
    values, counts = np.unique(plan.values, return_counts=True)
    assert dict(zip(values, counts, strict=True)) == dict.fromkeys((1.0, 2.0, 4.0, 8.0), 256)


@given(
    st.sampled_from(["latin-hypercube", "sobol"]),
    st.integers(1, 70),
    st.integers(0, 2**63),
    st.integers(1, 70),
)
def test_a_run_has_its_values_whatever_the_part(kind, runs, seed, size):
    """Assert that tables of parts, put together, are the plan, and that values are finite."""
    plan = make_plan(variation(kind, runs, seed, a=UNIFORM, b=NORMAL), sampled=True)
    parts = [plan.table(range(i, min(i + size, runs))) for i in range(0, runs, size)]
    rows = [row for part in parts for row in part.iter_rows()]
    assert rows == list(plan.table(range(runs)).iter_rows())
    assert np.isfinite(plan.values).all()
    again = make_plan(variation(kind, runs, seed, a=UNIFORM, b=NORMAL), sampled=True)
    assert again.digest == plan.digest


def test_seeds_and_digests():
    """Assert a seed of each run and campaign, and digests by seed, name and sampling."""
    long = seeds(300)
    assert len(np.unique(long)) == 300
    assert long.min() >= 0
    assert np.array_equal(seeds(3), long[:3])
    assert not np.isin(seeds(3, campaign_seed=1), long).any()
    seeded = variation("grid", 2, **{SEED: listed(4, 5)})  # type: ignore[arg-type]
    plan = make_plan(seeded, sampled=True)
    assert plan.table(range(2)).rows() == [(0, 4.0), (1, 5.0)]
    unsampled = make_plan(variation("grid", 1, a=listed(1)), sampled=False)
    assert unsampled.table(range(1)).columns == ["run", "a"]
    digests = {
        make_plan(variation("sobol", 8, 0, a=UNIFORM), sampled=False).digest,
        make_plan(variation("sobol", 8, 1, a=UNIFORM), sampled=False).digest,
        make_plan(variation("sobol", 8, 0, b=UNIFORM), sampled=False).digest,
        make_plan(variation("sobol", 8, 0, a=UNIFORM), sampled=True).digest,
    }
    assert len(digests) == 4


def planned(folder, campaign, experiment=EXPERIMENT):
    """Return an experiment and the table of all its runs."""
    path = folder / "experiment.toml"
    found = read_experiment(write_experiment(path, campaign, experiment))
    assert found.variation is not None
    table = make_plan(found.variation, found.sampling is not None).table
    return found, table(range(found.variation.runs))


def grid(path, values):
    """Return a campaign over some values of one key."""
    return f'[campaign]\nkind = "grid"\n[campaign.vary]\n"{path}" = {values}\n'


def test_a_row_is_what_a_single_run_gives(tmp_path):
    """Assert a single run's results by gain and seed, and errors relative to its own plant."""
    experiment, table = planned(tmp_path, grid("controller.proportional", [20.0, 40.0]))
    rows = part_rows(experiment, table)
    for row in rows.to_dicts():
        names = ("controller.proportional", "sampling.seed")
        run = experiment.with_values({name: row[name] for name in names}).run()
        assert row["status"] == "finished"
        assert row["final_error.theta2"] == pytest.approx(run.final_errors()["theta2"])
        assert row["final_state.x3"] == pytest.approx(run.states[-1, 2])
        assert row["peak_input.u"] == pytest.approx(np.abs(run.inputs).max())
        assert row["tracking_rms"] == pytest.approx(np.sqrt(np.mean(run.tracking_error**2)))
    assert rows["final_error.theta2"].n_unique() == 2
    experiment, table = planned(tmp_path, grid("plant.joint_stiffness", [80.0, 120.0]))
    rows = part_rows(experiment, table)
    truth = rows["plant.joint_stiffness"]  # theta2 with a link inertia of 1
    assert rows["relative_error.theta2"].to_list() == pytest.approx(
        (rows["final_error.theta2"].abs() / truth).to_list()
    )


def test_a_value_that_is_not_allowed_is_a_row(tmp_path):
    """Assert that a run with negative noise, drawn from a normal distribution, fails alone."""
    campaign = """
    [campaign]
    kind = "sobol"
    runs = 8
    vary.sampling.position_noise = { normal = [1e-4, 1e-4] }
    """
    experiment, table = planned(tmp_path, campaign)
    rows = part_rows(experiment, table)
    negative = rows["sampling.position_noise"] < 0.0
    assert 0 < negative.sum() < 8
    assert (rows["status"] == "error").to_list() == negative.to_list()
    for text in rows.filter(negative)["error"]:
        assert "sampling.position_noise" in text
    assert rows.filter(~negative)["final_error.theta1"].is_finite().all()
    assert rows.filter(negative)["final_error.theta1"].is_nan().all()


def test_parts_that_stop_or_fail(tmp_path, monkeypatch):
    """Assert a stop between batches, and that a failed run alone is lost, with the same bits."""
    experiment, table = planned(tmp_path, grid("observer.link", [1.0] * 20))
    asked = iter([False, True])
    with pytest.raises(Stopped):
        part_rows(experiment, table, lambda: next(asked))
    assert next(asked, "all asked") == "all asked"
    experiment, table = planned(tmp_path, grid("observer.link", [1.0, 2.0, 3.0]))
    whole = part_rows(experiment, table)
    simulate = rows_module.simulate_sampled_ensemble

    def failing(loops, *rest):
        if any(loop.observer_gains["link"] == 2.0 for loop in loops):
            raise ZeroDivisionError("no\nway")
        return simulate(loops, *rest)

    monkeypatch.setattr(rows_module, "simulate_sampled_ensemble", failing)
    rows = part_rows(experiment, table)
    assert rows["status"].to_list() == ["finished", "error", "finished"]
    assert rows["error"].to_list() == [None, "ZeroDivisionError: no way", None]
    assert rows[[0, 2]].equals(whole[[0, 2]])
