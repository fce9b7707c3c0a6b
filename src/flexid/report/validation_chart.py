"""Chart of a validation: measured and predicted motion, and what is between them."""

from flexid.report.charts.description import Chart
from flexid.report.free_run_chart import free_run_chart
from flexid.stored_estimates.validate_estimate import EstimateValidation


def validation_chart(result: EstimateValidation) -> Chart:
    """Free run over each log, channel by channel, with the residual below."""
    title = "Free run of the estimate over other logs"
    return free_run_chart("validation", title, result, result.noise, "time")
