"""Online estimators: recursive least squares, and the paper's observer."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_joint import POSITION_NOISE, SAMPLE_TIME, TRUTH, VALUES, encoders, joint_rates, torque
from scipy.integrate import solve_ivp
from scipy.stats import t

from flexid.estimators.online import packed
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.parametric_observer import parametric_observer, suggest_gains
from flexid.simulation.free_run import free_run

JOINT = flexible_joint()


def replayed(samples: Samples, **settings):
    """Return the history of recursive least squares on positions, and the estimator."""
    estimator = recursive_least_squares(JOINT, SAMPLE_TIME, **settings)
    return estimator.replay(estimator.init(), estimator.pack(samples)), estimator


@pytest.mark.parametrize("first", [0, 1700])
def test_ends_where_the_batch_ends(first: int):
    """Assert that without forgetting the end equals the batch fit, also from a start in motion."""
    samples = encoders(3, first)
    history, _ = replayed(samples)
    fit = filtered_least_squares([samples], JOINT, 20.0)
    assert history.coefficients[-1] == pytest.approx(fit.values, rel=2e-7)


def test_standard_deviations_are_those_of_the_errors():
    """Assert that errors over 30 seeds match their standard errors within 40 %."""
    ratios = []
    for seed in range(30):
        history, estimator = replayed(encoders(seed))
        deviations = estimator.standard_deviations(history.state)
        ratios.append((history.coefficients[-1] - VALUES) / deviations)
    sizes = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((sizes > 0.6) & (sizes < 1.4))


def test_standard_deviations_after_two_seconds():
    """Assert infinite variances in the first second, and mostly right intervals at 4 s."""
    held = []
    for seed in range(20):
        samples = encoders(seed)
        for n in (900, 4000):
            part = replace(samples, positions=samples.positions[:n], inputs=samples.inputs[:n])
            history, estimator = replayed(part)
            covariance, freedom = estimator.covariance(history.state)
            assert np.all(np.isinf(np.diag(covariance)) == (n == 900))
            assert np.all((freedom == 0.0) == (n == 900))
        width = t.ppf(0.975, freedom) * np.sqrt(np.diag(covariance))
        held.append(np.abs(history.coefficients[-1] - VALUES) <= width)
    assert np.mean(held) > 0.85


def test_the_gain_stays_bounded():
    """Assert that forgetting keeps a least information on every coefficient."""
    samples = encoders(0)
    twist = -TRUTH["theta1"] * np.sin(0.3) / TRUTH["theta2"]  # the link held at 0.3 rad
    still = np.tile([0.3, 0.3 - twist], (60_000, 1))
    torques = np.full((60_000, 1), -TRUTH["alpha1"] * twist / TRUTH["beta1"])
    history, estimator = replayed(samples, memory=1.0)
    packed = estimator.pack(Samples(still, None, torques, SAMPLE_TIME))
    state, _ = estimator.step(history.state, np.full(3, np.nan))
    after = estimator.replay(state, packed)
    before, now = estimator.information(history.state), estimator.information(after.state)
    for old, new in zip(before, now, strict=True):
        assert np.all(np.diag(new) >= 0.99 * estimator.law.least_information * np.diag(old))
        assert np.linalg.eigvalsh(new)[0] > 0.0
    moved = np.abs(after.coefficients[-1] / history.coefficients[-1] - 1.0)
    assert moved.max() < 0.01


LOADED = TRUTH | {"theta2": TRUTH["theta2"] / 1.5}  # m g l and link inertia 1.5 times as large
CHANGE = 15_000  # samples


def test_a_payload_is_followed():
    """Assert that a memory of 2 s gives theta2 within 5 % 7 s after a load, and 1 % after 10 s."""
    inputs = torque(np.arange(CHANGE + 20_001) * SAMPLE_TIME)[:, None]
    before = free_run(JOINT, TRUTH, np.zeros(4), inputs[: CHANGE + 1], SAMPLE_TIME)
    after = free_run(JOINT, LOADED, before[-1], inputs[CHANGE:], SAMPLE_TIME)
    positions = np.concatenate((before[:-1], after))[:, ::2]
    noise = POSITION_NOISE * np.random.default_rng(4).standard_normal(positions.shape)
    samples = Samples(positions + noise, None, inputs, SAMPLE_TIME)
    found = replayed(samples, memory=2.0)[0].coefficients[CHANGE:]
    errors = np.abs(found / [*LOADED.values()] - 1.0)
    link = errors[:, :2].max(axis=1)
    assert link[0] > 0.3
    assert link[7_000:].max() < 0.05
    assert link[10_000:].max() < 0.01
    assert errors[:, 2:].max() < 0.01


def test_second_order_in_the_sample_time():
    """Assert that the sampled observer converges to SciPy's continuous one as h²."""
    gain, h = 0.2, 2e-3

    def right_hand_side(time, z):
        x, p, u = z[:4], z[4:], torque(time)
        rates, twist = joint_rates(x, u), x[0] - x[2]
        link, motor = np.array([-np.sin(x[0]), -twist]), np.array([twist, -x[3], u])
        link_rate = gain * link * (rates[1] - link @ p[:2])
        motor_rate = gain * motor * (rates[3] - motor @ p[2:])
        return np.concatenate((rates, link_rate, motor_rate))

    time = np.arange(801) * h
    start = np.concatenate((np.zeros(4), 0.5 * VALUES))
    z = solve_ivp(
        right_hand_side, (0.0, time[-1]), start, "DOP853", t_eval=time, rtol=1e-11, atol=1e-11
    ).y.T
    record = packed(Samples(z[:, [0, 2]], z[:, [1, 3]], torque(time)[:, None], h))
    begun = {name: 0.5 * value for name, value in TRUTH.items()}
    errors = []
    for stride in (4, 2, 1):
        observer = parametric_observer(JOINT, {"link": gain, "motor": gain}, stride * h)
        found = observer.replay(observer.init(begun), record[::stride]).coefficients[-1]
        errors.append(np.abs(found - z[-1, 4:]).max())
    slopes = np.diff(np.log(errors)) / np.log(0.5)
    assert slopes == pytest.approx([2.0, 2.0], abs=0.15)


def test_suggested_gains_converge_at_their_rate():
    """Assert that a single coefficient converges at the requested rate."""
    h, n, rate = 1e-3, 2001, 3.0
    time = np.arange(n, dtype=np.float64) * h
    force = np.ones(n)
    samples = Samples(np.zeros((n, 1)), 2.0 * time[:, None], force[:, None], h)
    cart = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u"}),))
    observer = parametric_observer(cart, suggest_gains(samples, cart, rate), h)
    last = observer.replay(observer.init(), packed(samples)).coefficients[-1, 0]
    assert last == pytest.approx(2.0 * (1.0 - np.exp(-rate * time[-1])), rel=1e-5)
