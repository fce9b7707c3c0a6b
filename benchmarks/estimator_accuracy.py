"""Accuracy and coverage of least squares and the observer on the noisy joint of the tests.

Run in the repository: ``PYTHONPATH=tests/estimators python benchmarks/estimator_accuracy.py``
"""

import time
from dataclasses import replace

import numpy as np
from noisy_joint import TRUTH, VALUES, joint_samples, worst_error
from scipy.stats import t

from benchmarks.size import sized
from flexid.estimators.online import packed
from flexid.estimators.state_variable_filter import filtered_least_squares, filtered_signals
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.parametric_observer import parametric_observer, suggest_gains

JOINT = flexible_joint()
RATES = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
SEEDS = sized(20, 1)
COVERED = range(1000, sized(1200, 1002))


def accuracy() -> None:
    print("worst of five coefficients in percent, 20 seeds, median / largest")
    for first in (0, 1000):
        for rate in RATES:
            records = [
                replace(joint_samples(seed, first), velocities=None) for seed in range(SEEDS)
            ]
            fits = [filtered_least_squares([record], JOINT, rate) for record in records]
            errors = [worst_error(fit.values) for fit in fits]
            print(f"  from {first} ms, {rate:g} 1/s: {np.median(errors):.4f} / {max(errors):.4f}")


def coverage() -> None:
    print("coverage of nominal 95 % intervals, 200 seeds: each coefficient, mean")
    for first, rates in ((0, RATES[:5]), (20_000, (20.0,))):
        for rate in rates:
            held = []
            for seed in COVERED:
                fit = filtered_least_squares([joint_samples(seed, first)], JOINT, rate)
                width = t.ppf(0.975, np.array(fit.degrees_of_freedom)) * fit.standard_deviations
                held.append(np.abs(fit.values - VALUES) <= width)
            each = " ".join(f"{share:.3f}" for share in np.mean(held, axis=0))
            print(f"  from {first} ms, {rate:g} 1/s: {each}, {np.mean(held):.3f}")


def observer() -> None:
    print("parametric observer from half the truth, worst error after 30 s in percent, by rate")
    for name, record in (("clean", joint_samples()), ("noisy", joint_samples(0))):
        for rate in (1.0, 10.0, 100.0, 1000.0):
            built = parametric_observer(JOINT, suggest_gains(record, JOINT, rate), 1e-3)
            start = built.init({name: 0.5 * value for name, value in TRUTH.items()})
            error = worst_error(built.replay(start, packed(record)).coefficients[-1])
            print(f"  {name}, {rate:g} 1/s: {error:.1f}")


def best_time(function, repeats: int = sized(40, 1)) -> float:
    """Return the shortest time of several runs, in s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def speed() -> None:
    record = joint_samples(0)
    signals = filtered_signals([record], JOINT, 20.0, "linear")
    link, motor = signals[:2].T.copy(), signals[2:5].T.copy()

    def bare() -> None:
        np.linalg.lstsq(link, signals[5], rcond=None)
        np.linalg.lstsq(motor, signals[6], rcond=None)

    fit = best_time(lambda: filtered_least_squares([record], JOINT))
    reference = best_time(bare)
    print(f"30 000 samples: {1e3 * fit:.2f} ms, {fit / reference:.2f} times bare lstsq, both rows")
    built = parametric_observer(JOINT, suggest_gains(record, JOINT), 1e-3)
    state, samples = built.init(TRUTH), packed(record)
    replay = best_time(lambda: built.replay(state, samples)) / len(samples)
    step = best_time(lambda: [built.step(state, samples[7]) for _ in range(1000)]) / 1000
    print(f"observer: replay {1e9 * replay:.1f} ns per sample, one step {1e6 * step:.2f} us")


if __name__ == "__main__":
    accuracy()
    coverage()
    observer()
    speed()
