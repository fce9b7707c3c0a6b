"""Closed loops in continuous time, sampled ones, and ensembles compared with single runs."""

import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexid.errors import SimulationError
from flexid.experiments.measures import measure, settling_times
from flexid.paper.laws import pd_gravity
from flexid.paper.loop import sinusoid
from flexid.simulation.closed_loop import ClosedLoop, Run, simulate
from flexid.simulation.ensemble import STATUS, simulate_ensemble, simulate_sampled_ensemble
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


REAL = Sampling(
    input_limit=100.0, position_resolution=1e-4, position_noise=1e-5, velocity_noise=1e-2, seed=7
)


def test_orders_of_convergence() -> None:
    """Assert first order of the sampled loop, and second of estimates under a constant input."""
    times = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    errors = []
    for sample_time in times:
        exact = simulate(LOOP, 4.0, sample_time, 1e-9)
        sampled = simulate_sampled(LOOP, 4.0, Sampling(sample_time))
        errors.append(np.max(np.abs(sampled.states - exact.states)))
    assert 0.9 < np.polyfit(np.log(times), np.log(errors), 1)[0] < 1.1
    loop = replace(
        LOOP,
        controller=pd_gravity(proportional=0.0, derivative=0.0),
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


def test_sensors_and_limits_are_as_asked() -> None:
    """Assert limited inputs, whole steps of encoders, and noise by deviation and seed."""
    run = simulate_sampled(LOOP, 2.0, REAL)
    assert np.max(np.abs(run.inputs)) == 100.0
    assert run.statistics["limited_samples"] == np.count_nonzero(np.abs(run.inputs) == 100.0) > 0
    run = simulate_sampled(LOOP, 2.0, Sampling(position_resolution=1e-3))
    assert run.measured is not None
    positions = run.measured[:, ::2]
    assert np.max(np.abs(positions / 1e-3 - np.round(positions / 1e-3))) < 1e-9
    assert np.max(np.abs(positions - run.states[:, ::2])) < 0.5e-3 * (1 + 1e-9)
    assert np.array_equal(run.measured[:, 1::2], run.states[:, 1::2])
    noisy = Sampling(position_noise=1e-4, velocity_noise=2e-2, seed=1)
    run, again = simulate_sampled(LOOP, 10.0, noisy), simulate_sampled(LOOP, 10.0, noisy)
    other = simulate_sampled(LOOP, 10.0, replace(noisy, seed=2))
    assert run.measured is not None
    noise = run.measured - run.states
    assert np.std(noise, axis=0) == pytest.approx([1e-4, 2e-2, 1e-4, 2e-2], rel=0.05)
    assert np.array_equal(run.states, again.states)
    assert not np.array_equal(run.states, other.states)


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


MANY = 35  # more runs than are integrated together, and no multiple of that


def varied(loop: ClosedLoop, count: int) -> list[ClosedLoop]:
    """Return loops with different plants and starts."""
    return [
        replace(
            loop,
            coefficients={p: v * (1.0 + 0.05 * place) for p, v in loop.coefficients.items()},
            initial_state=(0.02 * place, 0.0, 0.0, 0.0),
        )
        for place in range(count)
    ]


def columns(ensemble: Any) -> dict[str, np.ndarray]:
    """Return the arrays of an ensemble by name."""
    return {f.name: getattr(ensemble, f.name) for f in fields(ensemble) if f.name != "system"}


def assert_measured_alike(
    ensemble: Any, place: int, run: Run, sums: float, conditions: float, times: float
) -> None:
    """Assert that a run's measures in an ensemble agree with its samples', within tolerances."""
    measures = measure(run)
    for found, own in (
        (ensemble.final_states, measures.final_states),
        (ensemble.final_errors, measures.final_errors),
        (ensemble.peak_input, measures.peak_inputs),
    ):
        assert found[place] == pytest.approx([*own.values()], rel=sums, abs=1e-6)
    assert ensemble.tracking_rms[place] == pytest.approx(measures.tracking_rms, rel=sums)
    assert ensemble.tracking_peak[place] == pytest.approx(measures.tracking_peak, rel=sums)
    numbers = [one.condition_number for one in measures.excitation.values()]
    assert ensemble.excitation[place] == pytest.approx(numbers, rel=conditions)
    settled = np.array([*measures.settling_times.values()])
    assert np.isfinite(settled).any()
    np.testing.assert_allclose(ensemble.settling_time[place], settled, atol=times)


@pytest.mark.parametrize("sampled", [False, True])
def test_ends_are_those_of_single_runs(sampled: bool) -> None:
    """Assert that the end of every run, sampled or not, has the bits of the single run."""
    loops = varied(LOOP, 3)
    if sampled:
        samplings = [REAL, replace(REAL, seed=8, sample_time=2e-3), Sampling()]
        ensemble = simulate_sampled_ensemble(loops, 3.0, samplings)
        runs = [simulate_sampled(*own) for own in zip(loops, [3.0] * 3, samplings, strict=True)]
    else:
        ensemble = simulate_ensemble(loops, 4.0)
        runs = [simulate(loop, 4.0, 4.0) for loop in loops]
    for place, run in enumerate(runs):
        assert np.array_equal(ensemble.final_states[place], run.states[-1])
        assert np.array_equal(ensemble.final_errors[place], run.parameter_errors[-1])
        steps = len(run.time) if sampled else run.statistics["accepted_steps"]
        assert ensemble.steps[place] == steps
        assert ensemble.reached[place] == run.time[-1]


@pytest.mark.parametrize(("stiff", "count"), [(True, 3), (False, MANY)])
def test_company_changes_nothing(stiff: bool, count: int) -> None:
    """Assert that other runs in an ensemble, even failing ones, do not change a run."""
    loops = varied(LOOP, count)
    settings = {"stiff": stiff, "maximum_steps": 10_000}
    together = simulate_ensemble([loops[0], diverging(), *loops[1:]], 2.0, **settings)
    assert together.status[1] != STATUS.index("finished")
    alone = [simulate_ensemble([loop], 2.0, **settings) for loop in loops]
    for name, values in columns(together).items():
        single = np.concatenate([columns(one)[name] for one in alone])
        np.testing.assert_array_equal(np.delete(values, 1, axis=0), single, err_msg=name)


def diverging() -> ClosedLoop:
    """Return a loop with an unstable control law."""
    law = pd_gravity(proportional=-5000.0, derivative=-500.0)
    return replace(LOOP, controller=law)


@pytest.mark.parametrize("stiff", [True, False])
def test_measures_are_those_of_a_fine_run(stiff: bool) -> None:
    """Assert that every measure agrees with the same measure of a finely sampled single run."""
    loops = varied(LOOP, 2)
    ensemble = simulate_ensemble(loops, 6.0, relative_tolerance=1e-9, stiff=stiff)
    for place, loop in enumerate(loops):
        run = simulate(loop, 6.0, 1e-4, 1e-9)
        assert_measured_alike(ensemble, place, run, sums=1e-4, conditions=1e-3, times=0.02)


def test_sampled_measures_are_those_of_the_samples() -> None:
    """Assert that the measures of a sampled run are computed from its samples."""
    ensemble = simulate_sampled_ensemble([LOOP], 20.0, [REAL])
    run = simulate_sampled(LOOP, 20.0, REAL)
    assert_measured_alike(ensemble, 0, run, sums=1e-12, conditions=1e-9, times=1e-12)


def test_settling_time_is_the_last_time_beyond() -> None:
    """Assert settling times of errors that leave the band again, never enter or never leave it."""
    time = np.array([0.0, 1.0, 2.0, 3.0])
    errors = np.array([[1.0, -9.0, 0.4], [0.1, -9.0, 0.4], [-0.6, -9.0, -0.4], [0.5, -9.0, 0.4]])
    found = settling_times(time, errors, np.array([-10.0, 10.0, 10.0]))
    np.testing.assert_array_equal(found, [2.0, np.nan, 0.0])


def test_a_fast_transient_is_weighted_by_its_time() -> None:
    """Assert that a spike shorter than any sample is weighted by its duration.

    The robust law starts with an input of 2e9 for some microseconds. A mean over steps, which are
    dense there, would give the tracking error of the first instant to the whole run.
    """
    loop = TABLE_1
    ensemble = simulate_ensemble([loop], 5.0)
    fine, coarse = (measure(simulate(loop, 5.0, step)) for step in (1e-4, 1e-3))
    assert ensemble.tracking_rms[0] == pytest.approx(fine.tracking_rms, rel=1e-3)
    assert ensemble.peak_input[0, 0] == pytest.approx(fine.peak_inputs["u"], rel=1e-6)
    # Samples of 1 ms count microseconds as one, as documented in `measure`.
    assert coarse.excitation["motor"].condition_number > 2.0 * ensemble.excitation[0, 1]


@pytest.mark.parametrize("stiff", [True, False])
@pytest.mark.parametrize(
    ("position", "status", "steps"),
    [
        (1e13, "diverged", 1),  # at which an angle has no significant digits
        (0.0, "too many steps", 50),
        (np.nan, "not finite", 0),
        (np.inf, "not finite", 0),
    ],
)
def test_what_cannot_go_on_is_a_status(position: float, status: str, steps: int, stiff: bool):
    """Assert the status of runs that diverge, need too many steps, or are not finite."""
    loop = replace(LOOP, initial_state=(0.0, 0.0, position, 0.0), initial_estimates={})
    most = 50 if status == "too many steps" else 10_000
    ensemble = simulate_ensemble([loop], 30.0, maximum_steps=most, stiff=stiff)
    assert STATUS[ensemble.status[0]] == status
    assert ensemble.steps[0] <= steps
    assert np.isnan(ensemble.excitation).all() == (status == "not finite")


def test_sampled_loops_that_diverge() -> None:
    """Assert an error of the paper's law at 1 kHz, and a status of each loop of an ensemble."""
    with pytest.raises(SimulationError, match="diverges: lower its gains or its sample time"):
        simulate_sampled(TABLE_1, 30.0)
    stiff = replace(LOOP, coefficients={**LOOP.coefficients, "alpha2": 1e7})
    ensemble = simulate_sampled_ensemble([LOOP, diverging(), stiff], 5.0, [Sampling()] * 3)
    assert [STATUS[status] for status in ensemble.status] == [
        "finished",
        "diverged",
        "step too small",
    ]
    assert np.isnan(ensemble.final_states[2]).all()
    assert np.isnan(ensemble.tracking_rms[2])
