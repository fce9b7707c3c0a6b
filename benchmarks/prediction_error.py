"""Accuracy, coverage and speed of the segmented prediction error.

Run in the repository: ``PYTHONPATH=tests/estimators python benchmarks/prediction_error.py``
"""

import sys
import time
from dataclasses import replace
from operator import attrgetter

import numpy as np
from noisy_joint import POSITION_NOISE, VALUES, joint_samples, worst_error
from scipy.signal import lfilter
from scipy.stats import t

from benchmarks.segment_bound import cramer_rao_bound
from benchmarks.size import sized
from flexid.arrays import FloatArray
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.flexible_joint import flexible_joint

JOINT = flexible_joint()
SEEDS = range(sized(20, 1))
DURATIONS = sized((0.5, 1.0, 2.0, 5.0, 10.0), (1.0,))


def fit(samples: Samples, duration: float = 1.0) -> PredictionErrorFit:
    start = filtered_least_squares([samples], JOINT)
    return prediction_error([samples], JOINT, start, duration)


def accuracy() -> None:
    print("worst of five coefficients in percent, 20 seeds: median / largest; RMS over bound")
    for duration in DURATIONS:
        bound = cramer_rao_bound(round(30.0 / duration))
        fits = [fit(joint_samples(seed), duration) for seed in SEEDS]
        errors = [worst_error(found.values) for found in fits]
        rms = np.sqrt(np.mean([(found.values - VALUES) ** 2 for found in fits], axis=0))
        ratios = " ".join(f"{ratio:.2f}" for ratio in rms / bound)
        print(
            f"  {duration:g} s: {np.median(errors):.4f} / {max(errors):.4f};"
            f" {ratios}, all {np.sqrt(np.mean((rms / bound) ** 2)):.2f}"
        )


def encoder(bits: int, first: int) -> Samples:
    """Return the clean record from a sample on, rounded to an encoder's bits per turn."""
    clean, step = joint_samples(first=first), 2 * np.pi / 2**bits
    return replace(clean, positions=np.round(clean.positions / step) * step, velocities=None)


def encoders() -> None:
    print("encoders only, record cut at 0, 100, ... 1900 ms: median / largest of the worst error")
    for bits in (16, 14, 12):
        for duration in (1.0, 5.0):
            errors = [worst_error(fit(encoder(bits, 100 * i), duration).values) for i in SEEDS]
            print(f"  {bits} bit, {duration:g} s: {np.median(errors):.4f} / {max(errors):.4f}")


def correlated(seed: int, rho: float) -> Samples:
    """Add autoregressive noise of the usual standard deviation to positions."""
    clean = joint_samples()
    shocks = np.random.default_rng(seed).standard_normal((2000 + len(clean), 2))
    noise = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], shocks, axis=0)[2000:]
    return replace(clean, positions=clean.positions + POSITION_NOISE * noise, velocities=None)


def white_covariance(found: PredictionErrorFit) -> FloatArray:
    """Return the textbook covariance, which is valid for white residuals only."""
    return np.linalg.inv(found.information)


def coverage(n_seeds: int = sized(400, 1)) -> None:
    print(f"coverage of nominal 95 % intervals, {n_seeds} seeds: each coefficient, all")
    for rho in (0.0, 0.9):
        fits = [fit(correlated(seed, rho)) for seed in range(1000, 1000 + n_seeds)]
        for name, of in (("blocks", attrgetter("covariance")), ("white noise", white_covariance)):
            held = []
            for found in fits:
                width = np.sqrt(np.diag(of(found)))
                width *= t.ppf(0.975, np.array(found.degrees_of_freedom))
                held.append(np.abs(found.values - VALUES) <= width)
            each = " ".join(f"{share:.3f}" for share in np.mean(held, axis=0))
            print(f"  rho {rho:g}, {name}: {each}, {np.mean(held):.3f}")


def speed() -> None:
    samples = joint_samples(0)
    start = filtered_least_squares([samples], JOINT)
    times = []
    for _ in SEEDS:
        begin = time.perf_counter()
        prediction_error([samples], JOINT, start)
        times.append(time.perf_counter() - begin)
    print(f"30 s at 1 kHz: {min(times):.3f} s, {np.median(times):.3f}")


if __name__ == "__main__":
    parts = (accuracy, encoders, coverage, speed)
    for part in parts:
        if len(sys.argv) == 1 or part.__name__ in sys.argv[1:]:
            part()
