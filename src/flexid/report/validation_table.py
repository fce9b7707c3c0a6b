"""The printed answer of a validation, at most 100 columns wide."""

from collections.abc import Iterator
from math import inf, isfinite, isinf, isnan

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from flexid.identification.validate_estimate import EstimateValidation
from flexid.report.terminal import print_parts, titled_table


def print_validation(result: EstimateValidation) -> None:
    """Print fits and residuals by horizon on standard output."""
    print_parts(_parts(result))


def _parts(result: EstimateValidation) -> Iterator[RenderableType]:
    fits = {**result.horizons, inf: result.fit_percent}
    table = titled_table("Fit of predictions over so long a time (%)")
    table.add_column("channel", no_wrap=True)
    _add_horizons(table, list(fits))
    for channel in result.fit_percent:
        table.add_row(channel, *(_fit(found[channel]) for found in fits.values()))
    yield table
    table = titled_table("What they are off (rad, root mean square)")
    for heading in ("channel", "sensor's noise"):
        table.add_column(heading, justify="left" if heading == "channel" else "right")
    _add_horizons(table, list(result.residuals))
    for channel, noise in result.noise.items():
        off = (found[channel] for found in result.residuals.values())
        table.add_row(channel, f"{noise:.3g}", *map(_residual, off))
    yield table
    count = len(result.runs)
    yield Text(
        f"{count} piece{'s' if count > 1 else ''} of {result.model} joint; the first state of each "
        f"prediction is taken from the half second before it."
    )


def _add_horizons(table: Table, horizons: list[float]) -> None:
    for horizon in horizons:
        heading = "free run" if isinf(horizon) else f"{horizon:g} s"
        table.add_column(heading, justify="right", no_wrap=True)


def _fit(fit: float) -> str:
    if isnan(fit):
        return "at rest"
    return f"{fit:.2f}" if isfinite(fit) else "diverges"


def _residual(residual: float) -> str:
    return f"{residual:.3g}" if isfinite(residual) else "–"
