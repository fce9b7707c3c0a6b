"""Histories of regressors and errors, and the monitor of Theorem 1 along simulated runs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexid.errors import SettingError
from flexid.simulation import lyapunov
from flexid.simulation.closed_loop import simulate
from flexid.studies.runs import sine, table1_loop

TIME = np.linspace(0.0, 20.0, 4001)
TOLERANCE = 1e-10


def regressors(time):
    """Return two exciting regressors."""
    return np.stack([np.sin(time), np.cos(2 * time)], axis=-1)


@pytest.fixture(scope="module")
def history() -> lyapunov.RowHistory:
    """Return p̃' = -c r rᵀp̃ integrated by SciPy."""

    def rate(t, e):
        r = regressors(t)
        return -0.7 * r * (r @ e)

    run = solve_ivp(rate, (0, 20), [1.0, -2.0], "DOP853", TIME, rtol=TOLERANCE, atol=1e-14)
    return lyapunov.RowHistory("row", ("a", "b"), 0.7, regressors(TIME), run.y.T)


def watch(*rows, window=2.0):
    """Return the monitor at the tolerance of the run."""
    return lyapunov.monitor(TIME, rows, window, TOLERANCE, 1e-14)


def trapezoidal_error(watched: lyapunov.LyapunovMonitor) -> float:
    """Return the imbalance due to the trapezoidal rule alone: h²/12 ∫|V'''| dt / V(0)."""
    step = watched.time[1] - watched.time[0]
    return step / 12.0 * np.abs(np.diff(watched.rate, 2)).sum() / watched.value[0]


def imbalance(watched: lyapunov.LyapunovMonitor) -> float:
    """Return |V(T) - V(0) - ∫V' dt| / V(0) by the trapezoidal rule."""
    change = watched.value[-1] - watched.value[0]
    return float(abs(change - np.trapezoid(watched.rate, watched.time)) / watched.value[0])


def test_small_rises_are_seen(history):
    """Assert that a jump of a millionth, or a slow accumulated rise, is reported."""
    errors = history.errors.copy()
    errors[2001:] = errors[2000] * (1 + 1e-6)
    assert watch(replace(history, errors=errors)).rise_in_tolerances > lyapunov.ALLOWED_RISE
    errors = history.errors[0] * (1 + 1e-9 * np.arange(len(TIME)))[:, None]
    assert watch(replace(history, errors=errors)).rise_in_tolerances > lyapunov.ALLOWED_RISE


@pytest.mark.parametrize(
    ("errors", "window", "settled", "vanished"),
    [
        (None, 2.0, True, True),
        (np.tile([1.0, -2.0], (len(TIME), 1)), 2.0, True, False),
        # Without a limit, which the theorem does not require.
        (np.sin(np.log1p(TIME))[:, None] * [1.0, 1.0] + 1.0, 5.0, False, False),
        (np.cos(4.5 * np.pi / 20.0 * TIME)[:, None] * [1.0, 1.0], 2.0, False, False),
    ],
    ids=["vanishing", "constant", "oscillating", "zero in passing"],
)
def test_limits_of_errors(history, errors, window, settled, vanished):
    """Assert that constant errors count as settled, and zero ones as gone."""
    if errors is None:
        errors = history.errors * np.exp(-TIME)[:, None]
    limits = watch(replace(history, errors=errors), window=window).limits
    assert {(limit.settled, limit.vanished) for limit in limits} == {(settled, vanished)}


def test_dissipation_balances_the_fall_of_the_value(history):
    """Assert that (9) integrates to (8), not with a wrong gain, and along the paper's loop."""
    both, watched = watch(history, history), watch(history)
    np.testing.assert_allclose(both.value, np.sum(history.errors**2, axis=1), rtol=1e-13)
    assert imbalance(watched) < trapezoidal_error(watched) < 1e-4
    assert imbalance(watch(replace(history, gain=0.8))) > 0.1
    loop = table1_loop((1, 2, 3), reference=sine(0.1))
    run = simulate(loop, 5.0, 1e-4, 1e-8)
    assert lyapunov.monitor_run(run, 1.0).rise_in_tolerances <= lyapunov.ALLOWED_RISE
    rows = [
        replace(row, regressors=row.regressors[1:], errors=row.errors[1:])
        for row in lyapunov.row_histories(run)
    ]
    watched = lyapunov.monitor(run.time[1:], rows, 1.0, 1e-8, 1e-8)
    assert imbalance(watched) < trapezoidal_error(watched) < 1e-5


def test_a_sampled_run_is_refused():
    """Assert that a run without a tolerance is refused with a remedy."""
    loop = table1_loop((1, 2, 3), reference=sine(0.1))
    run = simulate(loop, 0.1, 1e-2, 1e-6)
    with pytest.raises(SettingError, match="continuous run"):
        lyapunov.monitor_run(replace(run, settings={"task": "sampled"}), 0.05)
