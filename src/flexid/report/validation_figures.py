"""Figure of a validation: measured and predicted motion, and what is between them."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from flexid.identification.validate_estimate import EstimateValidation
from flexid.report.free_run_figure import free_run_figure
from flexid.report.style import STYLE, save


def save_validation_figure(result: EstimateValidation, directory: Path) -> None:
    """Write validation.png."""
    with mpl.rc_context(STYLE):
        save(validation_figure(result), directory, "validation")


def validation_figure(result: EstimateValidation) -> Figure:
    """Free run over each log, channel by channel, with the residual below."""
    return free_run_figure(result.fit_percent, result.runs, result.noise, "time (s)")
