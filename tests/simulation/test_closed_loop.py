"""Closed loops in continuous time, and sampled ones."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexid.errors import SimulationError
from flexid.paper.laws import pd_gravity
from flexid.paper.loop import sinusoid
from flexid.simulation.closed_loop import simulate
from flexid.simulation.ensemble import simulate_ensemble, simulate_sampled_ensemble
from flexid.simulation.free_run import free_run
from flexid.simulation.sampled import Sampling, simulate_sampled
from flexid.studies.runs import table1_loop

TABLE_1 = table1_loop((1, 2, 3))
LOOP = replace(TABLE_1, controller=pd_gravity())
READINGS = json.loads((Path(__file__).parent / "reference" / "table_1.json").read_text())


@pytest.mark.parametrize("exponents", [(1, 2, 3), (1, 1, 3)])
def test_table_1(exponents: tuple[int, int, int]) -> None:
    """Assert that both readings agree with SciPy's Radau method on independent equations."""
    reference = READINGS[",".join(map(str, exponents))]
    run = simulate(table1_loop(exponents), 30.0)
    expected = np.array(reference["parameter_errors_at_30s"])
    # 1e-5 of the value, and at least 1e-8
    allowed = 1e-5 * np.maximum(np.abs(expected), 1e-3)
    assert np.all(np.abs(run.parameter_errors[-1] - expected) < allowed)
    largest = run.largest_tracking_error(20.0, 30.0)
    assert largest == pytest.approx(reference["max_tracking_error_20_30"], rel=1e-5)


@pytest.mark.parametrize("exponents", [(1, 1, 0), (1, 1, 1)])
def test_unstable_readings_say_so(exponents: tuple[int, int, int]) -> None:
    """Assert that a diverging loop raises an error with a time instead of returning values."""
    with pytest.raises(SimulationError, match="largest coordinate has reached") as caught:
        simulate(table1_loop(exponents), 30.0, maximum_steps=200_000)
    assert 0.1 < caught.value.time < 30.0


def test_input_is_what_moves_the_plant() -> None:
    """Assert that x4' of the run agrees with eq. (4) for the run's input."""
    run = simulate(LOOP, 2.0, 1e-3, 1e-9)
    x1, _, x3, x4 = run.states.T
    expected = (100.0 * (x1 - x3) - 0.1 * x4 + run.inputs[:, 0]) / 0.3
    slope = np.gradient(x4, run.time)[1:-1]
    assert slope == pytest.approx(expected[1:-1], abs=1e-4 * np.max(np.abs(expected)))


REAL = Sampling(
    input_limit=30.0, position_resolution=1e-4, position_noise=1e-5, velocity_noise=1e-2, seed=7
)


def test_approaches_the_continuous_loop() -> None:
    """Assert first-order convergence to the continuous loop in the sample time."""
    times = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    errors = []
    for sample_time in times:
        exact = simulate(LOOP, 4.0, sample_time, 1e-9)
        sampled = simulate_sampled(LOOP, 4.0, Sampling(sample_time))
        errors.append(np.max(np.abs(sampled.states - exact.states)))
    assert 0.9 < np.polyfit(np.log(times), np.log(errors), 1)[0] < 1.1


def test_observer_is_of_second_order() -> None:
    """Assert second-order convergence of the estimates under a constant input."""
    law = pd_gravity(proportional=0.0, derivative=0.0)
    loop = replace(
        LOOP,
        controller=law,
        reference=sinusoid(0.0, 5.0, offset=1.0),
        initial_state=(0.5, 0.0, 0.7, 0.0),
    )
    exact = simulate(loop, 2.0, 1e-2, 1e-10).parameter_errors[-1]
    times = np.array([8e-3, 4e-3, 2e-3, 1e-3])
    errors = [
        np.max(np.abs(simulate_sampled(loop, 2.0, Sampling(h)).parameter_errors[-1] - exact))
        for h in times
    ]
    assert 1.9 < np.polyfit(np.log(times), np.log(errors), 1)[0] < 2.1


def test_input_is_limited() -> None:
    """Assert that inputs are limited, and that limited samples are counted."""
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
    """Assert the noise's standard deviations, and equal noise for equal seeds only."""
    noisy = Sampling(position_noise=1e-4, velocity_noise=2e-2, seed=1)
    run, again = simulate_sampled(LOOP, 10.0, noisy), simulate_sampled(LOOP, 10.0, noisy)
    other = simulate_sampled(LOOP, 10.0, replace(noisy, seed=2))
    assert run.measured is not None
    noise = run.measured - run.states
    assert np.std(noise, axis=0) == pytest.approx([1e-4, 2e-2, 1e-4, 2e-2], rel=0.05)
    assert np.array_equal(run.states, again.states)
    assert not np.array_equal(run.states, other.states)


def test_divergence_is_reported() -> None:
    """Assert that the paper's high-gain law, sampled at 1 kHz, is reported to diverge."""
    with pytest.raises(SimulationError, match="diverges: lower its gains or its sample time"):
        simulate_sampled(TABLE_1, 30.0)


NEGATIVE: dict[str, Any] = dict.fromkeys(
    ["sample_time", "relative_tolerance", "absolute_tolerance"], -1.0
)
OUT_OF_RANGE: dict[str, Any] = {"sample_time": 0.0, "input_limit": 0.0, "velocity_noise": -1.0}
NO_ALPHA2 = {"theta1": 5.0, "theta2": 100.0, "alpha1": 333.0}
REFUSED: dict[str, Callable[[], object]] = {
    "duration": lambda: simulate(TABLE_1, -1.0),
    **{
        name: lambda name=name: simulate(TABLE_1, 1.0, **{name: NEGATIVE[name]})
        for name in NEGATIVE
    },
    "a coefficient": lambda: replace(TABLE_1, coefficients=NO_ALPHA2),
    **{
        f"{name} of a sampling": lambda name=name: replace(REAL, **{name: OUT_OF_RANGE[name]})
        for name in OUT_OF_RANGE
    },
    "no loops": lambda: simulate_ensemble([], 1.0),
    "two kinds of loops": lambda: simulate_ensemble([LOOP, TABLE_1], 1.0),
    "duration of many": lambda: simulate_ensemble([LOOP], -1.0),
    "samplings": lambda: simulate_sampled_ensemble([LOOP], 1.0, []),
    "duration of sampled ones": lambda: simulate_sampled_ensemble([LOOP], 0.0, [Sampling()]),
}


def test_settings_that_mean_nothing(refusals: Any) -> None:
    """Assert that an invalid setting, or a missing value, is named."""
    refusals(REFUSED)


def test_plant_moves_as_in_a_free_run() -> None:
    """Assert that between samples the plant moves as a free run, for steep friction too."""
    coefficients = {**LOOP.coefficients, "alpha2": 3000.0}
    run = simulate_sampled(replace(LOOP, coefficients=coefficients), 2.0, Sampling(1e-2))
    alone = free_run(LOOP.system, coefficients, np.zeros(4), run.inputs, 1e-2, "zero")
    np.testing.assert_allclose(run.states, alone, atol=1e-9)
