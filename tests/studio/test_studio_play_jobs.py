"""Runs of the paper's closed loop for the page."""

from __future__ import annotations

import numpy as np
import pytest

from flexid.analysis.excitation import excitation
from flexid.analysis.histories import row_histories
from flexid.errors import SimulationError
from flexid.simulation import closed_loop
from flexid.simulation.closed_loop import simulate
from flexid.simulation.loop import ClosedLoop
from flexid.simulation.run import Run
from flexid.studio import play_jobs
from flexid.studio.play_choices import TABLE1, read_play
from flexid.studio.play_jobs import play


def numbers(rows: tuple[tuple[str, str, str], ...], place: int) -> dict[str, float]:
    """The first number of each row."""
    return {row[0]: float(row[place].split()[0]) for row in rows if row[place]}


def test_the_readings_differ_as_the_reproduction_says():
    """Assert that one reading tracks and learns slowly, the other the reverse: the misprint."""
    found = play(print, read_play({"reading": "1,1,3"}), TABLE1)
    run, pinned = numbers(found.rows, 1), numbers(found.rows, 2)
    assert pinned["tracking error"] == pytest.approx(8.2e-4, rel=0.02)
    assert run["tracking error"] == pytest.approx(0.27, rel=0.02)
    assert run["error of α₂"] < 1e-3 < pinned["error of α₂"]
    assert found.problems == ()
    assert len(found.chart["panels"]) == 4


def test_condition_numbers_are_those_of_the_analysis():
    """Assert that the excitation over time ends at what is measured over the same stretch."""
    run = simulate(TABLE1.loop, play_jobs.DURATION, 0.01, 1e-6)
    histories = {history.row: history for history in row_histories(run)}
    moments, found = play_jobs._conditions(
        run.time, {row: history.regressors for row, history in histories.items()}
    )
    assert moments[-1] == pytest.approx(play_jobs.DURATION)
    for row, history in histories.items():
        truth = excitation(row, history.coefficients, history.regressors[-200:])
        assert found[row][-1] == pytest.approx(truth.condition_number, rel=1e-6)


def test_a_sampled_drive_is_played():
    """Assert that noise and sampling are those of the sliders, and the run has the same figures."""
    slow = {"k": "5", "sampled": "yes", "sample_time": "0.001", "amplitude": "1", "frequency": "1"}
    quiet = play(print, read_play({**slow, "noise": "1e-7"}), None)
    noisy = play(print, read_play({**slow, "noise": "0.01"}), None)
    assert quiet.problems == noisy.problems == ()
    first, second = numbers(quiet.rows, 1), numbers(noisy.rows, 1)
    assert np.isfinite([*first.values(), *second.values()]).all()
    assert second["tracking error"] > first["tracking error"]


def test_what_diverges_is_said(monkeypatch: pytest.MonkeyPatch):
    """Assert that a loop that ends early is answered in a sentence, beside the pinned one."""

    def stopped(loop: ClosedLoop, duration: float, sample_time: float, tolerance: float) -> Run:
        if loop.controller.parameters["k"] > 60.0:
            raise SimulationError("the loop diverges", 1.5)
        return simulate(loop, duration, sample_time, tolerance)

    monkeypatch.setattr(closed_loop, "simulate", stopped)
    found = play(print, read_play({"k": "77"}), TABLE1)
    assert found.problems == ("This run: simulation stopped at t = 1.5 s: the loop diverges.",)
    assert found.rows[0][1] == ""
    assert found.rows[0][2] != ""


def test_where_the_true_value_is_zero_the_error_has_its_unit():
    """Assert that nothing is divided by zero: no share, and no curve among the shares."""
    found = play(print, read_play({"gravity_torque": "0", "motor_viscous_friction": "0"}), None)
    rows = {label: run for label, run, _ in found.rows}
    shares = {label: text.endswith(" %") for label, text in rows.items() if "error of" in label}
    assert shares == {
        "error of θ₁": False, "error of θ₂": True, "error of α₁": True, "error of α₂": False
    }  # fmt: skip
    assert rows["error of α₂"].endswith("1/s")
    marks = found.chart["panels"][1]["marks"]
    assert [mark["label"] for mark in marks] == ["θ₂", "α₁"]
