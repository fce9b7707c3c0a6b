"""Units and scales of a stream, by the checks of a log."""

import re
from pathlib import Path

import numpy as np
import pytest
from moving_joint import LINK, MOTOR, TORQUE, H, stream

from flexid.arrays import FloatArray
from flexid.streaming.follower import Follower

SAMPLES = stream(24.0)
RESTING = 11_000  # samples


def scaled(factor: float, *places: int, samples: FloatArray = SAMPLES) -> FloatArray:
    """Samples with another scale of some columns."""
    samples = samples.copy()
    samples[:, places] *= factor
    return samples


def after_rest() -> FloatArray:
    """Samples of a joint that rests at first."""
    noise = 1e-4 * np.random.default_rng(3).standard_normal((RESTING, 4))
    noise[:, 0] = H * np.arange(RESTING)
    return np.concatenate((noise, SAMPLES + np.array([RESTING * H, 0.0, 0.0, 0.0])))


def with_gaps() -> FloatArray:
    """Samples of which half a second in two is missing at first."""
    places = np.arange(len(SAMPLES))
    return SAMPLES[(places % 1000 >= 250) | (places > 4000)]


DEGREES = 180.0 / np.pi
FAULTS: dict[str, tuple[FloatArray, str | None]] = {
    "nothing": (SAMPLES, None),
    "ten samples once more": (np.concatenate((SAMPLES[:3000], SAMPLES[2990:])), None),
    "a rest": (after_rest(), None),
    "gaps": (with_gaps(), None),
    "a link in degrees": (scaled(DEGREES, LINK), "57.3 times the motor.*degrees"),
    "degrees after a rest": (
        scaled(DEGREES, LINK, samples=after_rest()),
        "57.3 times the motor.*degrees",
    ),
    "another scale and gaps": (
        scaled(1.02, LINK, samples=with_gaps()),
        r"link moves 1\.0(19[5-9]|20[0-4]) ± .* times as far",
    ),
    "a link that turns the other way": (scaled(-1.0, LINK), "opposite directions"),
    "a torque in thousandths": (scaled(3000.0, TORQUE), "gives .* W, more than 20000"),
    "both in degrees": (scaled(DEGREES, LINK, MOTOR), "faster than a joint does"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_scales_of_a_stream(name: str, tmp_path: Path) -> None:
    """Assert that what a log is refused or warned for is a warning, and nothing else is."""
    samples, words = FAULTS[name]
    path = tmp_path / "log.csv"
    header = "time,link_position,motor_position,motor_torque"
    np.savetxt(path, samples, delimiter=",", header=header, comments="", fmt="%.9g")
    follower = Follower(str(path), {"sample_time": 2e-3}, stop_at_end=True)
    list(follower.turns(10.0))
    if words is None:
        assert follower.warnings == ()
    else:
        assert any(re.search(words, warning) for warning in follower.warnings), follower.warnings
