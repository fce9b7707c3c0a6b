"""A log as a model predicts it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexid.library.answer import data_frame

if TYPE_CHECKING:
    from flexid.identification.vocabulary.evidence import Validation


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
