"""A validation as tables, JSON and figures."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf, isfinite, isinf, isnan
from typing import Any

from flexid.arrays import plain
from flexid.identification.judgement import WEAK_FIT
from flexid.identification.structure.validation import HORIZONS
from flexid.identification.vocabulary.evidence import Validation
from flexid.models.motion import unit_of
from flexid.report.chart import Chart
from flexid.report.page import logs_of
from flexid.report.response_charts import free_run_chart, residual_chart
from flexid.report.terminal import Part, Table, number, numbers
from flexid.stored_estimates.estimate_file import drive_of
from flexid.stored_estimates.validate_estimate import EstimateValidation


def parts(result: EstimateValidation) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    yield fits_table(result)
    units = " or ".join(dict.fromkeys(unit_of("rad", joint_type) for joint_type in result.types))
    columns = ("channel", *numbers("sensor noise", *map(_horizon, result.residuals)))
    errors = Table(f"Prediction error by horizon ({units}, RMS)", columns)
    for channel, noise in result.noise.items():
        off = (found[channel] for found in result.residuals.values())
        errors.add(channel, number(noise, 3), *(number(x, 3) if isfinite(x) else "–" for x in off))
    yield errors
    moving = {channel: fit for channel, fit in result.fit_percent.items() if not isnan(fit)}
    worst = min(moving, key=lambda channel: moving[channel], default="")
    if worst and not moving[worst] >= WEAK_FIT:
        yield _poor_free_run(result, worst)
    count = len(result.runs)
    yield (
        f"{count} recording{'s' if count > 1 else ''} of {_drive(result)}. The initial state of "
        f"each prediction is fitted to the half second before it."
    )


def _poor_free_run(result: EstimateValidation, worst: str) -> str:
    """Return a sentence on a poor free run; good short predictions excuse a long log."""
    fit, longest = result.fit_percent[worst], HORIZONS[-1]
    poor = f"has a fit of {fit:.3g} % to {worst}" if isfinite(fit) else f"diverges in {worst}"
    predicted = result.horizons.get(longest, {}).values()
    if predicted and not any(found < WEAK_FIT for found in predicted):
        return (
            f"The free run {poor}, because small errors add up over the log: judge the "
            f"estimate by its predictions over {longest:g} s."
        )
    return (
        f"The estimate does not describe this drive: the free run {poor}. Identify these "
        f"logs, and compare both estimates."
    )


def fits_table(result: Validation) -> Table:
    """Return the fit of each channel by prediction horizon."""
    fits = {**result.horizons, inf: result.fit_percent}
    rows = ((c, *(_fit(found[c]) for found in fits.values())) for c in result.fit_percent)
    columns = ("channel", *numbers(*map(_horizon, fits)))
    return Table("Prediction fit by horizon (%)", columns, rows)


def _drive(result: EstimateValidation) -> str:
    return drive_of(result.model) + (" (prismatic)" if "revolute" not in result.types else "")


def _horizon(horizon: float) -> str:
    return "free run" if isinf(horizon) else f"{horizon:g} s"


def _fit(fit: float) -> str:
    if isnan(fit):
        return "at rest"
    if not isfinite(fit):
        return "diverges"
    return f"{fit:.2f}" if fit > -1000.0 else number(fit, 3)


def heading(result: EstimateValidation) -> tuple[str, str]:
    """Return the kind of drive, and the files."""
    return f"Estimate of {_drive(result)}, tested on other logs", logs_of(result.provenance)


def charts(result: EstimateValidation) -> tuple[Chart, Chart]:
    """Return the free run over each log, channel by channel, and its residuals."""
    title = "Free run of the estimate over other logs"
    free_run = free_run_chart("validation", title, result, result.noise, result.types)
    return free_run, residual_chart(result, result.types)


def document(result: EstimateValidation) -> dict[str, Any]:
    """Return fits and residuals, for JSON."""
    made = plain(replace(result, runs=()))
    del made["runs"]
    return made
