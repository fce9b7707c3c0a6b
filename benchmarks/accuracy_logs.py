"""Logs for the comparison of accuracy, as files and as arrays."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from tests.estimators.noisy_joint import (
    POSITION_NOISE,
    TRUTH,
    VELOCITY_NOISE,
    clean_motion,
    torque,
)

from benchmarks.peers.problem import Log
from flexid.arrays import FloatArray

EXAMPLE = Path("examples/flexible_joint.csv")

# From examples/make_flexible_joint_log.py.
_EXAMPLE_NOISE = 1e-4
_EXAMPLE_COUNT = 2 * np.pi / 2**16

_GUESS = {name: 0.5 * value for name, value in TRUTH.items()}


@dataclass(frozen=True)
class Case:
    """A kind of log.

    Parameters
    ----------
    name : str
        Name in tables.
    make : callable
        Function that writes the log of a seed into a folder.
    only : int or None
        Number of different logs; None if every seed gives another one.
    """

    name: str
    make: Callable[[Path, int], Log]
    only: int | None = None


def noisy(scale: float, velocities: bool) -> Callable[[Path, int], Log]:
    """Return a maker of logs with `scale` times the usual white noise."""

    def make(folder: Path, seed: int) -> Log:
        time, states = clean_motion()
        generator = np.random.default_rng(seed)
        noise = scale * np.array([POSITION_NOISE, VELOCITY_NOISE] * 2)
        states = states + noise * generator.standard_normal(states.shape)
        return _written(
            folder,
            time,
            states[:, [0, 2]],
            states[:, [1, 3]] if velocities else None,
            scale * POSITION_NOISE,
            scale * VELOCITY_NOISE,
        )

    return make


def encoders(bits: int) -> Callable[[Path, int], Log]:
    """Return clean positions in whole encoder counts, starting at 0.1 s times the seed."""

    def make(folder: Path, seed: int) -> Log:
        time, states = clean_motion()
        count = 2 * np.pi / 2**bits
        positions = np.round(states[100 * seed :, [0, 2]] / count) * count
        return _written(folder, time[100 * seed :], positions, None, count / np.sqrt(12.0), np.nan)

    return make


def example(_: Path, __: int) -> Log:
    """Return the example log, which was simulated with MuJoCo."""
    table = pl.read_csv(EXAMPLE)
    time, link, motor, applied = (table[:, place].to_numpy() for place in range(4))
    noise = float(np.hypot(_EXAMPLE_NOISE, _EXAMPLE_COUNT / np.sqrt(12.0)))
    return Log(
        EXAMPLE, time, np.column_stack([link, motor]), None, applied, True, noise, np.nan, _GUESS
    )


def _written(
    folder: Path,
    time: FloatArray,
    positions: FloatArray,
    velocities: FloatArray | None,
    position_noise: float,
    velocity_noise: float,
) -> Log:
    applied = torque(time)
    columns = {
        "time [s]": time,
        "link_position [rad]": positions[:, 0],
        "motor_position [rad]": positions[:, 1],
        "motor_torque [N m]": applied,
    }
    if velocities is not None:
        columns["link_velocity [rad/s]"], columns["motor_velocity [rad/s]"] = velocities.T
    path = folder / "log.csv"
    pl.DataFrame(columns).write_csv(path)
    return Log(
        path, time, positions, velocities, applied, False, position_noise, velocity_noise, _GUESS
    )


CASES = (
    Case("noise × 0.1", noisy(0.1, True)),
    Case("noise × 1", noisy(1.0, True)),
    Case("noise × 10", noisy(10.0, True)),
    Case("encoders, noise × 1", noisy(1.0, False)),
    Case("encoders, 14 bit", encoders(14)),
    Case("example log", example, only=1),
)
