"""Figures of a validation."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexid.stored_estimates.validate_estimate import EstimateValidation


class ValidationPlots:
    """Figures of predictions, each a Matplotlib figure that pyplot knows nothing of.

    Parameters
    ----------
    result : EstimateValidation
        What is drawn.
    """

    def __init__(self, result: "EstimateValidation") -> None:
        self._result = result

    def fit(self) -> "Figure":
        """Free run over each log, channel by channel, with the residual below."""
        from flexid.report.charts.figure import draw
        from flexid.report.validation_chart import validation_chart

        return draw(validation_chart(self._result))

    def residuals(self) -> "Figure":
        """What is between measured and predicted motion, and how it correlates in time."""
        from flexid.report.charts.figure import draw
        from flexid.report.residual_chart import residual_chart

        return draw(residual_chart(self._result))
