"""Blind and realistic trials: repeatable, independent of flexid, equal to the stored results."""

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from benchmarks.trials.drafts import Draft, Size, acting, truth
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import make_trial
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from benchmarks.trials.page import RESULTS
from benchmarks.trials.realistic.drafts import truth_of
from benchmarks.trials.realistic.drive import Plant
from benchmarks.trials.realistic.drive import simulate as simulate_plant
from benchmarks.trials.realistic.families import REALISTIC
from benchmarks.trials.realistic.generate import record
from benchmarks.trials.realistic.play import STEP
from benchmarks.trials.repeated import make_repeated
from scipy.integrate import solve_ivp

ROOT = Path(__file__).parents[2]
KEPT = {r["family"]: r for r in json.loads(RESULTS.read_text(encoding="utf-8"))["records"]}


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
    channels = (trial.time, trial.link_position, trial.motor_position, trial.torque)
    assert np.isfinite(channels).all()
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


drawn = cache(record)
NONLINEAR = dict.fromkeys(("coulomb", "static_extra", "ripple", "dead_zone", "drift"), 0.0)
NONLINEAR |= {"cable_stiffness": 0.0, "cable_cubic": 0.0, "saturation": np.inf}
STIFF = {"joint_stiffness": 60.0, "tip_stiffness": 80.0, "saturation": 4.0, "friction_width": 0.05}
FAST = {"ripple_number": 10.0, "lag": 2e-3, "gauge_lag": 4e-3}
NO_PLAY = {"cubic_stiffness": 0.0, "half_gap": 0.0}
DRAWN = np.random.default_rng(1).uniform(0.1, 0.4, len(Plant._fields)).tolist()
MANY_SINS = Plant(*DRAWN)._replace(**STIFF, **FAST, **NO_PLAY)


def test_the_integrator_agrees_with_scipy():
    """Assert that a drive with all effects agrees with SciPy's integrator, under a held input."""

    def slope(time, state):
        q, w, r, s, p, v, x, g = state
        plant = MANY_SINS
        joint = plant.joint_stiffness * (q - p) + plant.joint_damping * (w - v)
        bend = plant.tip_stiffness * (r - q) + plant.tip_damping * (s - w)
        inertias = np.array([plant.near_inertia, plant.tip_inertia])
        near, tip = plant.gravity_torque * inertias / inertias.sum()
        away = q - plant.cable_angle
        cable = plant.cable_stiffness * away + plant.cable_cubic * away**3
        warmth = 1.0 - plant.drift * (1.0 - np.exp(-time / plant.drift_time))
        dry = plant.coulomb + plant.static_extra * np.exp(-((v / plant.stribeck_velocity) ** 2))
        rub = warmth * (plant.motor_viscous * v + dry * np.tanh(v / plant.friction_width))
        angle = plant.ripple_number * p + plant.ripple_phase
        wave = plant.ripple * np.sin(angle) + plant.ripple_second * np.sin(2.0 * angle)
        link = bend - joint - plant.link_viscous * w - near * np.sin(q) - cable + 0.3
        return [
            w,
            link / plant.near_inertia,
            s,
            (-tip * np.sin(r) - bend) / plant.tip_inertia,
            v,
            (joint - rub + wave + x - 0.1) / plant.motor_inertia,
            (2.0 - plant.dead_zone - plant.back_emf * v - x) / plant.lag,
            (q - p - g) / plant.gauge_lag,
        ]

    times = np.linspace(0.0, 1.0, 101)
    held, pushes = np.full(101, 2.0), np.tile([0.3, -0.1], (101, 1))
    run = simulate_plant(MANY_SINS, times, held, Law(), np.zeros((101, 3)), pushes, 0.0, STEP)
    exact = solve_ivp(slope, (0.0, 1.0), np.zeros(8), "DOP853", times, rtol=1e-10, atol=1e-11)
    assert np.ptp(run[:, 0]) > 0.3
    np.testing.assert_allclose(run[:, :5], exact.y[[0, 1, 4, 5, 7]].T, atol=1e-7)


def response(plant, draft, frequency):
    """Return amplitudes of link, motor, logged deflection and input, for a slow small sine."""
    inertia = plant.near_inertia + plant.tip_inertia + plant.motor_inertia
    size = 0.01 * (inertia * frequency**2 + plant.gravity_torque)
    times = np.arange(0.0, 24.0 * np.pi / frequency, 2e-3)
    grid = np.exp(1j * frequency * times)
    course, pushes = np.zeros((len(times), 3)), np.zeros((len(times), 2))
    run = simulate_plant(plant, times, size * grid.imag, Law(), course, pushes, 0.0, STEP)
    late = times > 16.0 * np.pi / frequency
    basis = np.column_stack((grid.real, grid.imag, np.ones(len(times)), times))[late]
    found = np.linalg.lstsq(basis, run[late])[0]
    link, motor, gauge, torque = (found[0] - 1j * found[1])[[0, 2, 4, 5]]
    torque *= np.exp(-1j * frequency * 1e-3)  # held for 2 ms
    if draft.has_gauge:
        return motor + draft.gauge_scale * gauge, motor, draft.gauge_scale * gauge, torque
    return link, motor, link - motor, torque


@pytest.mark.parametrize("family", REALISTIC)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_truth_is_the_low_frequency_response(family, seed):
    """Assert that lumped equations with the true values describe a slow sine.

    The second mode, gauge, back-EMF and lag of current or coil act, without nonlinear effects. The
    tolerance allows for the lag's phase. Viscous friction is raised, so that the start decays.
    """
    _, draft, plant, *_ = drawn(family, seed)
    plant = plant._replace(**NONLINEAR, motor_viscous=5.0 * plant.motor_viscous)
    right, _ = truth_of(draft, plant, 1.0)
    motor_inertia = plant.motor_inertia
    if not draft.volts:
        motor_inertia, link_inertia = right["motor_inertia"], right["link_inertia"]
        stiffness_link = right["joint_stiffness"] / link_inertia
        stiffness_motor = right["joint_stiffness"] / motor_inertia
        viscous = right["motor_viscous_friction"] / motor_inertia
        gravity = right["gravity_torque"] / link_inertia
        damping = right["joint_damping"]
    else:
        stiffness_link = right["joint_stiffness_per_link_inertia"]
        stiffness_motor = right["joint_stiffness_per_motor_inertia"]
        viscous = right["viscous_friction_per_motor_inertia"]
        gravity = right["gravity_torque_per_link_inertia"]
        damping = plant.joint_damping
    frequency = 0.1 * draft.resonance
    link, motor, deflection, torque = response(plant, draft, frequency)
    rate = 1j * frequency
    spring = (-(rate**2) - gravity) * link  # per link inertia
    assert (spring / deflection).real == pytest.approx(stiffness_link, rel=5e-3)
    needed = rate**2 * motor + viscous * rate * motor - stiffness_motor * deflection
    needed -= damping / motor_inertia * rate * deflection
    assert abs(motor_inertia * needed / torque - 1.0) < 0.01 + 1.5 * frequency * plant.lag
