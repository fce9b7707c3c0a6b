"""Figures of an identification and of a validation."""

from os import PathLike
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.identification.vocabulary.intervals import CONFIDENCE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexid.identification.result.identification import Identification
    from flexid.library.logs import Columns, Logs
    from flexid.report.charts.description import Chart
    from flexid.stored_estimates.validate_estimate import EstimateValidation


def drawn(chart: "Chart", ax: "Axes | None" = None) -> "Figure":
    """A chart as a figure, or in the place of an axes of one."""
    from flexid.report.charts.figure import draw

    return draw(chart, ax=ax)


class EstimatePlots:
    """Figures of an estimate, which pyplot does not know, or drawn in the place of an `ax`."""

    def __init__(self, result: "Identification") -> None:
        self._result = result

    def fit(self, ax: "Axes | None" = None) -> "Figure":
        """Free run of the model over the data that were kept out of the fit."""
        from flexid.report.identification_charts import fit_chart

        self._need_series(bool(self._result.validation.runs))
        return drawn(fit_chart(self._result), ax)

    def residuals(self, ax: "Axes | None" = None) -> "Figure":
        """What is between measured and predicted held-out data, and how it correlates in time."""
        from flexid.report.free_run_chart import residual_chart

        self._need_series(bool(self._result.validation.runs))
        return drawn(residual_chart(self._result.validation), ax)

    def regions(self, *, level: float = CONFIDENCE, ax: "Axes | None" = None) -> "Figure":
        """Joint confidence regions of the coefficients of each row that correlate most."""
        from flexid.identification.vocabulary.intervals import checked_level
        from flexid.report.identification_charts import regions_chart

        chart = regions_chart(self._result, checked_level(level))
        if chart is None:
            raise SettingError("regions", "there are no two coefficients that were estimated")
        return drawn(chart, ax)

    def estimates(self, ax: "Axes | None" = None) -> "Figure":
        """The paper's observer over time, with the estimates and their intervals."""
        from flexid.report.identification_charts import estimates_chart

        self._need_series(len(self._result.observer.time) > 0)
        return drawn(estimates_chart(self._result), ax)

    def excitation(self, ax: "Axes | None" = None) -> "Figure":
        """How well the motion tells the coefficients of each row apart."""
        from flexid.report.identification_charts import excitation_chart

        return drawn(excitation_chart(self._result), ax)

    def bode(
        self,
        logs: "Logs | None" = None,
        *,
        columns: "Columns | None" = None,
        position: float | None = None,
        level: float = CONFIDENCE,
        ax: "Axes | None" = None,
    ) -> "Figure":
        """Frequency response of the joint with its confidence band, and what a log shows.

        Antiresonance and resonance are marked. The spectral estimate is that of the log that the
        estimate was made from, or of another; `JointEstimate.frequency_response` has the numbers.
        """
        from flexid.frequency.frequency_response import frequency_response
        from flexid.library.logs import all_recordings
        from flexid.report.bode_chart import bode_chart

        given = self._result.recordings if logs is None else all_recordings("bode", logs, columns)
        response = frequency_response(self._result, given, position=position, level=level)
        return drawn(bode_chart(response), ax)

    def save(self, directory: "str | PathLike[str]") -> None:
        """Write the figures that ``flexid identify --out`` writes."""
        from flexid.library.joint_estimate import JointEstimate

        self._need_series(bool(self._result.validation.runs))
        JointEstimate(self._result).save_figures(directory)

    def _need_series(self, there: bool) -> None:
        if not there:
            raise SettingError(
                "plot",
                "an estimate that was loaded holds no time series: draw those of a log by "
                "estimate.validate(log).plot",
            )


class ValidationPlots:
    """Figures of predictions, likewise."""

    def __init__(self, result: "EstimateValidation") -> None:
        self._result = result

    def fit(self, ax: "Axes | None" = None) -> "Figure":
        """Free run over each log, channel by channel, with the residual below."""
        from flexid.report.validation import fit_chart

        return drawn(fit_chart(self._result), ax)

    def residuals(self, ax: "Axes | None" = None) -> "Figure":
        """What is between measured and predicted motion, and how it correlates in time."""
        from flexid.report.free_run_chart import residual_chart

        return drawn(residual_chart(self._result), ax)
