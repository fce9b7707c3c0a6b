"""Streams without an input."""

from pathlib import Path

import numpy as np
from moving_joint import (
    LINK,
    MOTOR,
    TIME,
    TORQUE,
    TRUTH,
    H,
    all_hold,
    followed,
    log_text,
    same,
    stream,
    torque,
    watched,
)

from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run
from flexid.streaming.options import WatchOptions

OPTIONS = WatchOptions(H, ("gravity",), "link")
DAMPED = WatchOptions(H, ("gravity", "joint_damping"), "link")


def motion(duration: float = 8.0, seed: int = 1) -> np.ndarray:
    """Return samples without the torque."""
    return stream(duration, seed)[:, [TIME, LINK, MOTOR]]


def test_damping_is_found():
    """Assert narrow intervals that cover the truth, of damping too: velocities have their size."""
    damped = {"theta_damping": 0.5, "alpha_damping": 0.5 / 0.3}
    time = H * np.arange(4000)
    system = flexible_joint(("gravity", "motor_viscous", "joint_damping"))
    states = free_run(system, TRUTH | damped, np.zeros(4), torque(time)[:, None], H)
    positions = states[:, ::2] + 1e-5 * np.random.default_rng(3).standard_normal((len(time), 2))
    session = watched(np.column_stack((time, positions)), DAMPED)
    assert all_hold(session, {"theta1": 5.0, "theta2": 100.0, "theta_damping": 0.5})
    for name, width in (("theta2", 1.0), ("theta_damping", 0.02)):
        assert np.diff(session.coefficients[name].interval)[0] < width
    assert session.health.reason.startswith("theta2 is known within")


def test_a_log_without_a_torque_is_followed(tmp_path: Path):
    """Assert that columns decide the model, and that --model link ignores a torque."""
    for columns, model in (([TIME, LINK, MOTOR], "auto"), ([TIME, LINK, MOTOR, TORQUE], "link")):
        (tmp_path / "log.csv").write_text(log_text(stream(2.0), *columns))
        chosen = {"terms": OPTIONS.terms, "sample_time": H, "kind": model}
        session = followed(tmp_path / "log.csv", chosen).result
        assert same(session, watched(motion(2.0), OPTIONS))
