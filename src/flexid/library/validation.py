"""A stored estimate, or one at hand, on other logs."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan
from os import PathLike
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexid.library.answer import ReportedAnswer, TabularAnswer, data_frame
from flexid.library.entrance import as_path, entrance, in_one_thread
from flexid.library.estimates import estimate_content

if TYPE_CHECKING:
    from flexid.identification.vocabulary.evidence import Validation
    from flexid.library.estimate_plots import ValidationPlots
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns, Logs
    from flexid.stored_estimates.validate_estimate import EstimateValidation as Validated


@dataclass(frozen=True, eq=False)
class Prediction:
    """Motion that a model predicts from the input, beside what was measured.

    Parameters
    ----------
    time : array, shape (n,)
        Seconds on the log's clock; recordings of a log with gaps follow each other.
    measured, predicted : mapping of str to array, shape (n,)
        By channel, in rad.
    fit_percent : mapping of str to float
        100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) by channel.
    """

    time: NDArray[np.float64]
    measured: Mapping[str, NDArray[np.float64]]
    predicted: Mapping[str, NDArray[np.float64]]
    fit_percent: Mapping[str, float]

    @classmethod
    def of(cls, found: "Validation") -> "Prediction":
        """The free runs of a validation as one."""
        channels = tuple(found.fit_percent)
        measured = np.concatenate([run.measured for run in found.runs])
        predicted = np.concatenate([run.simulated for run in found.runs])
        return cls(
            np.concatenate([run.time for run in found.runs]),
            dict(zip(channels, measured.T, strict=True)),
            dict(zip(channels, predicted.T, strict=True)),
            found.fit_percent,
        )

    def to_dataframe(self, backend: str = "polars") -> Any:
        """Time, and each channel measured and predicted, as a data frame.

        Parameters
        ----------
        backend : {"polars", "pandas", "pyarrow"}, optional
            Whose data frame; the library has to be installed.
        """
        columns = {"time": self.time}
        for channel in self.measured:
            columns[channel] = self.measured[channel]
            columns[f"predicted_{channel}"] = self.predicted[channel]
        return data_frame(columns, backend)


class EstimateValidation(ReportedAnswer, TabularAnswer):
    """How well, and for how long, an estimate predicts logs that it was not made from.

    `flexid.validate` and `JointEstimate.validate` return one. As a data frame it has a row for each
    channel and horizon in s, infinite for the free run, with the columns channel, horizon,
    fit_percent, residual and noise, the last two in rad.

    Parameters
    ----------
    result : EstimateValidation of flexid.identification
        What was found.
    """

    _report = "validation"
    _file = "validation.json"

    def __init__(self, result: "Validated") -> None:
        self.result = result

    @property
    def fit_percent(self) -> Mapping[str, float]:
        """By channel, how much of the motion a free run repeats, in per cent."""
        return MappingProxyType(self.result.fit_percent)

    @property
    def horizons(self) -> Mapping[float, Mapping[str, float]]:
        """The same for predictions that begin anew every so many seconds."""
        return MappingProxyType(self.result.horizons)

    @property
    def residuals(self) -> Mapping[float, Mapping[str, float]]:
        """Root mean square of what each channel is off in rad, by horizon; inf for the free run."""
        return MappingProxyType(self.result.residuals)

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviation of each channel's noise in rad."""
        return MappingProxyType(self.result.noise)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What limits the test."""
        return self.result.warnings

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
    def plot(self) -> "ValidationPlots":
        """Figures: ``plot.fit()`` and ``plot.residuals()``."""
        from flexid.library.estimate_plots import ValidationPlots

        return ValidationPlots(self.result)

    def _columns(self) -> Mapping[str, Any]:
        fits = {**self.horizons, float("inf"): self.fit_percent}
        pairs = [(channel, horizon) for horizon in fits for channel in self.noise]
        return {
            "channel": [channel for channel, _ in pairs],
            "horizon": [horizon for _, horizon in pairs],
            "fit_percent": [fits[horizon][channel] for channel, horizon in pairs],
            "residual": [self.residuals[horizon][channel] for channel, horizon in pairs],
            "noise": [self.noise[channel] for channel, _ in pairs],
        }

    def __repr__(self) -> str:
        fits = ", ".join(f"{channel} {fit:.1f} %" for channel, fit in self.fit_percent.items())
        return f"<EstimateValidation: free run {fits}>"


@entrance
@in_one_thread
def validate(
    estimate: "JointEstimate | str | PathLike[str] | Mapping[str, Any]",
    logs: "Logs",
    *,
    columns: "Columns | None" = None,
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

    Returns
    -------
    EstimateValidation
        Fits and residuals by horizon.

    Raises
    ------
    SettingError
        If the estimate cannot be read, or is none of a joint of flexid.
    RecordingError
        If the logs do not go together or with the estimate, or are too short.
    ArgumentError
        If an argument is of a wrong type.
    """
    from flexid.library.logs import all_logs
    from flexid.stored_estimates.estimate_file import read_estimate, stored_estimate
    from flexid.stored_estimates.validate_arm import validate_arm
    from flexid.stored_estimates.validate_estimate import validate_estimate

    file = read_estimate(estimate_content("validate", "estimate", estimate))
    stored = stored_estimate(file)
    if stored.model != "arm":
        read = all_logs("validate", logs, columns)
        return EstimateValidation(validate_estimate(file, read))
    several = logs if isinstance(logs, list | tuple) else [logs]
    paths = [as_path("validate", "logs", log) for log in several]
    given = None if columns is None else as_path("validate", "columns", columns)
    return EstimateValidation(validate_arm(file, stored, paths, given))
