"""Segmented prediction error on known systems, and refinement of integration steps."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_joint import (
    POSITION_NOISE,
    VALUES,
    clean_motion,
    encoders,
    holding,
    joint_samples,
    worst_error,
)
from scipy.signal import lfilter

import flexid.estimators.samples as sharing
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.prediction_error import (
    MOST,
    NEGLIGIBLE,
    PredictionErrorFit,
    Steps,
    minimise,
    prediction_error,
    refinement,
)
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import By, Point, segmented_motion
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.recording.recording import Hold

JOINT = flexible_joint()


def fit(samples: Samples, duration: float = 1.0, hold: Hold = "linear") -> PredictionErrorFit:
    """Return a fit that starts from least squares of the same samples."""
    start = filtered_least_squares([samples], JOINT, hold=hold)
    return prediction_error([samples], JOINT, start, duration, hold)


def correlated(seed: int, rho: float = 0.9) -> Samples:
    """Return positions with autoregressive noise of the usual standard deviation."""
    clean = encoders(None, 15_000)
    shocks = np.random.default_rng(seed).standard_normal((2000 + len(clean), 2))
    noise = np.asarray(lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], shocks, axis=0))[2000:]
    return replace(clean, positions=clean.positions + POSITION_NOISE * noise)


def test_less_is_part_of_everything():
    """Assert that reduced equations equal the corresponding part of the full equations."""
    segments = divide([joint_samples()], 1.0)
    late = {"input_delay": 3e-4, "link_delay": 2e-4}
    problem = segmented_motion(JOINT, segments, Timing("linear", late, (*late,)))
    point = Point(np.append(VALUES, [*late.values()]), clean_motion()[1][segments.starts])
    full = problem.equations(point)
    assert full.normal.shape[1] == 4 + len(VALUES) + 2
    sizes: dict[By, int] = {"states": 4, "nothing": 0}
    for by, n in sizes.items():
        part = problem.equations(point, by)
        assert part.cost == pytest.approx(full.cost, rel=1e-9)
        assert part.residuals == pytest.approx(full.residuals, rel=1e-9, abs=1e-12)
        assert part.normal == pytest.approx(full.normal[:, :n, :n], rel=1e-9)
        scale = np.abs(full.gradient).max()
        assert part.gradient == pytest.approx(full.gradient[:, :n], abs=1e-9 * scale)


def test_accuracy_by_duration():
    """Assert a median worst error below 0.003 % for 1 s and 0.001 % for 5 s, and the noise."""
    for duration, error in ((1.0, 0.003), (5.0, 0.001)):
        fits = [fit(joint_samples(seed), duration) for seed in range(10)]
        assert np.median([worst_error(found.values) for found in fits]) <= error
        assert fits[0].noise == pytest.approx([POSITION_NOISE] * 2, rel=0.02)


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_coverage(rho):
    """Assert that nominal 95 % intervals contain the truth in 88 to 99.5 % of 200 cases.

    Forty seeds, five coefficients: were the cases independent, the standard error would be 1.5 %.
    """
    held = [holding(fit(correlated(seed, rho))) for seed in range(40)]
    assert 0.88 <= np.mean(held) <= 0.995


def test_what_leads_nowhere_is_an_error():
    """Assert that a diverging motion, or a minimum far from its start, is an error."""
    start = filtered_least_squares([joint_samples(0)], JOINT)
    for wrong in ([5.0, -1e5, 333.0, -1e4, 3.3], VALUES * np.array([1.0, 0.45, 0.45, 1.0, 0.45])):
        with pytest.raises(ConvergenceError):
            prediction_error([joint_samples(0)], JOINT, replace(start, values=np.array(wrong)))


def test_threads_change_no_digit(monkeypatch: pytest.MonkeyPatch):
    """Assert that one, two and five threads give the same bits."""
    samples = joint_samples(0)
    start = filtered_least_squares([samples], JOINT)
    fits = []
    for count in (1, 2, 5):
        monkeypatch.setattr(sharing, "cores", lambda count=count: count)
        fits.append(prediction_error([samples], JOINT, start))
    for other in fits[1:]:
        np.testing.assert_array_equal(other.values, fits[0].values)
        np.testing.assert_array_equal(other.covariance, fits[0].covariance)
        np.testing.assert_array_equal(other.residuals, fits[0].residuals)


OSCILLATOR = ParametricSystem("oscillator", (Row("mass", "q", "v", {"stiffness": "-q"}),))
FREQUENCY = 9.0  # rad/s
H = 0.01  # s: 0.09 rad per sample, which one step should resolve
N = 2001
BIAS = FREQUENCY**2 * (FREQUENCY * H) ** 4 / 60.0
"""Bias of the stiffness in 1/s², with one step for each sample."""


def deviation(noise: float) -> float:
    """Return the Cramér-Rao bound of the stiffness, for an amplitude of 1 rad."""
    t = H * np.arange(N)
    slope = -0.5 * t / FREQUENCY * np.sin(FREQUENCY * t)
    states = np.column_stack((np.cos(FREQUENCY * t), np.sin(FREQUENCY * t)))
    left = slope - states @ np.linalg.lstsq(states, slope, rcond=None)[0]
    return noise / float(np.linalg.norm(left))


def noise_for(moved: float) -> float:
    """Return the noise in rad for a bias of so many standard deviations."""
    return BIAS / (moved * deviation(1.0))


def oscillation(noise: float, seed: int) -> Samples:
    """Return a free oscillation from rest."""
    t = H * np.arange(N)
    position = np.cos(FREQUENCY * t) + noise * np.random.default_rng(seed).standard_normal(N)
    return Samples(position[:, None], None, np.empty((N, 0)), H)


@pytest.mark.parametrize(
    ("moved", "times"), [(0.5, 1), (1.5, 2), (10.0, 2), (25.0, 3), (150.0, MOST), (1e5, MOST)]
)
def test_steps_are_as_many_as_the_noise_asks_for(moved: float, times: int):
    """Assert the closed form (error / negligible error)^(1/4), rounded up."""
    moved *= NEGLIGIBLE
    noise = noise_for(moved)
    segments = divide([oscillation(noise, 3)], N * H)
    point = Point(np.array([FREQUENCY**2]), np.array([[1.0, 0.0]]))
    problem = segmented_motion(OSCILLATOR, segments, Timing("linear"))
    problem = problem.at(point, np.array([1.0 / noise]))
    assert problem.substeps == 1
    assert refinement(problem, minimise(problem, point, Steps(1e-2))) == times


def test_estimates_are_off_by_noise_alone():
    """Assert that refined steps remove a bias of three standard deviations, over thirty logs."""
    noise = noise_for(3.0)
    off = []
    for seed in range(30):
        samples = [oscillation(noise, seed)]
        start = filtered_least_squares(samples, OSCILLATOR)
        found = prediction_error(samples, OSCILLATOR, start, N * H)
        off.append((found.values[0] - FREQUENCY**2) / deviation(noise))
    assert abs(np.mean(off)) < 0.7  # 0.18 by chance, and at most a remaining tenth
    assert 0.6 < np.std(off) < 1.4
