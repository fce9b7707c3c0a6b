"""Play: limits of its sliders, its runs, and the room in a browser."""

from typing import Any

import numpy as np
import pytest

from browser import Watched, serious_faults
from flexid.errors import SettingError, SimulationError
from flexid.report.reproduction import SYMBOLS
from flexid.simulation import closed_loop
from flexid.simulation.closed_loop import ClosedLoop, Run, simulate
from flexid.studies.runs import table1_loop
from flexid.studio import play as played
from flexid.studio.choices import READINGS, SLIDERS, TABLE1, read_play
from flexid.studio.play import play


def test_runs_of_an_address():
    """Assert the paper's loop at first, and a run and a pinned run of one address."""
    paper = table1_loop((1, 2, 3))
    assert TABLE1.loop.parameters.tolist() == pytest.approx(paper.parameters.tolist())
    assert TABLE1.loop.start_estimates.tolist() == paper.start_estimates.tolist()
    assert TABLE1.sampling is None
    assert read_play({}) == TABLE1
    assert set(READINGS) == {"1,2,3", "1,1,3"}
    held = {"reading": "1,1,3", "k": "80", "sampled": "yes", "torque_limit": "500"}
    chosen = read_play({**held, "pin.amplitude": "0.5"})
    assert (chosen.reading, chosen.values["k"], chosen.sampled) == ("1,1,3", 80.0, True)
    assert chosen.sampling is not None
    assert chosen.sampling.input_limit == 500.0
    pinned = read_play({**held, "pin.amplitude": "0.5"}, "pin.")
    assert pinned.values == {**TABLE1.values, "amplitude": 0.5}
    assert pinned.reading == "1,2,3"


@pytest.mark.parametrize("slider", SLIDERS, ids=lambda slider: slider.name)
def test_ends_of_a_slider(slider):
    """Assert that values at a slider's ends are accepted, and none beyond."""
    for value in (slider.lowest, slider.highest):
        assert read_play({slider.name: repr(float(value))}).values[slider.name] == value
    for text in (slider.highest * 1.01, slider.lowest - 0.01 * slider.highest, "nan", "inf", "x"):
        with pytest.raises(SettingError, match=slider.name):
            read_play({slider.name: str(text)})


def numbers(rows: tuple[tuple[str, ...], ...], place: int) -> dict[str, float]:
    """Return the first number of each row."""
    return {row[0]: float(row[place].split()[0]) for row in rows if row[place]}


def test_the_readings_differ_as_the_reproduction_says():
    """Assert that one reading tracks well and learns slowly, and the other the reverse."""
    found = play(read_play({"reading": "1,1,3"}), TABLE1)
    run, pinned = numbers(found.rows, 1), numbers(found.rows, 2)
    assert pinned["tracking error"] == pytest.approx(8.2e-4, rel=0.02)
    assert run["tracking error"] == pytest.approx(0.27, rel=0.02)
    assert run["error of α₂"] < 1e-3 < pinned["error of α₂"]
    assert found.problems == ()
    assert pinned["error of α₂"] == pytest.approx(34.0, rel=0.02)
    assert found.figure.count("<svg") == 1
    assert "weak above" in found.figure


def test_runs_that_stop_early_are_said(monkeypatch: pytest.MonkeyPatch):
    """Assert that a loop which is too stiff, or diverges, is reported, with the pinned run."""
    place = {"joint_stiffness": "356.284", "link_inertia": "0.479886", "motor_inertia": "1.90409"}
    place |= {"gravity_torque": "7.80828", "motor_viscous_friction": "0.994425", "k": "9.72432"}
    place |= {"c": "19.3159", "amplitude": "0.471841", "frequency": "6.3583", "reading": "1,1,3"}
    (problem,) = play(read_play(place), None).problems
    assert f"{played._MOST_STEPS} steps did not suffice" in problem

    def stopped(loop: ClosedLoop, *settings: Any) -> Run:
        if loop.controller.parameters["k"] > 60.0:
            raise SimulationError("the loop diverges: raise maximum_steps", 1.5)
        return simulate(loop, *settings)

    monkeypatch.setattr(closed_loop, "simulate", stopped)
    found = play(read_play({"k": "77"}), TABLE1)
    assert found.problems == ("This run stops at 1.5 s: the loop diverges. Move a slider back.",)
    assert found.rows[0][1] == ""
    assert found.rows[0][2] != ""


def test_the_tolerance_suffices_for_what_is_shown():
    """Assert that figures of a stiff loop agree with a run at smaller tolerances."""
    place = {"reading": "1,1,3", "k": "121", "c": "0.0385", "amplitude": "5.29"}
    choices = read_play(place)
    rows = numbers(play(choices, None).rows, 1)
    fine = played._measured(simulate(choices.loop, played.DURATION, 0.01, 1e-6, 1e-10))
    for label in ("tracking error", *(f"error of {symbol}" for symbol in SYMBOLS.values())):
        value = float(fine.figures[label].split()[0])
        assert rows[label] == pytest.approx(value, rel=0.06, abs=1e-6)


def test_sampled_drives_and_zero_values():
    """Assert figures that follow noise and sampling, and errors of zero values in their unit."""
    slow = {"k": "5", "sampled": "yes", "sample_time": "0.001", "amplitude": "1", "frequency": "1"}
    quiet = play(read_play({**slow, "noise": "1e-7"}), None)
    noisy = play(read_play({**slow, "noise": "0.01"}), None)
    assert quiet.problems == noisy.problems == ()
    first, second = numbers(quiet.rows, 1), numbers(noisy.rows, 1)
    assert np.isfinite([*first.values(), *second.values()]).all()
    assert second["tracking error"] > first["tracking error"]
    found = play(read_play({"gravity_torque": "0", "motor_viscous_friction": "0"}), None)
    rows = {label: run for label, run, _ in found.rows}
    shares = {label: text.endswith(" %") for label, text in rows.items() if "error of" in label}
    assert shares == {
        "error of θ₁": False, "error of θ₂": True, "error of α₁": True, "error of α₂": False
    }  # fmt: skip
    assert rows["error of α₂"].endswith("1/s")
    assert [symbol in found.figure for symbol in SYMBOLS.values()] == [False, True, True, False]


def cell(page, column: int) -> str:
    """Return the tracking error of this run, or of the pinned one."""
    return page.inner_text(f"#play-figures tbody tr:first-child td:nth-child({column + 1})")


@pytest.mark.thorough
def test_the_misprint_is_one_click_away(page, empty_address: str):
    """Assert that the other reading is one click away, next to the first, and kept in the link."""
    watched = Watched(page)
    page.goto(empty_address)
    page.wait_for_selector("#file:enabled")
    page.click("nav >> text=Play")
    page.wait_for_selector("#play-figures table")
    assert cell(page, 1) == cell(page, 2) == "0.00082 rad"
    page.check("input[value='1,1,3']")
    page.wait_for_selector("#play-figures td:has-text('0.27 rad')")
    assert cell(page, 2) == "0.00082 rad"
    page.wait_for_selector("#play-charts .chart:has-text('V of Theorem 1')")
    assert serious_faults(page) == []
    again = page.url
    page.goto("about:blank")
    page.goto(again)
    page.wait_for_selector("#play-figures td:has-text('0.27 rad')")
    assert page.is_checked("input[value='1,1,3']")
    assert page.is_hidden("#room-identify")
    assert watched.complaints == []


@pytest.mark.thorough
def test_a_slider_is_moved_pinned_and_put_back(page, empty_address: str):
    """Assert that keys move a slider, that the run can be pinned, and that a reset works."""
    page.goto(f"{empty_address}?room=play&pin=none")
    page.wait_for_selector("#play-figures table")
    assert cell(page, 2) == ""
    page.focus("input[name=k]")
    for _ in range(5):
        page.keyboard.press("ArrowLeft")
    page.wait_for_selector("#play-figures td:not(:has-text('0.00082 rad'))")
    page.wait_for_url("**k=**")
    label = page.get_attribute("input[name=k]", "aria-valuetext")
    assert label is not None
    assert label.endswith("1/s")
    assert float(label.split()[0]) < 50.0
    page.click("text=Pin this run")
    page.wait_for_url("**pin.k=**")
    page.click("[data-kind=reset]")
    page.wait_for_url(lambda url: url.endswith("?room=play"))
    page.wait_for_selector("#play-figures td:has-text('0.00082 rad')")
