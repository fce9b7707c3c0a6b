"""Compared tools, each as a function of a trial; a tool is imported when it is used."""

import tempfile
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.rivals.given import Answer, given
from benchmarks.trials.generate import Trial, make_trial
from benchmarks.trials.plain_least_squares import plain_least_squares
from benchmarks.trials.score import CORE

FAMILIES = ("basic", "coulomb", "both_delays", "lugre")
"""Families whose terms every tool supports: gravity and frictions."""


@dataclass(frozen=True)
class Tool:
    """One tool of the tables.

    Parameters
    ----------
    title : str
    package : str
        Package that must be installed.
    given : str
        Values that the user gives in addition to the log.
    identify : callable
        Function that returns the physical parameters of a trial.
    """

    title: str
    package: str
    given: str
    identify: Callable[[Trial], Answer]


def _flexid(trial: Trial) -> Answer:
    from flexid.identification.identify import identify
    from flexid.recording.read import read_log

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        trial.write_csv(path)
        found = identify([read_log(path)]).parameters
    return Answer(
        {name: estimate.value for name, estimate in found.items()},
        {name: estimate.interval for name, estimate in found.items()},
    )


def _least_squares(trial: Trial) -> Answer:
    return Answer(plain_least_squares(trial))


def _pysindy(trial: Trial) -> Answer:
    from benchmarks.rivals.pysindy_trial import identify

    return identify(given(trial), weak=False)


def _pysindy_weak(trial: Trial) -> Answer:
    from benchmarks.rivals.pysindy_trial import identify

    return identify(given(trial), weak=True)


def _mujoco(trial: Trial) -> Answer:
    from benchmarks.rivals.mujoco_trial import identify

    return identify(given(trial))


_STRUCTURE = "terms, delays, hold, resonance"

TOOLS: Mapping[str, Tool] = {
    "flexid": Tool("flexid identify", "flexid", "nothing", _flexid),
    "least_squares": Tool("NumPy least squares", "numpy", _STRUCTURE, _least_squares),
    "pysindy": Tool("PySINDy, smoothed derivatives", "pysindy", _STRUCTURE, _pysindy),
    "pysindy_weak": Tool("PySINDy, weak form", "pysindy", _STRUCTURE, _pysindy_weak),
    "mujoco": Tool("MuJoCo sysid", "mujoco", f"{_STRUCTURE}, start by least squares", _mujoco),
}
"""Tools by their name on the command line."""


def record(key: str, family: str, seed: int) -> dict[str, Any]:
    """Run one tool on one log and return its errors, ready for JSON.

    Returns
    -------
    dict
        ``errors`` of the drive's core parameters in per cent of the truth. With intervals:
        ``inside``, whether they contain the truth, and ``widest``, the largest half-width in per
        cent. ``seconds``: processor time. ``failed`` instead, if there is no result.
    """
    trial = make_trial(family, seed)
    about = {"tool": key, "family": family, "seed": seed}
    start = time.process_time()
    try:
        with warnings.catch_warnings(action="ignore"):
            answer = TOOLS[key].identify(trial)
    except Exception as error:  # any failure of a tool is a result
        return about | {"failed": f"{type(error).__name__}: {error}"[:200]}
    seconds = time.process_time() - start
    return about | {"seconds": _short(seconds)} | score(answer, trial.truth)


def score(answer: Answer, truth: Mapping[str, float]) -> dict[str, Any]:
    """Return the errors and intervals of a result."""
    core = [name for name in CORE if truth.get(name)]
    errors = {name: 100.0 * (answer.values[name] / truth[name] - 1.0) for name in core}
    found: dict[str, Any] = {"errors": {name: _short(e) for name, e in errors.items()}}
    if answer.intervals is not None:
        ends = {name: answer.intervals[name] for name in core}
        inside = {name: bool(low <= truth[name] <= high) for name, (low, high) in ends.items()}
        widths = [50.0 * (high - low) / truth[name] for name, (low, high) in ends.items()]
        found |= {"inside": inside, "widest": _short(max(widths))}
    return found


def _short(value: float) -> float:
    return float(f"{value:.4g}")
