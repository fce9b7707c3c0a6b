"""Ensembles compared with single runs, and their measures with finely sampled ones."""

from dataclasses import fields, replace

import numpy as np
import pytest

from flexid.experiments.measures import measure, settling_times
from flexid.paper.laws import pd_gravity
from flexid.simulation.closed_loop import ClosedLoop, Run, simulate
from flexid.simulation.ensemble import (
    STATUS,
    Ensemble,
    simulate_ensemble,
    simulate_sampled_ensemble,
)
from flexid.simulation.sampled import Sampling, simulate_sampled
from flexid.studies.runs import table1_loop

TABLE_1 = table1_loop((1, 2, 3))
LOOP = replace(TABLE_1, controller=pd_gravity())
MANY = 35  # more runs than are integrated together, and no multiple of that
NOISY = Sampling(
    input_limit=100.0, position_resolution=1e-4, position_noise=1e-5, velocity_noise=1e-2, seed=7
)


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


def columns(ensemble: Ensemble) -> dict[str, np.ndarray]:
    """Return the arrays of an ensemble by name."""
    return {f.name: getattr(ensemble, f.name) for f in fields(ensemble) if f.name != "system"}


def assert_measured_alike(
    ensemble: Ensemble, place: int, run: Run, sums: float, conditions: float, times: float
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
        samplings = [NOISY, replace(NOISY, seed=8, sample_time=2e-3), Sampling()]
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
    ensemble = simulate_sampled_ensemble([LOOP], 20.0, [NOISY])
    run = simulate_sampled(LOOP, 20.0, NOISY)
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
def test_what_cannot_go_on_is_a_status(
    position: float, status: str, steps: int, stiff: bool
) -> None:
    """Assert the status of runs that diverge, need too many steps, or are not finite."""
    loop = replace(LOOP, initial_state=(0.0, 0.0, position, 0.0), initial_estimates={})
    most = 50 if status == "too many steps" else 10_000
    ensemble = simulate_ensemble([loop], 30.0, maximum_steps=most, stiff=stiff)
    assert STATUS[ensemble.status[0]] == status
    assert ensemble.steps[0] <= steps
    assert np.isnan(ensemble.excitation).all() == (status == "not finite")


def test_sampled_divergence_is_a_status() -> None:
    """Assert the status of sampled loops that diverge, or that are too stiff."""
    stiff = replace(LOOP, coefficients={**LOOP.coefficients, "alpha2": 1e7})
    ensemble = simulate_sampled_ensemble([LOOP, diverging(), stiff], 5.0, [Sampling()] * 3)
    assert [STATUS[status] for status in ensemble.status] == [
        "finished",
        "diverged",
        "step too small",
    ]
    assert np.isnan(ensemble.final_states[2]).all()
    assert np.isnan(ensemble.tracking_rms[2])
