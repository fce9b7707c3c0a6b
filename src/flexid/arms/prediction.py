"""How much of an arm's motion a free run explains that was no part of the fit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexid.arms.disturbed import DisturbedFit, resonances, values_of
from flexid.arms.fitting import ArmFit, at_point
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.balance_motion import balance_motion
from flexid.estimators.gauss_newton import minimise
from flexid.estimators.innovations import predicting
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point
from flexid.estimators.segments import Segments, divide
from flexid.identification.structure.following import following_states
from flexid.models.torque_balance import TorqueBalance

SHARE = 1 / 3
"""Part of each recording, at its end, that is predicted."""

_WINDOW = 2.5  # s that a free run lasts, its start included
_START = 0.2  # part of that from which the first state is taken
_STEPS = 6
_WARM = 0.5  # s that an observer follows before a prediction over a period


def free_run(
    balance: TorqueBalance, recordings: Sequence[Samples], fit: ArmFit
) -> Mapping[str, float]:
    """Share of each channel, in per cent, over the end of the log, from a fit to its beginning.

    Runs start every 2.5 s; their first states are fitted to their first fifth, which does not
    count.
    """
    cuts = [round((1.0 - SHARE) * len(recording)) for recording in recordings]
    first = [_part(r, slice(0, cut)) for r, cut in zip(recordings, cuts, strict=True)]
    last = [_part(r, slice(cut, None)) for r, cut in zip(recordings, cuts, strict=True)]
    try:
        values = _values_of(balance, first, fit)
        windows = divide(last, _WINDOW)
    except (ConvergenceError, SettingError):
        return {}
    problem = fit.problem
    begun = np.maximum((_START * windows.lengths).astype(np.int64), 2)
    motion = balance_motion(balance, windows, problem.timing, problem.unknowns)
    motion = replace(motion, weights=problem.weights, substeps=problem.substeps)
    states = following_states(motion, values, replace(windows, lengths=begun))
    left = motion.equations(Point(values, states), "nothing").residuals
    return _shares(*_counted(windows.outputs, left, windows, begun))


def disturbed_run(disturbed: DisturbedFit) -> tuple[Mapping[str, float], dict[int, float]]:
    """The same where an observer follows the beginning of each run; and over a resonance's period.

    Returns the shares of `free_run`, and for each joint the share of its deflection.
    """
    job, found = disturbed.job, disturbed.found
    own = [job.thinned(recording) for recording in job.recordings]
    cuts = [round((1.0 - SHARE) * len(recording)) for recording in own]
    first = [_part(r, slice(0, round((1.0 - SHARE) * len(r)))) for r in job.recordings]
    last = [_part(r, slice(cut, None)) for r, cut in zip(own, cuts, strict=True)]
    try:
        values = replace(job, recordings=first).with_gains_of(found, values_of(found)).point.values
        whole = _observed(disturbed, values, last, _WINDOW, _START * _WINDOW)
        periods = {}
        for joint, period in enumerate(
            (2.0 * np.pi / resonances(job.balance, disturbed.values)), 1
        ):
            horizon = float(np.clip(period, 5.0 * own[0].sample_time, _WINDOW - _WARM))
            shares = _observed(disturbed, values, last, _WARM + horizon, _WARM)
            periods[joint] = shares[f"deflection_{joint}"]
    except (ConvergenceError, SettingError):
        return {}, {}
    return whole, periods


def _observed(
    disturbed: DisturbedFit,
    values: np.ndarray,
    recordings: Sequence[Samples],
    window: float,
    followed: float,
) -> dict[str, float]:
    """Shares over windows in s, of which an observer follows the first seconds."""
    problem = disturbed.found.problem
    windows = divide(recordings, window)
    begun = np.maximum((followed / windows.sample_times).astype(np.int64), 2)
    model = replace(problem, segments=windows)
    point = Point(values, model.start_states)
    undirected = np.zeros((0, windows.outputs.shape[1]))
    motion = predicting(model, point, undirected, disturbed.found.sizes, begun)
    left = motion.equations(point, "nothing").residuals
    return _shares(*_counted(motion.timely(values), left, windows, begun))


def _counted(
    measured: np.ndarray, left: np.ndarray, windows: Segments, begun: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The samples of each window that are predicted."""
    counted = np.zeros(len(left), dtype=np.bool_)
    for a, b, n in zip(windows.starts, begun, windows.lengths, strict=True):
        counted[a + b : a + n] = True
    return measured[counted], left[counted]


def _part(recording: Samples, part: slice) -> Samples:
    return replace(recording, positions=recording.positions[part], inputs=recording.inputs[part])


def _values_of(balance: TorqueBalance, recordings: Sequence[Samples], fit: ArmFit) -> np.ndarray:
    """What the beginning alone gives, from where the whole log led."""
    problem = fit.problem
    motion = balance_motion(
        balance, divide(recordings, fit.duration), problem.timing, problem.unknowns
    )
    point = Point(fit.minimum.point.values, motion.start_states)
    motion = at_point(motion, point, 1.0 / problem.weights)
    return minimise(motion, point, 0.1, insist=False, iterations=_STEPS).point.values


def _shares(measured: np.ndarray, left: np.ndarray) -> dict[str, float]:
    found = {}
    pick: dict[str, Callable[[np.ndarray, int], np.ndarray]] = {
        "motor": lambda x, i: x[:, 2 * i + 1],
        "link": lambda x, i: x[:, 2 * i],
        "deflection": lambda x, i: x[:, 2 * i] - x[:, 2 * i + 1],
    }
    for i in range(measured.shape[1] // 2):
        for name, of in pick.items():
            own = of(measured, i)
            spread = float(np.linalg.norm(own - own.mean()))
            off = float(np.linalg.norm(of(left, i)))
            found[f"{name}_{i + 1}"] = 100.0 * (1.0 - off / spread) if spread else float("nan")
    return found
