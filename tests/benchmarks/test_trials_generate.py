"""Blind trials: repeatable, independent of flexid, and equal to those of the stored results."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks.trials.drafts import Draft, Size, acting, truth
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import make_trial
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from benchmarks.trials.page import RESULTS
from benchmarks.trials.repeated import make_repeated

ROOT = Path(__file__).parents[2]
KEPT = {r["family"]: r for r in json.loads(RESULTS.read_text(encoding="utf-8"))["records"]}


def columns(trial):
    """Return all channels as one array."""
    return np.column_stack((trial.time, trial.link_position, trial.motor_position, trial.torque))


@pytest.mark.parametrize("module", ["repeated", "realistic.generate"])
def test_the_generator_does_not_import_flexid(module):
    """Assert that a log is generated without importing flexid."""
    code = (
        f"import sys, benchmarks.trials.{module}\n"
        "assert not [name for name in sys.modules if name.split('.')[0] == 'flexid']"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_one_drive_is_recorded_again():
    """Assert that a repeated drive keeps all values but the changed one, with another motion."""
    first, other, stiffer, again = make_repeated("coulomb", 1, [{}, {}, {"joint_stiffness": 1.05}])
    assert other.truth == first.truth
    changed = {name: stiffer.truth[name] / value for name, value in first.truth.items() if value}
    assert changed.pop("joint_stiffness") == pytest.approx(1.05)
    assert set(changed.values()) == {1.0}
    assert len(other.time) != len(first.time) or np.any(other.torque != first.torque)
    assert again.truth == first.truth
    np.testing.assert_array_equal(again.torque, first.torque)
    apart = again.link_position - first.link_position
    assert 0.0 < np.abs(apart).max() < 0.01 * np.ptp(first.link_position)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_draws_the_logs_of_the_results(family):
    """Assert truth, settings and motion of a log of each family, as in the stored results."""
    kept = KEPT[family]
    trial = make_trial(family, kept["seed"])
    acts = {name: value for name, value in trial.truth.items() if value}
    assert acts == pytest.approx(kept["truth"], rel=1e-8)
    for name, value in kept["drawn"].items():
        expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-3)
        assert trial.metadata[name] == expected
    assert list(trial.terms) == kept["terms"]
    assert set(trial.terms) == set(acting(dict(trial.truth)))
    assert trial.in_class is FAMILIES[family].in_class is kept["in_class"]
    shortest, longest = FAMILIES[family].draw(np.random.default_rng(0)).durations
    assert shortest - 0.1 < trial.time[-1] < longest + 0.1
    assert np.all(np.diff(trial.time) > 0.0)
    assert np.all(np.isfinite(columns(trial)))
    assert (trial.link_position - trial.motor_position).std() > 2e-4


def test_offsets_and_masses_become_what_the_log_shows():
    """Assert that two masses act as one, and that encoder offsets deflect the spring."""
    drive = Drive(1.0, 0.5, 100.0, gravity_torque=3.0, payload_torque=4.0, payload_angle=np.pi / 2)
    drive = drive._replace(motor_coulomb_up=1.0, motor_coulomb_down=3.0, motor_offset=0.5)
    draft = Draft(drive, 20.0, 20.0, 1.0, link_zero=0.02, motor_zero=-0.01, torque_zero=0.1)
    values = truth(draft, drive, Size(2.0, 3.0, 0.1, 0.2))
    assert values["gravity_torque"] == pytest.approx(5.0)
    assert values["gravity_angle"] == pytest.approx(np.arctan2(4.0, 3.0) + 0.02)
    assert values["motor_coulomb_friction"] == 2.0
    assert values["link_offset_torque"] == pytest.approx(3.0)
    assert values["motor_offset_torque"] == pytest.approx(0.5 + 1.0 - 0.2 - 3.0)


def played(drive, times, held):
    """Return states at the times, under a torque that is constant from each time to the next."""
    course, nothing = np.zeros((len(times), 3)), np.zeros(len(times))
    rest = held.copy(), nothing, Smooth(np.empty(0), 0.0, 1.0), Law(), course, 0.0, 5e-5
    return simulate(drive, times, times, times, *rest)[0]


def test_lugre_creeps_before_it_breaks_away():
    """Assert that a load below static friction deflects the bristles only."""
    bristles = {"bristle_stiffness": 2000.0, "bristle_damping": 14.0, "stribeck_velocity": 0.05}
    bristles |= {"bristle_coulomb": 1.0, "bristle_static": 1.5}
    drive = Drive(0.01, 0.1, 10.0, link_viscous=1.0, **bristles)
    times = np.arange(3001) * 1e-3
    crept = played(drive, times, 0.8 * np.minimum(times, 1.0))[-1, 2]
    # Slowly pulled bristles: load = static (1 - exp(-stiffness x / static)).
    assert crept == pytest.approx(-np.log(1.0 - 0.8 / 1.5) * 1.5 / 2000.0, rel=0.02)
    assert played(drive, times, np.full(len(times), 1.6))[-1, 2] > 0.5
