"""Measured coverage of the nominal 95 % intervals, by estimator and kind of noise.

Run in the repository: ``python -m benchmarks.coverage --seeds 400 [--only PATTERN]``. It replaces
the measured cells in `coverage.json` and the tables of `docs/intervals.md`. A cell with fewer seeds
than the stored one is only printed.
"""

import argparse
import datetime
import json
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks.coverage_page import BLOCK, PAGE, RESULTS, merged, render
from benchmarks.page_block import write_block
from benchmarks.size import sized
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.recursive_least_squares import (
    RecursiveLeastSquares,
    recursive_least_squares,
)
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.identification.vocabulary.evidence import interval
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run

JOINT = flexible_joint()
TRUTH = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
VALUES = np.array(list(TRUTH.values()))
DURATION, SAMPLE_TIME, FINER = sized(30.0, 12.0), 1e-3, 4
POSITION_NOISE = 1e-4
ENCODER_STEP = 2 * np.pi / 2**14
CORRELATION = 0.9

Ends = tuple[FloatArray, FloatArray, FloatArray]
"""Values, lower ends and upper ends of intervals."""


def motion(generator: np.random.Generator) -> Samples:
    """Simulate Table I's joint under two tones, from a random position, with a finer step.

    The torque is linear between samples, as the estimators assume.
    """
    time = np.arange(round(DURATION / SAMPLE_TIME) + 1) * SAMPLE_TIME
    torque = 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time)
    fine = np.interp(np.arange(FINER * (len(time) - 1) + 1) / FINER, np.arange(len(time)), torque)
    start = generator.uniform(-0.2, 0.2)
    states = free_run(
        JOINT, TRUTH, [start, 0.0, start, 0.0], fine[:, None], SAMPLE_TIME / FINER, "linear"
    )
    return Samples(states[::FINER, ::2], None, torque[:, None], SAMPLE_TIME)


def white(generator: np.random.Generator, positions: FloatArray) -> FloatArray:
    return positions + POSITION_NOISE * generator.standard_normal(positions.shape)


def autoregressive(generator: np.random.Generator, positions: FloatArray) -> FloatArray:
    run_in = 500
    shocks = generator.standard_normal((run_in + len(positions), positions.shape[1]))
    gain = POSITION_NOISE * np.sqrt(1.0 - CORRELATION**2)
    noise = np.asarray(lfilter([gain], [1.0, -CORRELATION], shocks, axis=0))
    return positions + noise[run_in:]


def quantised(generator: np.random.Generator, positions: FloatArray) -> FloatArray:
    """Round positions to encoder steps, with a random but known zero within a step."""
    zero = generator.uniform(0.0, ENCODER_STEP, positions.shape[1])
    return np.round((positions + zero) / ENCODER_STEP) * ENCODER_STEP - zero


NOISES: Mapping[str, Callable[[np.random.Generator, FloatArray], FloatArray]] = {
    "white, 1e-4 rad": white,
    "autoregressive, ρ = 0.9, 1e-4 rad": autoregressive,
    "14-bit encoders": quantised,
}


def segmented(duration: float) -> Callable[[Samples, LeastSquaresFit], PredictionErrorFit]:
    return lambda samples, start: prediction_error([samples], JOINT, start, duration)


def streamed(online: RecursiveLeastSquares) -> Callable[[Samples], Ends]:
    def fit(samples: Samples) -> Ends:
        state = online.replay(online.init(), online.pack(samples)).state
        return _ends(online.coefficients(state), *online.covariance(state))

    return fit


FITS: Mapping[str, Callable[[Samples, LeastSquaresFit], Any]] = {
    "least squares": lambda _, start: start,
    "1 s": segmented(1.0),
    "5 s": segmented(5.0),
    "10 s": segmented(10.0),
}
"""Batch fits that start from least squares."""

STREAMS: Mapping[str, Callable[[Samples], Ends]] = {
    "recursive": streamed(recursive_least_squares(JOINT, SAMPLE_TIME)),
}


def _of_fit(fit: Any) -> Ends:
    return _ends(fit.values, fit.covariance, fit.degrees_of_freedom)


def _gauss_newton(fit: PredictionErrorFit) -> Ends:
    return _ends(fit.values, np.linalg.inv(fit.information), (np.inf,) * len(fit.names))


ESTIMATORS: Mapping[str, tuple[str, Callable[[Any], Ends]]] = {
    "least squares": ("least squares", _of_fit),
    "prediction error, segments of 1 s": ("1 s", _of_fit),
    "prediction error, segments of 5 s": ("5 s", _of_fit),
    "prediction error, segments of 10 s": ("10 s", _of_fit),
    "online: recursive least squares": ("recursive", lambda ends: ends),
    "for contrast: Gauss-Newton, 1 s": ("1 s", _gauss_newton),
}
"""Measured estimators: key of the fit, and function that returns its intervals."""


def _ends(values: FloatArray, covariance: FloatArray, degrees_of_freedom: Any) -> Ends:
    deviations = np.sqrt(np.diag(covariance))
    ends = [
        interval(float(value), float(std), float(freedom))
        for value, std, freedom in zip(values, deviations, degrees_of_freedom, strict=True)
    ]
    return values, np.array([low for low, _ in ends]), np.array([high for _, high in ends])


def measure(noise: str, names: list[str], seeds: int) -> list[dict[str, Any]]:
    """Return the cells of one kind of noise."""
    found: dict[str, list[Ends]] = {name: [] for name in names}
    for seed in range(seeds):
        generator = np.random.default_rng(seed)
        clean = motion(generator)
        positions = NOISES[noise](generator, clean.positions)
        samples = Samples(positions, None, clean.inputs, SAMPLE_TIME)
        wanted = {ESTIMATORS[name][0] for name in names}
        fits = {key: fit(samples) for key, fit in STREAMS.items() if key in wanted}
        if wanted - set(STREAMS):
            start = filtered_least_squares([samples], JOINT)
            for key in wanted & set(FITS):
                with suppress(ConvergenceError):  # then there is no interval to count
                    fits[key] = FITS[key](samples, start)
        for name in names:
            key, ends = ESTIMATORS[name]
            if key in fits:
                found[name].append(ends(fits[key]))
        if (seed + 1) % 50 == 0:
            print(f"{noise}: {seed + 1} of {seeds}", flush=True)
    return [_cell(noise, name, ends) for name, ends in found.items()]


def _cell(noise: str, estimator: str, ends: list[Ends]) -> dict[str, Any]:
    values, low, high = (np.array(part) for part in zip(*ends, strict=True))
    held = (low <= VALUES) & (high >= VALUES)
    errors = np.sqrt(np.mean((values - VALUES) ** 2, axis=0))
    return {
        "noise": noise,
        "estimator": estimator,
        "seeds": len(ends),
        "date": str(datetime.datetime.now(datetime.UTC).date()),
        "held": dict(zip(TRUTH, np.sum(held, axis=0).tolist(), strict=True)),
        "half_width_over_rms_error": dict(
            zip(TRUTH, (np.median(high - low, axis=0) / 2 / errors).tolist(), strict=True)
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.coverage", description=__doc__)
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--only", default="", help="regular expression: estimators to measure")
    arguments = parser.parse_args()
    names = [name for name in ESTIMATORS if re.search(arguments.only, name)]
    for noise in NOISES:
        measured = measure(noise, names, arguments.seeds)
        old = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else []
        cells, fewer = merged(old, measured)
        if fewer:
            print("Of fewer seeds than what is kept, so not kept:\n\n" + render(fewer))
        by_key = {(cell["noise"], cell["estimator"]): cell for cell in cells}
        kept = [by_key[n, e] for e in ESTIMATORS for n in NOISES if (n, e) in by_key]
        RESULTS.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        write_block(PAGE, BLOCK, render(kept))


if __name__ == "__main__":
    main()
