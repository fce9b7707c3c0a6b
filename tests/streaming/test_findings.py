"""What is said of a stream's numbers: the words that an identification has for them."""

import numpy as np
import pytest
from moving_joint import LINK, MOTOR, NOISE, H, stream, watched

from flexid.identification.judgement.estimates import verdict
from flexid.streaming.options import WatchOptions

WITH_COULOMB = WatchOptions(H, ("gravity", "motor_viscous", "motor_coulomb"), hold="linear")


@pytest.mark.parametrize(("noise", "expected"), [(3.0, "determined"), (30.0, "undetermined")])
def test_a_friction_that_is_not_there_is_judged_by_what_it_could_do(noise, expected):
    """Assert that of a friction whose interval holds zero its share of the acceleration decides.

    It is determined to be as small as it is where half its interval, in rad/s², is a small part of
    the motor's acceleration, as in an identification, and not otherwise.
    """
    samples = stream(3.0)
    acceleration = np.gradient(np.gradient(samples[::25, MOTOR], 25 * H), 25 * H)
    rng = np.random.default_rng(2)
    samples[:, [LINK, MOTOR]] += noise * NOISE * rng.standard_normal((len(samples), 2))
    found = watched(samples, WITH_COULOMB).coefficients["alpha_coulomb"]
    low, high = found.interval
    assert low < 0.0 < high
    effect = 0.5 * (high - low) / float(np.sqrt(np.mean(acceleration**2)))
    assert found.verdict == verdict(found.value, found.interval, effect)[0] == expected
    assert found.verdict != "determined" or verdict(found.value, found.interval)[0] != "determined"
