"""The paper's observer per sample: flexid, hand-written C, filterpy's extended Kalman filter.

The record is the noisy joint of the estimators' tests: 30 s at 1 kHz, seed 0, beta1 known.
"""

import subprocess
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tests.estimators.noisy_joint import (
    POSITION_NOISE,
    SAMPLE_TIME,
    TRUTH,
    VELOCITY_NOISE,
    joint_samples,
)

from benchmarks.c_observer import BUILDS, Replay, compile_replay
from benchmarks.comparison import AtLeast, AtMost, Comparison, Detail, Outcome, Side, duration
from benchmarks.timing import Timing, measure
from flexid.arrays import FloatArray
from flexid.estimators.online import packed
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.parametric_observer import (
    ParametricObserver,
    parametric_observer,
    suggest_gains,
)

if TYPE_CHECKING:
    from benchmarks.kalman import JointFilter

_SEED = 0
_STEPS = 1000  # single steps that are timed together
_UNKNOWN = ("theta1", "theta2", "alpha1", "alpha2")
_TRUE = np.array([TRUTH[name] for name in _UNKNOWN])


def run(quick: bool) -> Outcome:
    """Compare the replay of a log and single steps from Python.

    Parameters
    ----------
    quick : bool
        Use fewer repetitions.
    """
    system = flexible_joint(known={"beta1": TRUTH["beta1"]})
    record = joint_samples(_SEED)
    samples = packed(record)
    observer = parametric_observer(system, suggest_gains(record, system), SAMPLE_TIME)
    replays, builds = _replays(observer, samples, 20 if quick else 300)
    fastest = min(builds, key=lambda flags: builds[flags].median)
    comparisons = [
        Comparison(
            "observer over a log, per sample",
            Side("replay", replays),
            Side(f"C, gcc {' '.join(fastest)}", builds[fastest]),
            AtMost(1.1),
        )
    ]
    tables = [_builds_table(builds)]
    if find_spec("filterpy"):
        steps, kalman = _steps(observer, samples, 3 if quick else 15)
        peer = Side("filterpy EKF, 8 states", kalman)
        job, single = "observer over a log, per sample", "one step called from Python"
        comparisons += [
            Comparison(job, Side("replay", replays), peer, AtLeast(1000)),
            Comparison(single, Side("step", steps), peer, AtLeast(25)),
        ]
        tables.append(_fits_table(observer, samples))
    return Outcome(comparisons, tables)


def _replays(
    observer: ParametricObserver, samples: FloatArray, repetitions: int
) -> tuple[Timing, dict[tuple[str, ...], Timing]]:
    """Return the time per sample of flexid's replay and of every build of the C."""
    state = observer.init()
    with tempfile.TemporaryDirectory() as folder:
        compiled: list[Replay] = [
            compile_replay(
                flags, Path(folder), samples, SAMPLE_TIME, TRUTH["beta1"], observer.gains
            )
            for flags in BUILDS
        ]
        expected = observer.replay(state, samples)
        for replay in compiled:  # the comparison needs the same algorithm
            estimates, innovations = replay()
            np.testing.assert_allclose(estimates, expected.coefficients, rtol=1e-8)
            np.testing.assert_allclose(innovations, expected.innovations, rtol=1e-8, atol=1e-14)
        calls = [lambda: observer.replay(state, samples), *compiled]
        own, *others = (t.per(len(samples)) for t in measure(*calls, repetitions=repetitions))
    return own, dict(zip(BUILDS, others, strict=True))


def _steps(
    observer: ParametricObserver, samples: FloatArray, repetitions: int
) -> tuple[Timing, Timing]:
    """Return the time per sample of flexid's and filterpy's steps, one Python call each."""
    measured = np.ascontiguousarray(samples[1 : _STEPS + 1, :4])
    torques = _mean_torques(samples)

    def own() -> None:
        state = observer.init()
        for k in range(_STEPS):
            state, _ = observer.step(state, samples[k])

    def peer() -> None:
        kalman = _kalman()
        for k in range(_STEPS):
            kalman.advance(measured[k], torques[k])

    first, second = measure(own, peer, repetitions=repetitions)
    return first.per(_STEPS), second.per(_STEPS)


def _kalman() -> "JointFilter":
    from benchmarks.kalman import JointFilter

    return JointFilter(SAMPLE_TIME, TRUTH["beta1"], (POSITION_NOISE, VELOCITY_NOISE), 0.5 * _TRUE)


def _mean_torques(samples: FloatArray) -> list[float]:
    return (0.5 * (samples[1:, 4] + samples[:-1, 4])).tolist()


def _builds_table(builds: dict[tuple[str, ...], Timing]) -> Detail:
    version = subprocess.run(["gcc", "--version"], check=True, capture_output=True, text=True)
    return Detail(
        "Observer: ways to compile the C",
        ("gcc", "per sample"),
        [(" ".join(flags), duration(timing)) for flags, timing in builds.items()],
        f"{version.stdout.splitlines()[0]}. Every build gives flexid's estimates to eight digits "
        "or better; flexid and C fill newly allocated arrays at each call.",
    )


def _fits_table(observer: ParametricObserver, samples: FloatArray) -> Detail:
    """Return a table of both estimates, to check that the peer works."""
    kalman = _kalman()
    for measurement, torque in zip(samples[1:, :4], _mean_torques(samples), strict=True):
        kalman.advance(measurement, torque)
    estimates = observer.replay(observer.init(), samples).coefficients[-1]
    lines = [
        (
            name,
            *(
                f"{100 * (value / true - 1):+.3f} %"
                for value, true in zip(values, _TRUE, strict=True)
            ),
        )
        for name, values in (("flexid, observer", estimates), ("filterpy, EKF", kalman.x[4:]))
    ]
    return Detail(
        "Observer: errors at the end of the record",
        ("estimator", *_UNKNOWN),
        lines,
        "The filter knows the noise and starts from half of the true values; the observer knows "
        "neither and starts from zero.",
    )
