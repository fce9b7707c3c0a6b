"""Figures of an identification."""

from os import PathLike
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.identification.vocabulary.intervals import CONFIDENCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexid.identification.result.identification import Identification
    from flexid.library.logs import Columns, Logs


class EstimatePlots:
    """Figures of an estimate, each a Matplotlib figure that pyplot knows nothing of.

    Parameters
    ----------
    result : Identification
        What is drawn.
    """

    def __init__(self, result: "Identification") -> None:
        self._result = result

    def fit(self) -> "Figure":
        """Free run of the model over the data that were kept out of the fit.

        Raises
        ------
        SettingError
            If the estimate was loaded: a file holds no time series.
        """
        from flexid.report.charts.figure import draw
        from flexid.report.identification_charts import fit_chart

        self._need_series(bool(self._result.validation.runs))
        return draw(fit_chart(self._result))

    def residuals(self) -> "Figure":
        """What is between measured and predicted held-out data, and how it correlates in time.

        Raises
        ------
        SettingError
            If the estimate was loaded: a file holds no time series.
        """
        from flexid.report.charts.figure import draw
        from flexid.report.residual_chart import residual_chart

        self._need_series(bool(self._result.validation.runs))
        return draw(residual_chart(self._result.validation))

    def regions(self, *, level: float = CONFIDENCE) -> "Figure":
        """Joint confidence regions of the coefficients of each row that correlate most.

        Parameters
        ----------
        level : float, optional
            Nominal coverage.

        Raises
        ------
        SettingError
            If no two coefficients were estimated.
        """
        from flexid.identification.vocabulary.intervals import checked_level
        from flexid.report.charts.figure import draw
        from flexid.report.regions_chart import regions_chart

        chart = regions_chart(self._result, checked_level(level))
        if chart is None:
            raise SettingError("regions", "there are no two coefficients that were estimated")
        return draw(chart)

    def estimates(self) -> "Figure":
        """The paper's observer over time, beside the estimates and their intervals.

        Raises
        ------
        SettingError
            If the estimate was loaded: a file holds no time series.
        """
        from flexid.report.charts.figure import draw
        from flexid.report.estimates_chart import estimates_chart

        self._need_series(len(self._result.observer.time) > 0)
        return draw(estimates_chart(self._result))

    def excitation(self) -> "Figure":
        """How well the motion tells the coefficients of each row apart."""
        from flexid.report.charts.figure import draw
        from flexid.report.identification_charts import excitation_chart

        return draw(excitation_chart(self._result))

    def bode(
        self,
        logs: "Logs | None" = None,
        *,
        columns: "Columns | None" = None,
        position: float | None = None,
        level: float = CONFIDENCE,
    ) -> "Figure":
        """Frequency response of the joint with its confidence band, beside what a log shows.

        Antiresonance and resonance are marked. The spectral estimate is that of the log that the
        estimate was made from, or of another; `JointEstimate.frequency_response` has the numbers.

        Parameters
        ----------
        logs : log or list of logs, optional
            As `flexid.read_log` takes them.
        columns : path, optional
            A TOML column map for raw sensor columns.
        position : float, optional
            Angle in rad about which link and motor move; where gravity has no torque, if not given.
        level : float, optional
            Nominal coverage of the band, at each frequency for itself.

        Raises
        ------
        SettingError
            If the level or the position is none.
        RecordingError
            If a log cannot be used.
        """
        from flexid.frequency.frequency_response import frequency_response
        from flexid.library.logs import all_recordings
        from flexid.report.bode_chart import bode_chart
        from flexid.report.charts.figure import draw

        given = self._result.recordings if logs is None else all_recordings("bode", logs, columns)
        response = frequency_response(self._result, given, position=position, level=level)
        return draw(bode_chart(response))

    def save(self, directory: "str | PathLike[str]") -> None:
        """Write the figures that ``flexid identify --out`` writes.

        Parameters
        ----------
        directory : path
            Where they go; made if it is not there.

        Raises
        ------
        SettingError
            If it cannot be written, or the estimate was loaded.
        """
        from flexid.library.checks import as_path
        from flexid.report.charts.figure import save_charts
        from flexid.report.documents import output_directory
        from flexid.report.identification_charts import identification_charts

        self._need_series(bool(self._result.validation.runs))
        with output_directory(as_path("save", "directory", directory)) as files:
            save_charts(identification_charts(self._result), files)

    def _need_series(self, there: bool) -> None:
        if not there:
            raise SettingError(
                "plot",
                "an estimate that was loaded holds no time series: draw those of a log by "
                "estimate.validate(log).plot",
            )
