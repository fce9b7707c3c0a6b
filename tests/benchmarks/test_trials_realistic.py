"""Realistic trials: repeatable, independent of flexid, and true to their low-frequency physics."""

from functools import cache

import numpy as np
import pytest
from benchmarks.trials.integrator import Law
from benchmarks.trials.realistic.drafts import truth_of
from benchmarks.trials.realistic.drive import Plant, simulate
from benchmarks.trials.realistic.families import REALISTIC
from benchmarks.trials.realistic.generate import record
from benchmarks.trials.realistic.play import STEP
from scipy.integrate import solve_ivp

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
    run = simulate(MANY_SINS, times, held, Law(), np.zeros((101, 3)), pushes, 0.0, STEP)
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
    run = simulate(plant, times, size * grid.imag, Law(), course, pushes, 0.0, STEP)
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
    truth, _ = truth_of(draft, plant, 1.0)
    motor_inertia = plant.motor_inertia
    if not draft.volts:
        motor_inertia, link_inertia = truth["motor_inertia"], truth["link_inertia"]
        stiffness_link = truth["joint_stiffness"] / link_inertia
        stiffness_motor = truth["joint_stiffness"] / motor_inertia
        viscous = truth["motor_viscous_friction"] / motor_inertia
        gravity = truth["gravity_torque"] / link_inertia
        damping = truth["joint_damping"]
    else:
        stiffness_link = truth["joint_stiffness_per_link_inertia"]
        stiffness_motor = truth["joint_stiffness_per_motor_inertia"]
        viscous = truth["viscous_friction_per_motor_inertia"]
        gravity = truth["gravity_torque_per_link_inertia"]
        damping = plant.joint_damping
    frequency = 0.1 * draft.resonance
    link, motor, deflection, torque = response(plant, draft, frequency)
    rate = 1j * frequency
    spring = (-(rate**2) - gravity) * link  # per link inertia
    assert (spring / deflection).real == pytest.approx(stiffness_link, rel=5e-3)
    needed = rate**2 * motor + viscous * rate * motor - stiffness_motor * deflection
    needed -= damping / motor_inertia * rate * deflection
    assert abs(motor_inertia * needed / torque - 1.0) < 0.01 + 1.5 * frequency * plant.lag
