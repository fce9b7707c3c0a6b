"""Figures of an identification and of a validation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexid.errors import SettingError
from flexid.frequency.frequency_response import frequency_response
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.intervals import CONFIDENCE, checked_level
from flexid.library.arguments import entrance
from flexid.library.logs import all_recordings
from flexid.report import validation
from flexid.report.figure import draw
from flexid.report.identification_charts import (
    estimates_chart,
    excitation_chart,
    fit_chart,
    regions_chart,
)
from flexid.report.response_charts import bode_chart, residual_chart
from flexid.stored_estimates.validate_estimate import EstimateValidation

if TYPE_CHECKING:
    from flexid.library.logs import Columns, Logs


class EstimatePlots:
    """Figures of an estimate, which pyplot does not know, or drawn in the place of an `ax`."""

    def __init__(self, result: Identification) -> None:
        self._result = result

    def fit(self, ax: Axes | None = None) -> Figure:
        """Free run of the model over the data that were kept out of the fit."""
        _need_series(bool(self._result.validation.runs))
        return draw(fit_chart(self._result), ax=ax)

    def residuals(self, ax: Axes | None = None) -> Figure:
        """What is between measured and predicted held-out data, and how it correlates in time."""
        _need_series(bool(self._result.validation.runs))
        return draw(residual_chart(self._result.validation), ax=ax)

    def regions(self, *, level: float = CONFIDENCE, ax: Axes | None = None) -> Figure:
        """Joint confidence regions of the coefficients of each row that correlate most."""
        chart = regions_chart(self._result, checked_level(level))
        if chart is None:
            raise SettingError("regions", "there are no two coefficients that were estimated")
        return draw(chart, ax=ax)

    def estimates(self, ax: Axes | None = None) -> Figure:
        """The paper's observer over time, with the estimates and their intervals."""
        _need_series(len(self._result.observer.time) > 0)
        return draw(estimates_chart(self._result), ax=ax)

    def excitation(self, ax: Axes | None = None) -> Figure:
        """How well the motion tells the coefficients of each row apart."""
        return draw(excitation_chart(self._result), ax=ax)

    @entrance
    def bode(
        self,
        logs: Logs | None = None,
        *,
        columns: Columns | None = None,
        position: float | None = None,
        level: float = CONFIDENCE,
        ax: Axes | None = None,
    ) -> Figure:
        """Frequency response of the joint with its confidence band, and what a log shows.

        Antiresonance and resonance are marked. The spectral estimate is that of the log that the
        estimate was made from, or of another; `JointEstimate.frequency_response` has the numbers.
        """
        given = self._result.recordings if logs is None else all_recordings(logs, columns)
        response = frequency_response(self._result, given, position=position, level=level)
        return draw(bode_chart(response), ax=ax)


def _need_series(there: bool) -> None:
    if not there:
        raise SettingError(
            "plot",
            "an estimate that was loaded holds no time series: draw those of a log by "
            "estimate.validate(log).plot",
        )


class ValidationPlots:
    """Figures of predictions, likewise."""

    def __init__(self, result: EstimateValidation) -> None:
        self._result = result

    def fit(self, ax: Axes | None = None) -> Figure:
        """Free run over each log, channel by channel, with the residual below."""
        return draw(validation.fit_chart(self._result), ax=ax)

    def residuals(self, ax: Axes | None = None) -> Figure:
        """What is between measured and predicted motion, and how it correlates in time."""
        return draw(residual_chart(self._result), ax=ax)
