"""Sampled-data loops."""

from dataclasses import replace

import numpy as np
import pytest
from table_1 import table_1

from flexid.control.laws import pd_gravity
from flexid.control.references import constant
from flexid.errors import SettingError, SimulationError
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.closed_loop import simulate
from flexid.simulation.free_run import free_run
from flexid.simulation.sampled import Sampling, simulate_sampled

LOOP = table_1(controller=pd_gravity())
REAL = Sampling(
    input_limit=30.0, position_resolution=1e-4, position_noise=1e-5, velocity_noise=1e-2, seed=7
)


def test_approaches_the_continuous_loop() -> None:
    """Assert that the error against the continuous loop falls in proportion to the sample time."""
    times = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    errors = []
    for sample_time in times:
        exact = simulate(LOOP, 4.0, sample_time, 1e-9)
        sampled = simulate_sampled(LOOP, 4.0, Sampling(sample_time))
        errors.append(np.max(np.abs(sampled.states - exact.states)))
    assert 0.9 < np.polyfit(np.log(times), np.log(errors), 1)[0] < 1.1


def test_observer_is_of_second_order() -> None:
    """Assert that under a constant input the estimates err with the square of the sample time."""
    law = LOOP.controller.with_parameters(proportional=0.0, derivative=0.0)
    loop = replace(
        LOOP, controller=law, reference=constant(1.0), initial_state=(0.5, 0.0, 0.7, 0.0)
    )
    exact = simulate(loop, 2.0, 1e-2, 1e-10).parameter_errors[-1]
    times = np.array([8e-3, 4e-3, 2e-3, 1e-3])
    errors = [
        np.max(np.abs(simulate_sampled(loop, 2.0, Sampling(h)).parameter_errors[-1] - exact))
        for h in times
    ]
    assert 1.9 < np.polyfit(np.log(times), np.log(errors), 1)[0] < 2.1


def test_stable_at_any_gain() -> None:
    """Assert that an absurd observer gain leaves the estimates bounded."""
    loop = replace(LOOP, observer_gains={"link": 1e9, "motor": 1e9})
    run = simulate_sampled(loop, 5.0, REAL)
    assert np.max(np.abs(run.parameter_errors)) < 1e5


def test_called_law_is_the_compiled_one() -> None:
    """Assert that the same law as a Python function gives the same run, sensors and limit too."""
    p = LOOP.controller.parameters

    def law(_: float, x: np.ndarray, reference: np.ndarray) -> float:
        torque, stiffness = p["nominal_gravity_torque"], p["nominal_joint_stiffness"]
        position = reference[0] + torque * np.sin(reference[0]) / stiffness
        speed = reference[1] + torque * np.cos(reference[0]) * reference[1] / stiffness
        feedback = p["proportional"] * (position - x[2]) + p["derivative"] * (speed - x[3])
        return torque * np.sin(reference[0]) + feedback

    compiled, called = simulate_sampled(LOOP, 2.0, REAL), simulate_sampled(LOOP, 2.0, REAL, law)
    assert called.states == pytest.approx(compiled.states, abs=1e-10)
    assert called.estimates == pytest.approx(compiled.estimates, abs=1e-8)
    assert called.statistics == compiled.statistics


def test_input_is_limited() -> None:
    """Assert that no input passes the limit, and that the limited samples are counted."""
    run = simulate_sampled(LOOP, 2.0, REAL)
    assert np.max(np.abs(run.inputs)) == 30.0
    assert run.statistics["limited_samples"] == np.count_nonzero(np.abs(run.inputs) == 30.0) > 0


def test_encoder_shows_whole_steps() -> None:
    """Assert that measured positions are multiples of the resolution, within half a step."""
    run = simulate_sampled(LOOP, 2.0, Sampling(position_resolution=1e-3))
    assert run.measured is not None
    positions = run.measured[:, ::2]
    assert np.max(np.abs(positions / 1e-3 - np.round(positions / 1e-3))) < 1e-9
    assert np.max(np.abs(positions - run.states[:, ::2])) < 0.5e-3 * (1 + 1e-9)
    assert np.array_equal(run.measured[:, 1::2], run.states[:, 1::2])


def test_noise_is_what_was_asked_for() -> None:
    """Assert that noise has the stated deviations and comes back with the same seed only."""
    noisy = Sampling(position_noise=1e-4, velocity_noise=2e-2, seed=1)
    run, again = simulate_sampled(LOOP, 10.0, noisy), simulate_sampled(LOOP, 10.0, noisy)
    other = simulate_sampled(LOOP, 10.0, replace(noisy, seed=2))
    assert run.measured is not None
    noise = run.measured - run.states
    assert np.std(noise, axis=0) == pytest.approx([1e-4, 2e-2, 1e-4, 2e-2], rel=0.05)
    assert np.array_equal(run.states, again.states)
    assert not np.array_equal(run.states, other.states)


def test_log_has_the_columns_of_a_log() -> None:
    """Assert that a run turns into a log of what was measured, under the canonical names."""
    run = simulate_sampled(LOOP, 0.5, REAL)
    log = run.log()
    assert list(log) == [
        "time",
        "link_position",
        "link_velocity",
        "motor_position",
        "motor_velocity",
        "motor_torque",
    ]
    assert run.measured is not None
    assert np.array_equal(log["motor_position"], run.measured[:, 2])
    assert np.array_equal(log["motor_torque"], run.inputs[:, 0])


def test_divergence_is_reported() -> None:
    """Assert that the paper's high-gain law, sampled at 1 kHz, is said to diverge."""
    with pytest.raises(SimulationError, match="diverges: lower its gains or its sample time"):
        simulate_sampled(table_1(), 30.0)


@pytest.mark.parametrize(
    ("setting", "value"), [("sample_time", 0.0), ("input_limit", 0.0), ("velocity_noise", -1.0)]
)
def test_settings_out_of_range(setting: str, value: float) -> None:
    """Assert that a setting out of its range is named."""
    with pytest.raises(SettingError, match=setting):
        replace(Sampling(), **{setting: value})


def test_plant_moves_as_in_a_free_run() -> None:
    """Assert that between samples the plant does what a free run under the held input does.

    Its friction is so steep that a hundredth of a second has to be divided many times.
    """
    terms = ("gravity", "motor_viscous", "motor_coulomb")
    system = flexible_joint(terms, dict(LOOP.system.constants))
    coefficients = {**LOOP.coefficients, "alpha_coulomb": 300.0}
    loop = replace(LOOP, system=system, coefficients=coefficients)
    run = simulate_sampled(loop, 2.0, Sampling(1e-2))
    alone = free_run(system, coefficients, np.zeros(4), run.inputs, 1e-2, "zero")
    np.testing.assert_allclose(run.states, alone, atol=1e-9)
