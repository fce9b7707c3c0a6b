"""Delay and noise of recursive least squares for a changing load and an ageing spring.

Run in the repository: ``python -m benchmarks.drifting [--seeds 10]``. It prints the tables of
`docs/watch.md` and draws `docs/assets/drifting.png`.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.size import sized
from flexid.arrays import FloatArray
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import Samples
from flexid.models.flexible_joint import flexible_joint
from flexid.report.figure import BLUE, GREY, INK, ORANGE, STYLE, new_figure, save
from flexid.simulation.free_run import free_run

JOINT = flexible_joint()
NAMES = JOINT.coefficients
BEFORE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
SAMPLE_TIME, DURATION, CHANGE = 1e-3, *sized((40.0, 20.0), (4.0, 2.0))
SLICE = 20  # samples with constant coefficients of an ageing joint
AGEING, AGEING_DURATION = 0.10, sized(60.0, 21.0)  # share of the stiffness lost, and duration in s
MEMORY_TIMES = (0.5, 1.0, 2.0, 5.0, 10.0)
NOISES = (1e-5, 1e-4, 1e-3)
LEVELS = (0.05, 0.01)


def torque(time: FloatArray) -> FloatArray:
    return 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time)


def moved(coefficients: Callable[[float], dict[str, float]], duration: float, part: int):
    """Simulate a joint with coefficients that change in steps; return samples and true values."""
    count = round(duration / SAMPLE_TIME)
    inputs = torque(np.arange(count + 1) * SAMPLE_TIME)[:, None]
    states, truth = np.zeros((count + 1, 4)), np.empty((count + 1, len(NAMES)))
    for first in range(0, count, part):
        stop = min(count, first + part)
        now = coefficients(0.5 * (first + stop) * SAMPLE_TIME)
        states[first : stop + 1] = free_run(
            JOINT, now, states[first], inputs[first : stop + 1], SAMPLE_TIME
        )
        truth[first : stop + 1] = [now[name] for name in NAMES]
    return Samples(states[:, ::2], None, inputs, SAMPLE_TIME), truth


def payload(time: float) -> dict[str, float]:
    """Return coefficients; link inertia and gravity torque grow by half at `CHANGE`.

    theta1, their ratio, does not change; theta2, stiffness over inertia, falls by a third.
    """
    return BEFORE | ({"theta2": 100.0 / 1.5} if time > CHANGE else {})


def ageing(time: float) -> dict[str, float]:
    left = 1.0 - AGEING * time / AGEING_DURATION
    return BEFORE | {name: left * BEFORE[name] for name in ("theta2", "alpha1")}


def errors(samples: Samples, truth: FloatArray, noise: float, seed: int, tau: float):
    """Return the relative errors of all coefficients over time, and the estimates."""
    generator = np.random.default_rng(seed)
    noisy = samples.positions + noise * generator.standard_normal(samples.positions.shape)
    estimator = recursive_least_squares(JOINT, SAMPLE_TIME, memory=tau)
    packed = estimator.pack(Samples(noisy, None, samples.inputs, SAMPLE_TIME))
    found = estimator.replay(estimator.init(), packed).coefficients
    return found / truth - 1.0, found


def payload_table(seeds: int) -> None:
    samples, truth = moved(payload, DURATION, round(CHANGE / SAMPLE_TIME))
    change = round(CHANGE / SAMPLE_TIME)
    print("payload: s until theta2 stays within 5 and 1 %; worst RMS error before the change, %")
    for noise in NOISES:
        for tau in MEMORY_TIMES:
            settled, price = [], []
            for seed in range(seeds):
                error, _ = errors(samples, truth, noise, seed, tau)
                off = np.abs(error[change:, 1])
                settled.append([np.flatnonzero(off > level)[-1:] * SAMPLE_TIME for level in LEVELS])
                before = error[change // 2 : change]
                price.append(100.0 * np.sqrt(np.mean(before**2, axis=0)).max())
            times = " ".join(f"{t:.1f}" for t in np.median(settled, axis=0).ravel())
            print(f"  {noise:g} rad, {tau:g} s: {times}; {np.median(price):.4f}")


def ageing_table(seeds: int) -> None:
    samples, truth = moved(ageing, AGEING_DURATION, SLICE)
    print("ageing: RMS error of theta2 from 20 s on, %")
    for noise in NOISES:
        cells = []
        for tau in (*MEMORY_TIMES, np.inf):
            squares = [
                np.mean(errors(samples, truth, noise, seed, tau)[0][20_000:, 1] ** 2)
                for seed in range(seeds)
            ]
            cells.append(f"{100.0 * np.sqrt(np.mean(squares)):.4f}")
        print(f"  {noise:g} rad: {' '.join(cells)}")


def draw(directory: Path) -> None:
    with mpl.rc_context(STYLE):
        figure = new_figure(7.2, 3.2)
        left, right = figure.subplots(1, 2)
        for ax, coefficients, duration, part in (
            (left, payload, DURATION, round(CHANGE / SAMPLE_TIME)),
            (right, ageing, AGEING_DURATION, SLICE),
        ):
            samples, truth = moved(coefficients, duration, part)
            time = samples.time
            for tau, colour in ((1.0, ORANGE), (5.0, BLUE), (np.inf, GREY)):
                _, found = errors(samples, truth, 1e-4, 0, tau)
                label = "nothing forgotten" if np.isinf(tau) else f"memory {tau:g} s"
                ax.plot(time[::20], found[::20, 1], color=colour, label=label)
            ax.plot(time, truth[:, 1], color=INK, linestyle=":", label="truth")
            ax.set(xlabel="time, s", xlim=(0.0, duration))
        left.set(title="Payload: inertia and gravity +50 %", ylim=(60.0, 105.0))
        left.set_ylabel("stiffness over link inertia, 1/s²")
        right.set(title="Stiffness ageing by 10 %", ylim=(88.0, 102.0))
        right.legend()
        save(figure, directory, "drifting")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=10)
    arguments = parser.parse_args()
    draw(Path("docs/assets"))
    payload_table(arguments.seeds)
    ageing_table(arguments.seeds)
