"""The paper's observer as an estimator."""

import numpy as np
import pytest
from noisy_joint import TRUTH, VALUES, torque
from scipy.integrate import solve_ivp

from flexid.estimators.online import packed
from flexid.estimators.samples import Samples
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.parametric_observer import parametric_observer, suggest_gains

JOINT = flexible_joint()
START = {name: 0.5 * value for name, value in TRUTH.items()}


def continuous_estimates(gain, duration, h):
    """The joint with its observer in continuous time, by SciPy: samples and last estimates."""
    theta1, theta2, alpha1, alpha2, beta1 = VALUES

    def right_hand_side(time, z):
        x, p = z[:4], z[4:]
        u = torque(time)
        twist = x[0] - x[2]
        f = np.array([-np.sin(x[0]), -twist])
        phi = np.array([twist, -x[3], u])
        link = f @ [theta1, theta2]
        motor = phi @ [alpha1, alpha2, beta1]
        link_rate = gain * f * (link - f @ p[:2])
        motor_rate = gain * phi * (motor - phi @ p[2:])
        return np.concatenate(([x[1], link, x[3], motor], link_rate, motor_rate))

    time = np.arange(round(duration / h) + 1) * h
    start = np.concatenate((np.zeros(4), 0.5 * VALUES))
    z = solve_ivp(
        right_hand_side, (0.0, time[-1]), start, "DOP853", t_eval=time, rtol=1e-11, atol=1e-11
    ).y.T
    samples = Samples(z[:, [0, 2]], z[:, [1, 3]], torque(time)[:, None], h)
    return samples, z[-1, 4:]


def test_second_order_in_the_sample_time():
    """Assert that the sampled observer approaches the continuous one as h²."""
    samples, expected = continuous_estimates(0.2, 1.6, 2e-3)
    errors = []
    for stride in (4, 2, 1):
        observer = parametric_observer(
            JOINT, {"link": 0.2, "motor": 0.2}, stride * samples.sample_time
        )
        record = packed(samples)[::stride]
        found = observer.replay(observer.init(START), record).coefficients[-1]
        errors.append(np.abs(found - expected).max())
    slopes = np.diff(np.log(errors)) / np.log(0.5)
    assert slopes == pytest.approx([2.0, 2.0], abs=0.15)


def test_suggested_gains_converge_at_their_rate():
    """Assert that a lone coefficient decays at the rate that was asked for."""
    h, n, rate = 1e-3, 2001, 3.0
    time = np.arange(n, dtype=np.float64) * h
    force = np.ones(n)
    samples = Samples(np.zeros((n, 1)), 2.0 * time[:, None], force[:, None], h)
    cart = ParametricSystem("cart", (Row("cart", "q", "v", {"gain": "u"}),))
    observer = parametric_observer(cart, suggest_gains(samples, cart, rate), h)
    last = observer.replay(observer.init(), packed(samples)).coefficients[-1, 0]
    assert last == pytest.approx(2.0 * (1.0 - np.exp(-rate * time[-1])), rel=1e-5)
