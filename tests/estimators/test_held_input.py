"""Straight lines in the place of inputs that are held, run straight or smoothly, and act late."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from flexid.estimators.channel_timing import held_input
from flexid.recording.recording import Hold

H = 0.004  # s
N = 40
SAMPLES = np.random.default_rng(5).standard_normal(N)
DELAYS = [0.0, 0.0013, 0.0039, -0.0007, -0.0092, 0.0173]

Function = Callable[[np.ndarray], np.ndarray]


def reconstruction(hold: Hold, samples: np.ndarray, h: float) -> Function:
    """The input between and beyond its samples, by other means than a kernel."""
    n, spare = len(samples), 30
    padded = np.pad(samples, spare, mode="edge")
    time = h * np.arange(-spare, n + spare)
    if hold == "zero":
        return lambda t: samples[np.clip(np.floor(t / h + 1e-12).astype(int), 0, n - 1)]
    if hold == "linear":
        return lambda t: np.interp(t, time, padded)
    return CubicSpline(time, padded, bc_type="clamped")


def mean_and_moment(function: Function, first: float, h: float, late: float) -> tuple:
    """Mean and first moment over [first, first + h] of a function that acts late, by quadrature."""
    corner = first + late % h
    nodes, weights = np.polynomial.legendre.leggauss(6)
    mean = moment = 0.0
    for a, b in ((first, corner), (corner, first + h)):
        t = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        share = 0.5 * (b - a) / h * weights * function(t - late)
        mean += share.sum()
        moment += (share * (t - first) / h).sum()
    return mean, moment


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("hold", ["zero", "linear", "cubic"])
def test_lines_have_the_mean_and_the_moment_of_the_input(hold, delay):
    """Assert that each line has the mean and first moment of the late input, to its ends.

    They change with the delay as finite differences say.
    """
    found, high, low = (
        held_input(SAMPLES[:, None], H, hold, delay + step)[:, 0] for step in (0.0, 1e-7, -1e-7)
    )
    function = reconstruction(hold, SAMPLES, H)
    expected = [mean_and_moment(function, H * k, H, delay) for k in range(N)]
    start, change = found[:, 0], found[:, 1]
    lines = np.column_stack((start + change / 2.0, start / 2.0 + change / 3.0))
    assert lines == pytest.approx(np.array(expected), abs=1e-5)
    if delay:
        slopes = (high - low)[:, :2] / 2e-7
        assert found[:, 2:] == pytest.approx(slopes, abs=1e-5 * np.abs(slopes).max())


@pytest.mark.parametrize("delay", [1e300, -1e300, np.inf, 1e9])
def test_any_delay_is_one(delay: float):
    """Assert that a delay beyond all samples leaves the first or the last one.

    A spline through a corner fades by a factor of four from sample to sample.
    """
    line = held_input(SAMPLES[:, None], H, "cubic", delay)
    last = SAMPLES[-1] if delay < 0.0 else SAMPLES[0]
    np.testing.assert_allclose(line[:, 0, 0], last, rtol=1e-3)
    np.testing.assert_allclose(line[:, 0, 1], 0.0, atol=1e-3)
    np.testing.assert_allclose(line[:, 0, 2:], 0.0, atol=1e-3 / H)
