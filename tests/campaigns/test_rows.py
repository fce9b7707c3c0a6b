"""Rows of runs: they are what a single simulation gives, and a failed run is a row."""

import numpy as np
import polars as pl
import pytest
from tests.campaigns.tiny import EXPERIMENT, write_experiment

from flexid.campaigns import rows as rows_module
from flexid.campaigns.plan import make_plan
from flexid.campaigns.rows import Part, Stopped, part_rows, run_part
from flexid.experiments import read_experiment
from flexid.experiments.measures import run_columns

ALL = ("final_errors", "final_states", "settling_time", "tracking", "excitation", "peak_input")


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
    """Assert that gain and noise of each row, set by hand in one run, give the row's results."""
    experiment, table = planned(tmp_path, grid("controller.proportional", [20.0, 40.0]))
    rows = part_rows(experiment, table, ALL)
    for row in rows.to_dicts():
        names = ("controller.proportional", "sampling.seed")
        run = experiment.with_values({name: row[name] for name in names}).run()
        assert row["status"] == "finished"
        assert row["final_error.theta2"] == pytest.approx(run.final_errors()["theta2"])
        assert row["final_state.x3"] == pytest.approx(run.states[-1, 2])
        assert row["peak_input.u"] == pytest.approx(np.abs(run.inputs).max())
        assert row["tracking_rms"] == pytest.approx(np.sqrt(np.mean(run.tracking_error**2)))
    assert rows["final_error.theta2"].n_unique() == 2


def test_only_what_is_asked_for_is_kept(tmp_path):
    """Assert that status, end and steps come always, the rest by name."""
    experiment, table = planned(tmp_path, grid("observer.link", [1.0]))
    rows = part_rows(experiment, table, ("tracking",))
    always = ["run", "observer.link", "sampling.seed", "status", "error", "reached", "steps"]
    assert rows.columns == [*always, "tracking_rms", "tracking_peak"]


def test_relative_errors_are_those_of_each_runs_own_truth(tmp_path):
    """Assert that a varied plant is the measure of its own errors."""
    experiment, table = planned(tmp_path, grid("plant.joint_stiffness", [80.0, 120.0]))
    rows = part_rows(experiment, table, ("final_errors",))
    truth = rows["plant.joint_stiffness"]  # theta2 with a link inertia of 1
    assert rows["relative_error.theta2"].to_list() == pytest.approx(
        (rows["final_error.theta2"].abs() / truth).to_list()
    )


def test_a_diverging_run_is_a_row(tmp_path):
    """Assert that a gain that diverges says so, when it did, and that its neighbours finish."""
    text = EXPERIMENT.replace("duration = 0.1", "duration = 2.0")
    values = [10.0, 1e9, 10.0]
    experiment, table = planned(tmp_path, grid("controller.derivative", values), text)
    rows = part_rows(experiment, table, ALL)
    assert rows["status"].to_list() == ["finished", "diverged", "finished"]
    assert rows["error"].to_list() == [None, None, None]
    assert rows["reached"][1] < 2.0
    assert rows["reached"][0] == pytest.approx(2.0)


def test_a_value_that_is_not_allowed_is_a_row(tmp_path):
    """Assert that a negative noise, drawn from a normal distribution, loses its own run alone."""
    campaign = """
    [campaign]
    kind = "sobol"
    runs = 8
    vary.sampling.position_noise = { normal = [1e-4, 1e-4] }
    """
    experiment, table = planned(tmp_path, campaign)
    rows = part_rows(experiment, table, ALL)
    negative = rows["sampling.position_noise"] < 0.0
    assert 0 < negative.sum() < 8
    assert (rows["status"] == "error").to_list() == negative.to_list()
    for text in rows.filter(negative)["error"]:
        assert "sampling.position_noise" in text
    assert rows.filter(~negative)["final_error.theta1"].is_finite().all()
    assert rows.filter(negative)["final_error.theta1"].is_nan().all()


def test_an_unexpected_failure_loses_one_run(tmp_path, monkeypatch):
    """Assert that when a whole ensemble fails, the runs are tried one by one, and bits stay."""
    experiment, table = planned(tmp_path, grid("observer.link", [1.0, 2.0, 3.0]))
    whole = part_rows(experiment, table, ALL)
    simulate = rows_module.simulate_sampled_ensemble

    def failing(loops, *rest):
        if any(loop.observer_gains["link"] == 2.0 for loop in loops):
            raise ZeroDivisionError("no\nway")
        return simulate(loops, *rest)

    monkeypatch.setattr(rows_module, "simulate_sampled_ensemble", failing)
    rows = part_rows(experiment, table, ALL)
    assert rows["status"].to_list() == ["finished", "error", "finished"]
    assert rows["error"].to_list() == [None, "ZeroDivisionError: no way", None]
    assert rows[[0, 2]].equals(whole[[0, 2]])


def test_runs_may_differ_in_length(tmp_path):
    """Assert that the duration, too, can be varied."""
    experiment, table = planned(tmp_path, grid("run.duration", [0.05, 0.1, 0.05]))
    rows = part_rows(experiment, table, ALL)
    assert rows["steps"].to_list() == [51, 101, 51]
    assert rows["reached"].to_list() == pytest.approx([0.05, 0.1, 0.05])


def test_a_continuous_loop_has_no_seed(tmp_path):
    """Assert that a continuous experiment runs as well, without noise to be seeded."""
    text = EXPERIMENT.partition("[sampling]")[0].replace("duration = 0.1", "duration = 0.05")
    experiment, table = planned(tmp_path, grid("controller.derivative", [5.0, 10.0]), text)
    rows = part_rows(experiment, table, ("tracking",))
    assert "sampling.seed" not in rows.columns
    assert rows["status"].to_list() == ["finished", "finished"]


def test_a_part_stops_when_asked(tmp_path):
    """Assert that a part gives up between two batches."""
    experiment, table = planned(tmp_path, grid("observer.link", [1.0] * 20))
    asked = iter([False, True])
    with pytest.raises(Stopped):
        part_rows(experiment, table, ALL, lambda: next(asked))
    assert next(asked, "all asked") == "all asked"


def test_time_series_are_those_of_the_single_runs(tmp_path):
    """Assert that the series of the finished runs lie one below the other, by number."""
    campaign = grid("controller.derivative", [10.0, 1e9, 5.0])
    text = EXPERIMENT.replace("duration = 0.1", "duration = 1.0")
    experiment, table = planned(tmp_path, campaign, text)
    _, rows, series = run_part(experiment, Part(0, table, ("time_series",)))
    assert rows["status"].to_list() == ["finished", "diverged", "finished"]
    assert series is not None
    assert series["run"].unique().to_list() == [0, 2]
    names = ("controller.derivative", "sampling.seed")
    last = experiment.with_values({name: rows[name][2] for name in names}).run()
    assert series.filter(pl.col("run") == 2).drop("run").equals(pl.DataFrame(run_columns(last)))
