"""Innovations of a linear joint under disturbances, against a textbook Kalman filter."""

import sys
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from made_motion import fall
from noisy_joint import holding
from scipy.linalg import LinAlgError, expm, solve_discrete_are

from flexid.estimators.channel_timing import Timing
from flexid.estimators.innovations import Innovations, _costs, _Likelihood, fit_innovations
from flexid.estimators.prediction_error import described
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import (
    RESTING,
    Observer,
    Point,
    SegmentedMotion,
    segmented_motion,
)
from flexid.estimators.steady_gains import (
    Sizes,
    cost_by_spectra,
    steady_covariance,
    steady_gains,
    transition_of,
)
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import flexible_joint

TRUTH = {"theta2": 100.0, "alpha1": 300.0, "alpha2": 2.0, "beta1": 3.0}
VALUES = np.array(list(TRUTH.values()))
SAMPLE_TIME = 0.02  # s, 16 samples per period of the resonance
NOISE = np.array([2e-4, 2e-4])  # rad
DISTURBANCES = np.array([0.5, 1.0])  # rad/s²
RATES = np.array([8.0, 12.0])  # 1/s
CORRELATIONS = np.array([-0.8])  # of the disturbances: most of them is an error of the spring


@dataclass(frozen=True, eq=False)
class Sampled:
    """Sampled system z(k+1) = step z(k) + push u(k) + white noise; y = sees z + white noise."""

    step: np.ndarray
    push: np.ndarray
    noise: np.ndarray
    sees: np.ndarray
    sensors: np.ndarray


def jacobian(values: np.ndarray = VALUES) -> np.ndarray:
    """Return the derivatives of the rates of x1 to x4 by x1 to x4."""
    theta2, alpha1, alpha2, _ = values
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-theta2, 0.0, theta2, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [alpha1, 0.0, -alpha1, -alpha2],
        ]
    )


def sampled(values: np.ndarray = VALUES) -> Sampled:
    """Return the sampled joint with disturbances; torque and disturbances are held."""
    whole = np.zeros((7, 7))
    whole[:4, :4] = jacobian(values)
    whole[1, 4] = whole[3, 5] = 1.0
    whole[3, 6] = values[3]
    moved = np.asarray(expm(SAMPLE_TIME * whole))
    decay = np.exp(-RATES * SAMPLE_TIME)
    step = moved[:6, :6]
    step[4:, 4:] = np.diag(decay)
    noise = np.zeros((6, 6))
    shocks = DISTURBANCES * np.sqrt(1.0 - decay**2)
    noise[4:, 4:] = np.diag(shocks**2)
    noise[4, 5] = noise[5, 4] = CORRELATIONS[0] * shocks.prod()
    sees = np.zeros((2, 6))
    sees[0, 0] = sees[1, 2] = 1.0
    return Sampled(step, moved[:6, 6], noise, sees, np.diag(NOISE**2))


def riccati(system: Sampled) -> np.ndarray:
    """Return the steady covariance of the predicted state, by SciPy."""
    found = solve_discrete_are(system.step.T, system.sees.T, system.noise, system.sensors)
    return np.asarray(found)


def kalman_gain(values: np.ndarray = VALUES) -> np.ndarray:
    """Return the steady gain, shape (6, 2), of positions, velocities and disturbances."""
    system = sampled(values)
    covariance = riccati(system)
    spread = system.sees @ covariance @ system.sees.T + system.sensors
    return covariance @ system.sees.T @ np.linalg.inv(spread)


def innovations(samples: Samples, values: np.ndarray = VALUES) -> np.ndarray:
    """Return the innovations of a steady Kalman filter that starts at rest, shape (n, 2)."""
    system, gain = sampled(values), kalman_gain(values)
    state, found = np.zeros(6), []
    for position, torque in zip(samples.positions, samples.inputs[:, 0], strict=True):
        error = position - system.sees @ state
        found.append(error)
        state = system.step @ (state + gain @ error) + system.push * torque
    return np.array(found)


def disturbed_samples(seed: int, n: int = 600) -> Samples:
    """Return a log from rest under a random torque."""
    rng = np.random.default_rng(seed)
    system = sampled()
    torque = np.repeat(rng.normal(0.0, 6.0, n // 5 + 1), 5)[:n]
    shocks = np.zeros((n, 6))
    shocks[:, 4:] = rng.standard_normal((n, 2)) @ np.linalg.cholesky(system.noise[4:, 4:]).T
    state = np.concatenate((np.zeros(4), DISTURBANCES * rng.standard_normal(2)))
    positions = np.empty((n, 2))
    for k in range(n):
        positions[k] = system.sees @ state
        state = system.step @ state + system.push * torque[k] + shocks[k]
    positions += NOISE * rng.standard_normal((n, 2))
    return Samples(positions, None, torque[:, None], SAMPLE_TIME)


SIZES = Sizes(NOISE, DISTURBANCES, RATES, CORRELATIONS)
SLOWEST = 3.0  # 1/s


def motion(samples: Samples) -> SegmentedMotion:
    """Return a log as one segment, with steps whose error is far below the noise."""
    segments = divide([samples], len(samples) * SAMPLE_TIME)
    joint = flexible_joint()
    unknowns = Unknowns(joint, fixed={"theta1": 0.0})
    problem = segmented_motion(joint, segments, Timing("zero"), unknowns)
    assert problem.names == tuple(TRUTH)
    return problem.at(Point(VALUES, np.zeros((1, 4))), 1.0 / NOISE)


def observed(samples: Samples) -> SegmentedMotion:
    """Return the segment with an observer whose gains are for the true values."""
    problem = motion(samples)
    gains = steady_gains(problem, transition_of(jacobian(), SAMPLE_TIME), SAMPLE_TIME, SIZES)
    own, disturbed, decay, whitening = (each[None] for each in gains[:4])
    always = np.array([len(samples)])
    observer = Observer(own, disturbed, decay, still(samples), whitening, always)
    return replace(problem, observer=observer)


def still(samples: Samples) -> np.ndarray:
    """Return directions of motion of zero, for joints without dry friction."""
    return np.zeros((len(samples), 2))


AT_REST = Point(VALUES, np.zeros((1, 4)))


def test_a_filter_of_a_motion_that_diverges_does_not_settle():
    """Assert that an overflow is an error of its own, without a warning."""
    seen = np.eye(1, 2)
    with pytest.raises(LinAlgError, match="settle"):
        steady_covariance(1e200 * np.eye(2), np.eye(2), seen, np.eye(1))


def test_steady_covariance_is_that_of_the_riccati_equation():
    """Assert that the doubling algorithm converges to SciPy's solution for the linear motion."""
    assert motion(disturbed_samples(1)).linearised(AT_REST, 0) == pytest.approx(
        jacobian(), rel=1e-12
    )
    system = sampled()
    found = steady_covariance(system.step, system.noise, system.sees, system.sensors)
    exact = riccati(system)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert np.abs((found - exact) / scale).max() < 1e-8


def apart(problem: SegmentedMotion, samples: Samples) -> float:
    """Return the largest difference from the exact filter, over the size of innovations."""
    found = problem.equations(AT_REST, "nothing").residuals
    expected = innovations(samples)
    size = float(np.sqrt(np.mean(expected**2)))
    assert size > 1.5 * NOISE.max()  # disturbances matter
    return float(np.abs(found - expected).max()) / size


def test_kernel_is_a_kalman_filter():
    """Assert that the kernel equals the exact filter, with its own gains or Kalman's."""
    samples = disturbed_samples(2)
    problem = observed(samples)
    assert problem.observer is not None
    gain = kalman_gain()[None]
    observer = replace(problem.observer, gain=gain[:, :4], disturbance_gain=gain[:, 4:])
    assert apart(replace(problem, observer=observer), samples) < 1e-3
    assert problem.observer.gain[0] == pytest.approx(gain[0, :4], rel=1e-6)
    assert apart(problem, samples) < 1e-3


def resting(samples: Samples) -> np.ndarray:
    """Return directions with the motor at rest twice."""
    found = still(samples)
    found[200:260, 1] = found[400:401, 1] = RESTING
    return found


def both_resting(samples: Samples) -> np.ndarray:
    """Return directions with the motor at rest twice, and the link once."""
    found = resting(samples)
    found[300:340, 0] = RESTING
    return found


@pytest.mark.parametrize("directions", [still, resting, both_resting])
@pytest.mark.parametrize(
    "delays", [(), ("input_delay", "link_delay")], ids=["without_link_delays", "late"]
)
def test_derivatives_are_those_of_differences(delays, directions):
    """Assert that the right-hand side is minus half the slope of the cost, for delays too."""
    samples = disturbed_samples(4)
    problem = observed(samples)
    assert problem.observer is not None
    problem = replace(problem, observer=replace(problem.observer, directions=directions(samples)))
    timing = Timing("linear" if delays else "zero", sought=delays)
    problem = replace(problem, timing=timing)
    point = Point(np.append(VALUES, np.full(len(delays), 3e-3)), np.zeros((1, 4)))
    equations = problem.equations(point)
    gradient = equations.gradient.sum(axis=0)
    for place, size in enumerate(np.sqrt(np.diag(equations.normal.sum(axis=0)))):
        # Differences are exact to 1e-5 of the change by one standard deviation, which is one.
        apart = gradient[place] - fall(problem, point, place, 1e-3 / size)
        assert abs(apart) < 1e-3 * size, place


def test_a_row_that_rests_teaches_nothing_and_follows_its_sensor():
    """Assert that the torque of a resting motor has no effect, and the link is still predicted."""
    samples = disturbed_samples(4)
    problem = observed(samples)
    assert problem.observer is not None
    problem = replace(problem, observer=replace(problem.observer, directions=resting(samples)))
    segments = problem.segments
    pushed = segments.inputs.copy()
    pushed[200:260] += 100.0
    other = replace(problem, segments=replace(segments, inputs=pushed))
    found, same = (each.equations(AT_REST, "nothing").residuals for each in (problem, other))
    np.testing.assert_allclose(found, same, rtol=0.0, atol=1e-5 * NOISE.min())
    assert not found[201:261, 1].any()
    assert found[200, 1] != 0.0 != found[261, 1]
    # The link is predicted from the motor's measured motion, as well as without rest.
    free = observed(samples).equations(AT_REST, "nothing").residuals
    assert found[201:261, 0].std() < 1.2 * free[:, 0].std()
    assert problem.degrees_of_freedom == observed(samples).degrees_of_freedom - 61


@pytest.mark.parametrize(
    "other",
    [
        Sizes(0.5 * NOISE, DISTURBANCES, RATES, CORRELATIONS),
        Sizes(NOISE, np.array([2.0, 0.3]) * DISTURBANCES, RATES, CORRELATIONS),
        Sizes(NOISE, DISTURBANCES, np.array([0.4, 3.0]) * RATES, CORRELATIONS),
        Sizes(NOISE, DISTURBANCES, RATES, 0.0 * CORRELATIONS),
    ],
    ids=["sensors", "disturbances", "rates", "correlations"],
)
def test_spectra_tell_what_other_sizes_cost(other: Sizes):
    """Assert that spectra of innovations predict the likelihood of other sizes within 5 %."""
    samples = disturbed_samples(7, 3000)
    made = _Likelihood.of(motion(samples), AT_REST, still(samples))
    first = made.with_sizes(SIZES)
    assert first.motion is not None
    cost = cost_by_spectra(first.motion, SIZES, first.residuals, made.transitions)
    assert cost(SIZES) == pytest.approx(first.cost, rel=1e-9)
    expected = made.with_sizes(other).cost - first.cost
    assert expected > 50.0
    assert cost(other) - cost(SIZES) == pytest.approx(expected, rel=0.05)


def test_costs_of_many_sizes_are_those_of_each():
    """Assert equal costs together and one by one, and the worst cost for sizes that fail alone."""
    samples = disturbed_samples(7, 3000)
    made = _Likelihood.of(motion(samples), AT_REST, still(samples))
    first = made.with_sizes(SIZES)
    assert first.motion is not None
    cost = cost_by_spectra(first.motion, SIZES, first.residuals, made.transitions)
    points = SIZES.numbers + 0.1 * np.random.default_rng(8).standard_normal((5, 7))
    each = [float(cost(Sizes.of(point, 2))) for point in points]
    assert _costs(cost, 2, points).tolist() == each
    points[3, 0] = -800.0  # a sensor without noise
    each[3] = 1e15
    assert _costs(cost, 2, points).tolist() == each


def test_sizes_are_unbounded_numbers():
    """Assert that the numbers give the sizes again, and pairs of rows their covariance."""
    size = np.array([1.0, 2.0, 3.0, 4.0])
    sizes = Sizes(size, 2.0 * size, 3.0 * size, np.array([-0.5, -0.9]))
    again = Sizes.of(sizes.numbers, 4)
    for name in ("sensors", "disturbances", "rates", "correlations"):
        assert getattr(again, name) == pytest.approx(getattr(sizes, name))
    covariance = sizes.covariance(np.full(4, 0.5))
    assert np.diag(covariance) == pytest.approx(size**2)
    assert covariance[0, 1] == covariance[1, 0] == pytest.approx(-0.5 * 1.0 * 2.0)
    assert covariance[2, 3] == covariance[3, 2] == pytest.approx(-0.9 * 3.0 * 4.0)
    assert np.count_nonzero(covariance) == 8


@pytest.mark.parametrize("correlation", [0.0, -0.8])
def test_disturbances_get_a_correlation_that_is_clearly_likelier(monkeypatch, correlation):
    """Assert none for independent disturbances, and about that of an error of the spring."""
    monkeypatch.setattr(sys.modules[__name__], "CORRELATIONS", np.array([correlation]))
    samples = disturbed_samples(7, 3000)
    likelihood = _Likelihood.of(motion(samples), AT_REST, still(samples))
    first = Sizes(NOISE, DISTURBANCES, RATES, np.zeros(1))
    far = Sizes(3.0 * NOISE, 3.0 * DISTURBANCES, 3.0 * RATES, np.zeros(1)).numbers
    least = np.append(2.0 * first.numbers[:6] - far[:6], np.arctanh(-0.999))
    found = likelihood.maximise(first, (least, far)).correlations
    assert found == (0.0 if correlation == 0.0 else pytest.approx(correlation, abs=0.15))


@cache
def fitted(seed: int, *, known: bool) -> Innovations:
    """Return a fit from values 10 % off, with known or unknown initial sizes."""
    samples = disturbed_samples(seed, 600 if known else 3000)
    problem = motion(samples)
    point = Point(VALUES * np.array([0.9, 1.1, 0.9, 1.1]), problem.start_states)
    sizes = SIZES if known else None
    return fit_innovations(problem, point, still(samples), SLOWEST, sizes)


def held(found: Innovations) -> np.ndarray:
    """Return whether each 95 % interval contains the true value."""
    return holding(described(found.problem, found.minimum), VALUES)


def test_sizes_and_coefficients_are_recovered():
    """Assert unknown sizes within a factor of 1.5, and coefficients with small intervals."""
    found = fitted(6, known=False)
    assert np.abs(np.log(found.sizes.disturbances / DISTURBANCES)).max() < np.log(1.5)
    assert np.abs(np.log(found.sizes.sensors / NOISE)).max() < np.log(1.5)
    assert found.sizes.correlations == pytest.approx(CORRELATIONS, abs=0.15)
    assert held(found).all()
    fit = described(found.problem, found.minimum)
    assert np.all(fit.standard_deviations[[0, 1, 3]] < 0.05 * VALUES[[0, 1, 3]])


def test_coverage():
    """Assert that nominal 95 % intervals contain the truth in 88 to 100 % of 160 cases.

    Forty seeds, four coefficients: were the cases independent, the standard error would be 1.7 %.
    """
    share = np.mean([held(fitted(100 + seed, known=True)) for seed in range(40)])
    assert 0.88 <= share <= 1.0
