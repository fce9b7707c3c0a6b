"""The charts of an identification: free run, residuals, frequency response."""

from collections.abc import Sequence

import numpy as np

from flexid.frequency.frequency_response import frequency_response
from flexid.identification.result.identification import Identification
from flexid.report.chart import Chart
from flexid.report.response_charts import bode_chart, free_run_chart, residual_chart


def identification_charts(result: Identification) -> Sequence[Chart]:
    """All that the result has the data for: a loaded one has no time series."""
    bode = bode_chart(frequency_response(result, result.recordings))
    if not result.validation.runs:
        return (bode,)
    return fit_chart(result), residual_chart(result.validation), bode


def fit_chart(result: Identification) -> Chart:
    """Free run of the model over the held-out data, channel by channel, and its residual."""
    deviation = result.compliance.deflection_noise
    flexible = result.model == "flexible"  # a link's deflection has no noise of the motor's encoder
    noise = {"deflection": deviation} if flexible and 0.0 < deviation < np.inf else {}
    title = "Free run of the model over data kept out of the fit"
    return free_run_chart("fit", title, result.validation, noise)
