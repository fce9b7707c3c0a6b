"""Estimates tested: on other logs, `flexid.validate`, and side by side, `flexid.compare`."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexid.errors import SettingError
from flexid.library.answer import Answer
from flexid.library.arguments import entrance, one_thread
from flexid.library.identify import estimated

if TYPE_CHECKING:
    from flexid.library.arguments import FilePath
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns, Logs
    from flexid.stored_estimates.comparison import Comparison, Difference
    from flexid.stored_estimates.validate_estimate import EstimateValidation as Validated


class EstimateValidation(Answer):
    """How well, and for how long, an estimate predicts logs that it was not made from.

    `flexid.validate` and `JointEstimate.validate` return one.
    """

    _report = "validation"
    _file = "validation.json"

    result: Validated
    fit_percent: Mapping[str, float]
    """By channel, how much of the motion a free run repeats, in per cent."""
    horizons: Mapping[float, Mapping[str, float]]
    """The same for predictions that begin again every so many seconds."""
    residuals: Mapping[float, Mapping[str, float]]
    """Root mean square of each channel's error in rad or m, by horizon; inf for the free run."""
    noise: Mapping[str, float]
    """Standard deviation of each channel's noise in rad or m."""

    def supports(self, min_fit: float | None = None) -> bool:
        """Whether the free run explains enough of every channel that moves.

        Parameters
        ----------
        min_fit : float, optional
            Least fit in per cent of the free run; any will do if not given.
        """
        moving = [fit for fit in self.fit_percent.values() if not isnan(fit)]
        return min_fit is None or (bool(moving) and min(moving) >= min_fit)

    @property
    def series(self) -> Mapping[str, NDArray[np.float64]]:
        """The free runs: time in s, and each channel in rad or m, measured and predicted.

        Recordings of a log with gaps follow each other.
        """
        runs = self.result.runs
        found = {"time": np.concatenate([run.time for run in runs])}
        for place, channel in enumerate(self.fit_percent):
            found[channel] = np.concatenate([run.measured[:, place] for run in runs])
            found[f"predicted_{channel}"] = np.concatenate([r.simulated[:, place] for r in runs])
        return found

    def __repr__(self) -> str:
        fits = ", ".join(f"{channel} {fit:.1f} %" for channel, fit in self.fit_percent.items())
        return f"<EstimateValidation: free run {fits}>"


@entrance
@one_thread()
def validate(
    estimate: JointEstimate | FilePath | Mapping[str, Any],
    logs: Logs,
    *,
    columns: Columns | None = None,
) -> EstimateValidation:
    """Predict other logs of the same drive with an estimate.

    Nothing is fitted but the state at the start of each prediction, which is taken from the half
    second before it. Predictions begin all over each log, for 0.05, 0.2, 1 and 5 s, and once for
    all of it.

    Parameters
    ----------
    estimate : JointEstimate, path or mapping
        An estimate.json of flexid identify, or the folder that holds it. Or what `flexid.identify`
        returned, or the content of a file.
    logs : log or list of logs
        Logs of the same drive, with the same kind of input. As `flexid.read_log` takes them; of an
        arm, paths.
    columns : path or mapping, optional
        A column map for raw sensor columns. As `flexid.identify` takes it.
    """
    from flexid.library.logs import all_logs
    from flexid.stored_estimates.validate_estimate import validate_arm, validate_estimate

    stored = estimated(estimate)
    if stored.result.model != "arm":
        return EstimateValidation(validate_estimate(stored, all_logs(logs, columns)))
    several = logs if isinstance(logs, list) else [logs]
    paths = [Path(log) for log in several if isinstance(log, str | PathLike)]
    if len(paths) < len(several) or isinstance(columns, Mapping):
        raise SettingError("logs", "of an arm are files, and so is their column map: give paths")
    return EstimateValidation(validate_arm(stored, paths, Path(columns) if columns else None))


class EstimateComparison(Answer):
    """What differs between two estimates, and whether chance explains it.

    `flexid.compare` returns one.
    """

    _report = "comparison"
    _file = "comparison.json"

    result: Comparison
    parameters: Mapping[str, Difference]
    """By name, each parameter of either estimate: difference, interval and outcome."""
    coefficients: Mapping[str, Difference]
    """Lumped coefficients of the model by name, likewise; none if their meaning differs."""
    agree: bool
    """Whether all that is in both drives was compared, and no change is established."""

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of what has changed, however much is compared."""
        return tuple(d.name for d in self.result.having("changed", "contradictory"))

    def __repr__(self) -> str:
        compared = sum(d.compared for d in self.result.decisive.values())
        changed = ", ".join(self.changed) or "none"
        return f"<EstimateComparison: {compared} compared, changed: {changed}>"


@entrance
def compare(
    a: JointEstimate | FilePath | Mapping[str, Any], b: JointEstimate | FilePath | Mapping[str, Any]
) -> EstimateComparison:
    """Compare two estimates: what has changed, and how surely.

    Before and after a repair, two drives of a batch, two settings on one log. Each difference is
    B's value minus A's, with a 95 % interval; what is called changed is so beyond chance, however
    many numbers are compared.

    Parameters
    ----------
    a, b : JointEstimate, path or mapping
        An estimate.json of flexid identify, or the folder that holds it. Or what `flexid.identify`
        returned, or the content of a file.
    """
    from flexid.stored_estimates.comparison import compare_estimates

    first, second = estimated(a), estimated(b)
    labels = (first.file or "A", second.file or "B")
    return EstimateComparison(compare_estimates(first.result, second.result, labels))
