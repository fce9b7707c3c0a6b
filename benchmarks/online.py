"""Accuracy, settling and cost of all online estimators on the noisy joint of the tests.

Run in the repository: ``PYTHONPATH=tests/estimators python -m benchmarks.online [--seeds 20]``
"""

import argparse
import time
from dataclasses import replace

import numpy as np
from noisy_joint import SAMPLE_TIME, TRUTH, VALUES, joint_samples, worst_error

from benchmarks.size import sized
from flexid.arrays import FloatArray
from flexid.estimators.online import OnlineEstimator
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import Samples
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.parametric_observer import parametric_observer, suggest_gains

JOINT = flexible_joint()
STEPS = sized(3000, 10)  # timed single steps from Python
STARTS = (10.0, 0.1)  # times the truth


def estimators() -> dict[str, OnlineEstimator]:
    gains = suggest_gains(joint_samples(), JOINT, 100.0)
    return {
        "recursive least squares": recursive_least_squares(JOINT, SAMPLE_TIME),
        "observer, constant gain": parametric_observer(JOINT, gains, SAMPLE_TIME),
    }


def record(seed: int, bits: int = 0) -> Samples:
    """Return the noisy record, or one of noiseless encoders with a number of bits per turn."""
    if not bits:
        return joint_samples(seed)
    clean, step = joint_samples(), 2 * np.pi / 2**bits
    zero = np.random.default_rng(seed).uniform(0.0, step, 2)
    return replace(clean, positions=np.round((clean.positions + zero) / step) * step - zero)


def settling_time(coefficients: FloatArray) -> float:
    """Return the time after which the worst coefficient stays within 1 %, in s."""
    outside = np.flatnonzero(np.abs(coefficients / VALUES - 1.0).max(axis=1) > 0.01)
    return float((outside[-1] + 1) * SAMPLE_TIME) if len(outside) else 0.0


def describe(name: str, estimator: OnlineEstimator, seeds: int) -> None:
    start = estimator.init({c: 0.5 * value for c, value in TRUTH.items()})
    packed = estimator.pack(record(0))
    estimator.replay(start, packed)
    last, settled, spent = [], [], []
    for seed in range(seeds):
        samples = estimator.pack(record(seed))
        begin = time.process_time()
        history = estimator.replay(start, samples)
        spent.append(time.process_time() - begin)
        last.append(worst_error(history.coefficients[-1]))
        settled.append(settling_time(history.coefficients))
    print(
        f"{name}: {np.median(last):.4f} / {max(last):.4f} %, within 1 % after "
        f"{np.median(settled):.2f} / {max(settled):.2f} s, replay "
        f"{1e6 * np.median(spent) / len(packed):.2f} µs per sample"
    )
    state, _ = estimator.step(start, packed[0])
    begin = time.process_time()
    for sample in packed[:STEPS]:
        state, _ = estimator.step(state, sample)
    print(f"  one step from Python {1e6 * (time.process_time() - begin) / STEPS:.1f} µs")
    for factor in STARTS:
        wrong = estimator.init({c: factor * value for c, value in TRUTH.items()})
        print(f"  from {factor:g} x the truth: ", end="")
        print(f"{worst_error(estimator.replay(wrong, packed).coefficients[-1]):.4f} %")
    for bits in (14, 12):
        errors = [
            worst_error(
                estimator.replay(start, estimator.pack(record(seed, bits))).coefficients[-1]
            )
            for seed in range(seeds)
        ]
        print(f"  {bits} bit encoders: {np.median(errors):.4f} / {max(errors):.4f} %")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=20)
    arguments = parser.parse_args()
    for title, built in estimators().items():
        describe(title, built, arguments.seeds)
