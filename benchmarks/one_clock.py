"""Conversion of a fast input to a slower clock: sampling, or filtering before.

``python -m benchmarks.one_clock``: the joint of Huang (2003), 20 s, motor and torque every
millisecond, the link every five and in between. It prints the half-widths of the 95 % intervals in
percent, from best to worst of four parameters and three seeds, and how many contain the truth.
"""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

import flexid
from benchmarks.report import markdown
from benchmarks.size import sized
from flexid.arrays import FloatArray
from flexid.recording.one_clock import Signal, on_one_clock
from flexid.simulation.free_run import free_run

TERMS = ("gravity", "motor_viscous")
COEFFICIENTS = {
    "theta1": 5.0,
    "theta2": 100.0,
    "alpha1": 1000 / 3,
    "alpha2": 1 / 3,
    "beta1": 1 / 0.3,
}
TRUTH = {"joint_stiffness": 100.0, "link_inertia": 1.0, "motor_inertia": 0.3, "gravity_torque": 5.0}
SEEDS = sized(3, 1)
_H, _SLOW, _DURATION, _NOISE = 1e-3, 5, 20.0, 1e-4
_APART = 0.37e-3  # s, between the link's samples and the motor's


def _sines(time: FloatArray) -> FloatArray:
    return 15.0 * np.sin(2.0 * time) + 8.0 * np.sin(5.3 * time) + 5.0 * np.sin(13.0 * time)


def _stairs(time: FloatArray, rng: np.random.Generator) -> FloatArray:
    levels = _sines(time)[::_SLOW]
    return np.repeat(levels + 3.0 * rng.standard_normal(len(levels)), _SLOW)[: len(time)]


TORQUES: dict[str, Callable[[FloatArray, np.random.Generator], FloatArray]] = {
    "sines": lambda time, _: _sines(time),
    "and white noise": lambda time, rng: _sines(time) + 5.0 * rng.standard_normal(len(time)),
    "steps": lambda time, _: 10.0 * np.sign(np.sin(2.0 * time)) + 6.0 * np.sign(np.sin(7.1 * time)),
    "held at the slower rate": _stairs,
}


def logs(kind: str, seed: int) -> dict[str, dict[str, FloatArray]]:
    """Return logs of a drive on the link's clock, with the torque sampled and filtered."""
    rng = np.random.default_rng(seed)
    time = _H * np.arange(round(_DURATION / _H) + 1, dtype=np.float64)
    u = TORQUES[kind](time, rng)
    system = flexid.flexible_joint(TERMS)
    states = free_run(system, COEFFICIENTS, np.zeros(4), u[:, None], _H, "zero")
    motor = states[:, 2] + _NOISE * rng.standard_normal(len(time))
    apart = 0.0 if kind == "held at the slower rate" else _APART
    slow = (time[::_SLOW] + apart)[:-1]
    link = np.asarray(CubicSpline(time, states[:, 0])(slow), dtype=np.float64)
    link += _NOISE * rng.standard_normal(len(slow))
    signals = [
        Signal("link_position", "slow", link, False),
        Signal("motor_position", "fast", motor, False),
        Signal("motor_torque", "fast", u, True),
    ]
    times, columns, _ = on_one_clock("log", {"slow": slow, "fast": time}, signals)
    filtered = {"time": times, **columns}
    sampled = np.asarray(PchipInterpolator(time, u)(times), dtype=np.float64)
    return {"sampled": filtered | {"motor_torque": sampled}, "filtered": filtered}


def main() -> None:
    """Print the table."""
    lines = []
    for kind in sized([*TORQUES], ["sines"]):
        halves: dict[str, list[float]] = {"sampled": [], "filtered": []}
        held = dict.fromkeys(halves, 0)
        for seed in range(SEEDS):
            for way, log in logs(kind, seed).items():
                found = flexid.identify(log, terms=TERMS).parameters
                for name, truth in TRUTH.items():
                    low, high = found[name].interval
                    halves[way].append(0.5 * (high - low) / truth)
                    held[way] += low <= truth <= high
        cells = [
            f"{min(h):.3%} to {max(h):.3%}, {held[way]} of {len(h)}" for way, h in halves.items()
        ]
        lines.append((kind, *cells))
    print(*markdown(("torque", "sampled", "filtered before"), lines), sep="\n")


if __name__ == "__main__":
    main()
