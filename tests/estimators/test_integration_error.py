"""Steps of the integration are as many as the noise of the data asks for.

An undamped oscillator has a closed form, and so has what Runge and Kutta's fourth order makes of
it: a step of the phase φ turns by φ (1 - φ⁴/120), so that a fit finds the square of the frequency
too large by φ⁴/60 of it.
"""

import numpy as np
import pytest

from flexid.estimators.channel_timing import Timing
from flexid.estimators.gauss_newton import MOST, NEGLIGIBLE, minimise, refinement
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, segmented_motion
from flexid.estimators.segments import divide
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.parametric_system import ParametricSystem, Row

OSCILLATOR = ParametricSystem("oscillator", (Row("mass", "q", "v", {"stiffness": "-q"}),))
FREQUENCY = 9.0  # rad/s
H = 0.01  # s: 0.09 rad in a sample, which one step is thought to be short enough for
N = 2001
BIAS = FREQUENCY**2 * (FREQUENCY * H) ** 4 / 60.0
"""Of the stiffness in 1/s², with one step for each sample."""


def deviation(noise: float) -> float:
    """Standard deviation of the stiffness by the Cramér-Rao bound, for an amplitude of 1 rad."""
    t = H * np.arange(N)
    slope = -0.5 * t / FREQUENCY * np.sin(FREQUENCY * t)
    states = np.column_stack((np.cos(FREQUENCY * t), np.sin(FREQUENCY * t)))
    left = slope - states @ np.linalg.lstsq(states, slope, rcond=None)[0]
    return noise / float(np.linalg.norm(left))


def noise_for(moved: float) -> float:
    """Noise in rad with which the integration moves the stiffness by so many deviations."""
    return BIAS / (moved * deviation(1.0))


def oscillation(noise: float, seed: int) -> Samples:
    """A free oscillation from rest."""
    t = H * np.arange(N)
    position = np.cos(FREQUENCY * t) + noise * np.random.default_rng(seed).standard_normal(N)
    return Samples(position[:, None], None, np.empty((N, 0)), H)


@pytest.mark.parametrize(
    ("moved", "times"), [(0.5, 1), (1.5, 2), (10.0, 2), (25.0, 3), (150.0, MOST), (1e5, MOST)]
)
def test_steps_are_as_many_as_the_noise_asks_for(moved: float, times: int):
    """Assert what follows from the closed form: (error / negligible error)^(1/4), rounded up."""
    moved *= NEGLIGIBLE
    noise = noise_for(moved)
    segments = divide([oscillation(noise, 3)], N * H)
    point = Point(np.array([FREQUENCY**2]), np.array([[1.0, 0.0]]))
    problem = segmented_motion(OSCILLATOR, segments, Timing("linear"))
    problem = problem.at(point, np.array([1.0 / noise]))
    assert problem.substeps == 1
    assert refinement(problem, minimise(problem, point, 1e-2)) == times


def test_estimates_are_off_by_noise_alone():
    """Assert that over thirty records the error is noise's, though one step would move it by 3."""
    noise = noise_for(3.0)
    off = []
    for seed in range(30):
        samples = [oscillation(noise, seed)]
        start = filtered_least_squares(samples, OSCILLATOR)
        found = prediction_error(samples, OSCILLATOR, start, N * H)
        off.append((found.values[0] - FREQUENCY**2) / deviation(noise))
    assert abs(np.mean(off)) < 0.7  # 0.18 by chance, and at most the tenth that is left
    assert 0.6 < np.std(off) < 1.4
