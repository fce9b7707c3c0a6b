"""Tests of estimates: `flexid.validate` on other logs, `flexid.compare` on other estimates."""

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
    """How well, and over which horizons, an estimate predicts other logs.

    Returned by `flexid.validate` and `JointEstimate.validate`.
    """

    _report = "validation"
    _file = "validation.json"

    result: Validated
    fit_percent: Mapping[str, float]
    """Fit in per cent of the free run, by channel."""
    horizons: Mapping[float, Mapping[str, float]]
    """Fit in per cent of predictions over each horizon in s, by horizon and channel."""
    residuals: Mapping[float, Mapping[str, float]]
    """RMS prediction error in rad or m by horizon and channel; horizon inf is the free run."""
    noise: Mapping[str, float]
    """Standard deviation of the sensor noise in rad or m, by channel."""

    def supports(self, min_fit: float | None = None) -> bool:
        """Return whether the free run reaches the required fit in every channel that moves.

        Parameters
        ----------
        min_fit : float, optional
            Required fit of the free run in per cent; by default any fit passes.
        """
        moving = [fit for fit in self.fit_percent.values() if not isnan(fit)]
        return min_fit is None or (bool(moving) and min(moving) >= min_fit)

    @property
    def series(self) -> Mapping[str, NDArray[np.float64]]:
        """Free runs as arrays: time in s, each channel in rad or m, measured and predicted.

        Several recordings are concatenated.
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

    Only the initial state of each prediction is fitted, to the half second before it. Predictions
    over 0.05, 0.2, 1 and 5 s begin at regular times in each log, and one free run covers the log.

    Parameters
    ----------
    estimate : JointEstimate, path or mapping
        An estimate.json of flexid identify, or its folder. Or a result of `flexid.identify`, or
        the content of a file.
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
        raise SettingError("logs", "of an arm and their column map must be files: give paths")
    return EstimateValidation(validate_arm(stored, paths, Path(columns) if columns else None))


class EstimateComparison(Answer):
    """Differences between two estimates, and whether they are beyond chance.

    Returned by `flexid.compare`.
    """

    _report = "comparison"
    _file = "comparison.json"

    result: Comparison
    parameters: Mapping[str, Difference]
    """Parameters of either estimate by name, each with difference, interval and outcome."""
    coefficients: Mapping[str, Difference]
    """Lumped coefficients by name, with the same fields; empty if their meaning differs."""
    agree: bool
    """Whether everything was compared, and no change was found."""

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of changed values, corrected for the number of comparisons."""
        return tuple(d.name for d in self.result.having("changed", "contradictory"))

    def __repr__(self) -> str:
        compared = sum(d.compared for d in self.result.decisive.values())
        changed = ", ".join(self.changed) or "none"
        return f"<EstimateComparison: {compared} compared, changed: {changed}>"


@entrance
def compare(
    a: JointEstimate | FilePath | Mapping[str, Any], b: JointEstimate | FilePath | Mapping[str, Any]
) -> EstimateComparison:
    """Compare two estimates: what has changed, and how certainly.

    For example before and after a repair, two drives of a batch, or two settings on one log. Each
    difference is B's value minus A's, with a 95 % interval. Values called changed differ beyond
    chance, also after correction for the number of comparisons.

    Parameters
    ----------
    a, b : JointEstimate, path or mapping
        An estimate.json of flexid identify, or its folder. Or a result of `flexid.identify`, or
        the content of a file.
    """
    from flexid.stored_estimates.comparison import compare_estimates

    first, second = estimated(a), estimated(b)
    labels = (first.file or "A", second.file or "B")
    return EstimateComparison(compare_estimates(first.result, second.result, labels))
