"""The printed answer of a validation."""

from collections.abc import Iterator
from math import inf, isfinite, isinf, isnan

from rich.text import Text

from flexid.identification.judgement.compliance import WEAK_FIT
from flexid.report.terminal import Cell, Column, Part, Table, number, numbers
from flexid.stored_estimates.validate_estimate import EstimateValidation


def validation_parts(result: EstimateValidation) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield fits_table(result)
    yield from errors_parts(result)


def fits_table(result: EstimateValidation) -> Table:
    """How much of each channel is predicted, by horizon."""
    fits = {**result.horizons, inf: result.fit_percent}
    columns = (Column("channel"), *numbers(*map(_horizon, fits)))
    table = Table("Fit of predictions over so long a time (%)", columns)
    for channel in result.fit_percent:
        table.add(channel, *(_fit(found[channel]) for found in fits.values()))
    return table


def errors_parts(result: EstimateValidation) -> Iterator[Part]:
    """What the predictions are off, and what they begin with."""
    columns = (Column("channel"), *numbers("sensor's noise", *map(_horizon, result.residuals)))
    table = Table("What they are off (rad, root mean square)", columns)
    for channel, noise in result.noise.items():
        off = (found[channel] for found in result.residuals.values())
        table.add(channel, number(noise, 3), *map(_residual, off))
    yield table
    moving = {c: fit for c, fit in result.fit_percent.items() if not isnan(fit)}
    worst = min(moving, key=lambda channel: moving[channel], default="")
    if worst and not moving[worst] >= WEAK_FIT:
        yield Text(
            f"The estimate does not describe this drive: the free run explains {moving[worst]:.3g} "
            f"% of {worst}. Identify these logs, and compare both estimates."
        )
    count = len(result.runs)
    yield Text(
        f"{count} recording{'s' if count > 1 else ''} of {result.model} joint; the first state of "
        f"each prediction is taken from the half second before it."
    )


def _horizon(horizon: float) -> str:
    return "free run" if isinf(horizon) else f"{horizon:g} s"


def _fit(fit: float) -> str | Cell:
    if isnan(fit):
        return "at rest"
    if not isfinite(fit):
        return "diverges"
    return f"{fit:.2f}" if fit > -1000.0 else number(fit, 3)


def _residual(residual: float) -> str | Cell:
    return number(residual, 3) if isfinite(residual) else "–"
