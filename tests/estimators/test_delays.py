"""Fractional delays of torque and encoder, and the line segments that replace late inputs."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from made_motion import fall
from noisy_joint import SAMPLE_TIME, VALUES, clean_motion, late_motion
from scipy.interpolate import CubicSpline
from scipy.stats import t

from flexid.estimators.channel_timing import INPUT, Timing, after_a_lag, held_input
from flexid.estimators.prediction_error import PredictionErrorFit, Steps, described, minimise
from flexid.estimators.samples import Samples, divide, first_states
from flexid.estimators.segmented_motion import Point, SegmentedMotion, segmented_motion
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.recording import Hold

H = 4 * SAMPLE_TIME  # s, duration of the logs
NOISE = 1e-5  # rad
INPUT_DELAY, LINK_DELAY = 1.3e-3, 2.9e-3  # s: a third, and nearly three quarters of a sample
DURATION = 10.0  # s


def log(seed: int, input_delay: float, link_delay: float, by_deflection: bool = False) -> Samples:
    """Return the joint of Table I with delays of the torque, and of the link or deflection."""
    at = 0.5 + H * np.arange(round(DURATION / H))
    link, motor, torque = late_motion(at, input_delay, link_delay, by_deflection)
    noise = NOISE * np.random.default_rng(seed).standard_normal((len(at), 2))
    positions = np.column_stack((link, motor)) + noise
    return Samples(positions, None, torque[:, None], H, 0.5)


def problem_of(samples: Samples, timing: Timing) -> SegmentedMotion:
    """Return the problem of a log, with segments that leave margins for delays."""
    return segmented_motion(flexible_joint(), divide([samples], 1.0, margin=0.03), timing)


def fit(samples: Samples, timing: Timing, start: Sequence[float] = ()) -> PredictionErrorFit:
    """Fit from values 5 % off and zero delays."""
    problem = problem_of(samples, timing)
    values = np.concatenate((1.05 * VALUES, start or np.zeros(len(timing.sought))))
    point = Point(values, first_states(problem.segments))
    problem = problem.at(point, np.full(2, 1.0 / NOISE))
    found = minimise(problem, point, Steps(1e-3))
    return described(problem, found)


def assert_within(found: PredictionErrorFit, expected: Sequence[float]) -> None:
    """Assert that each delay is within its 99.9 % interval, a small fraction of a sample."""
    k = len(VALUES)
    quantile = t.ppf(0.9995, np.array(found.degrees_of_freedom[k:]))
    errors = found.values[k:] - expected
    assert np.all(np.abs(errors) < quantile * found.standard_deviations[k:])
    assert np.all(found.standard_deviations[k:] < 0.02 * H)


BOTH = Timing("cubic", sought=(INPUT, "link_delay"))


@pytest.mark.parametrize(
    ("input_delay", "link_delay"),
    [(INPUT_DELAY, LINK_DELAY), (-INPUT_DELAY, -LINK_DELAY), (3.4 * H, 2.6 * H), (0.0, 0.0)],
)
def test_both_delays_are_found(input_delay, link_delay):
    """Assert delays of fractions of a sample, several samples of either sign, and zero."""
    found = fit(log(1, input_delay, link_delay), BOTH)
    assert found.names[-2:] == (INPUT, "link_delay")
    assert_within(found, [input_delay, link_delay])
    assert found.values[:5] == pytest.approx(VALUES, rel=2e-3)


def test_delay_of_the_deflection_is_found():
    """Assert that a delay of a measured deflection applies to the deflection alone."""
    timing = Timing("cubic", sought=(INPUT, "link_delay"), relative_to={"link": "motor"})
    samples = log(2, INPUT_DELAY, LINK_DELAY, by_deflection=True)
    assert_within(fit(samples, timing), [INPUT_DELAY, LINK_DELAY])
    wrong = fit(samples, BOTH)
    assert abs(wrong.values[-1] - LINK_DELAY) > 20.0 * wrong.standard_deviations[-1]


@pytest.mark.parametrize("samples", [0.3, 1.0, 7.5])
def test_a_lag_attenuates_like_its_closed_form(samples: float):
    """Assert the amplitude of a sine after a lag."""
    turn = 0.2  # rad per sample
    sine = np.sin(turn * np.arange(4000))
    whole = after_a_lag(sine, samples)
    amplitude = np.sqrt(2.0 * np.mean(whole[1000:] ** 2))
    assert amplitude == pytest.approx(1.0 / np.hypot(1.0, samples * turn), rel=3e-3)


@pytest.mark.parametrize("relative_to", [{}, {"link": "motor"}])
def test_gradient_by_the_delays(relative_to):
    """Assert that the right-hand side is minus half the slope of the sum of squares.

    The rate of the measured position is taken from the model, which has no noise. Both differ by
    the remaining delay times the acceleration, at the resonance by 20 rad/s times 1 ms.
    """
    timing = Timing("cubic", sought=(INPUT, "link_delay", "motor_delay"), relative_to=relative_to)
    problem = problem_of(log(6, 0.0, 0.0), timing)
    values = np.array([*VALUES, 0.3 * H, 0.2 * H, -0.3 * H])
    states = clean_motion()[1][np.round(problem.segments.start_times / SAMPLE_TIME).astype(int)]
    point = Point(values, states)
    gradient = problem.equations(point).gradient.sum(axis=0)[4:]
    for place in range(5, 8):
        slope = fall(problem, point, states.size + place, 1e-6)
        assert gradient[place] == pytest.approx(slope, rel=0.02)


STEP = 0.004  # s
N = 40
SAMPLES = np.random.default_rng(5).standard_normal(N)
DELAYS = [0.0, 0.0013, 0.0039, -0.0007, -0.0092, 0.0173]

Function = Callable[[np.ndarray], np.ndarray]


def reconstruction(hold: Hold, samples: np.ndarray, h: float) -> Function:
    """Return the input between and beyond its samples, without the kernel."""
    n, spare = len(samples), 30
    padded = np.pad(samples, spare, mode="edge")
    time = h * np.arange(-spare, n + spare)
    if hold == "zero":
        return lambda t: samples[np.clip(np.floor(t / h + 1e-12).astype(int), 0, n - 1)]
    if hold == "linear":
        return lambda t: np.interp(t, time, padded)
    return CubicSpline(time, padded, bc_type="clamped")


def mean_and_moment(function: Function, first: float, h: float, late: float) -> tuple:
    """Return mean and first moment over [first, first + h] of a delayed function, by quadrature."""
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
    """Assert mean and moment of the delayed input, and derivatives by the delay."""
    found, high, low = (
        held_input(SAMPLES[:, None], STEP, hold, delay + step)[:, 0] for step in (0.0, 1e-7, -1e-7)
    )
    function = reconstruction(hold, SAMPLES, STEP)
    expected = [mean_and_moment(function, STEP * k, STEP, delay) for k in range(N)]
    start, change = found[:, 0], found[:, 1]
    lines = np.column_stack((start + change / 2.0, start / 2.0 + change / 3.0))
    assert lines == pytest.approx(np.array(expected), abs=1e-5)
    if delay:
        slopes = (high - low)[:, :2] / 2e-7
        assert found[:, 2:] == pytest.approx(slopes, abs=1e-5 * np.abs(slopes).max())


@pytest.mark.parametrize("delay", [1e300, -1e300, np.inf, 1e9])
def test_any_delay_is_one(delay: float):
    """Assert that a delay beyond all samples gives the first or last one, with vanishing slopes."""
    line = held_input(SAMPLES[:, None], STEP, "cubic", delay)
    last = SAMPLES[-1] if delay < 0.0 else SAMPLES[0]
    np.testing.assert_allclose(line[:, 0, 0], last, rtol=1e-3)
    np.testing.assert_allclose(line[:, 0, 1], 0.0, atol=1e-3)
    np.testing.assert_allclose(line[:, 0, 2:], 0.0, atol=1e-3 / STEP)
