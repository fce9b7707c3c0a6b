"""Figures of an identification."""

from os import PathLike
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.identification.intervals import CONFIDENCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexid.identification.result import Identification


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
        from flexid.report.identification_figures import fit_figure
        from flexid.report.style import styled

        self._need_series(bool(self._result.validation.runs))
        return styled(fit_figure)(self._result)

    def residuals(self) -> "Figure":
        """What is between measured and predicted held-out data, and how it correlates in time.

        Raises
        ------
        SettingError
            If the estimate was loaded: a file holds no time series.
        """
        from flexid.report.residual_figures import residual_figure

        self._need_series(bool(self._result.validation.runs))
        return residual_figure(self._result.validation)

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
        from flexid.identification.intervals import checked_level
        from flexid.report.identification_figures import regions_figure

        figure = regions_figure(self._result, checked_level(level))
        if figure is None:
            raise SettingError("regions", "there are no two coefficients that were estimated")
        return figure

    def estimates(self) -> "Figure":
        """The paper's observer over time, beside the estimates and their intervals.

        Raises
        ------
        SettingError
            If the estimate was loaded: a file holds no time series.
        """
        from flexid.report.identification_figures import estimates_figure
        from flexid.report.style import styled

        self._need_series(len(self._result.observer.time) > 0)
        return styled(estimates_figure)(self._result)

    def excitation(self) -> "Figure":
        """How well the motion tells the coefficients of each row apart."""
        from flexid.report.identification_figures import excitation_figure
        from flexid.report.style import styled

        return styled(excitation_figure)(self._result)

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
        from flexid.report.documents import output_directory
        from flexid.report.identification_figures import save_identification_figures

        self._need_series(bool(self._result.validation.runs))
        with output_directory(as_path("save", "directory", directory)) as files:
            save_identification_figures(self._result, files)

    def _need_series(self, there: bool) -> None:
        if not there:
            raise SettingError(
                "plot",
                "an estimate that was loaded holds no time series: draw those of a log by "
                "estimate.validate(log).plot",
            )
