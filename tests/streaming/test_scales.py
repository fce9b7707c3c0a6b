"""Units and scales of a stream, by the checks of a log."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from moving_joint import LINK, MOTOR, TORQUE, stream

from flexid.streaming.follower import Follower

SAMPLES = stream(24.0)
FAULTS = {
    "nothing": ((), 1.0, None),
    "a link in degrees": ((LINK,), 180.0 / np.pi, "57.3 times the motor.*degrees"),
    "a link that turns the other way": ((LINK,), -1.0, "opposite directions"),
    "a torque in thousandths": ((TORQUE,), 3000.0, "gives .* W, more than 20000"),
    "both in degrees": ((LINK, MOTOR), 180.0 / np.pi, "faster than a joint does"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_scales_of_a_stream(name: str, tmp_path: Path) -> None:
    """Assert that what a log is refused or warned for is a warning, and nothing else is."""
    places, factor, words = FAULTS[name]
    samples = SAMPLES.copy()
    samples[:, places] *= factor
    path = tmp_path / "log.csv"
    header = "time,link_position,motor_position,motor_torque"
    np.savetxt(path, samples, delimiter=",", header=header, comments="", fmt="%.9g")
    follower = Follower(str(path), {"sample_time": 2e-3}, stop_at_end=True)
    list(follower.turns(10.0))
    if words is None:
        assert follower.warnings == ()
    else:
        assert any(re.search(words, warning) for warning in follower.warnings), follower.warnings
