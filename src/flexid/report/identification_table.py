"""The printed answer of an identification, at most 100 columns wide."""

from collections.abc import Iterable, Iterator, Mapping
from math import floor, isfinite, isnan, log10

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from flexid.identification.result import (
    CoefficientEstimate,
    Identification,
    ModelError,
    ParameterEstimate,
    Validation,
    Verdict,
)
from flexid.report.explanation_table import explanation
from flexid.report.terminal import print_parts, titled_table

_COLOURS: dict[Verdict, str] = {"determined": "green", "weak": "yellow", "undetermined": "red"}


def print_identification(result: Identification, *, explain: bool = False) -> None:
    """Print parameters, coefficients, validation and choices on standard output.

    Parameters
    ----------
    result : Identification
        What to print.
    explain : bool, optional
        Print the evidence for the choices as well.
    """
    print_parts([*_parts(result), *(explanation(result) if explain else ())])


def _parts(result: Identification) -> Iterator[RenderableType]:
    yield _estimates("Physical parameters", result.parameters.values())
    yield _estimates("Coefficients", result.coefficients.values())
    for name, c in result.coefficients.items():
        if c.verdict != "determined":
            yield Text(f"  {name}: {c.reason}", style=_COLOURS[c.verdict])
    yield Text()
    for row, excitation in result.excitation.items():
        pair = " and ".join(excitation.correlated)
        detail = f"; {pair} correlate by {excitation.correlation:.3f}" if pair else ""
        yield Text(
            f"Excitation, {row} row: condition number {excitation.condition_number:.3g}{detail}"
        )
    if result.residual_excess:
        excess = ", ".join(f"{name} {x:.3g}" for name, x in result.residual_excess.items())
        yield Text(f"Residual over the sensors' noise: {excess}")
    yield Text(_model_error(result.model_error))
    yield Text(f"Free run over held-out data: {format_fits(result.validation.fit_percent)}")
    yield from map(Text, _horizons(result.validation))
    if result.compliance.rigid_fit_percent:
        yield Text(f"The same, joint rigid: {format_fits(result.compliance.rigid_fit_percent)}")
    seen = "visible" if result.compliance.visible else "not visible"
    yield Text(f"Compliance: {seen}; {result.compliance.reason}.")
    if result.removed:
        yield Text(f"Without: {', '.join(map(_at_most, result.removed.values()))}.")
    yield Text()
    yield from map(Text, result.summary)


def _model_error(error: ModelError) -> str:
    """What residuals beyond the sensors' noise say of the model."""
    if error.share == 0.0:
        return "Model error: none that shows in the residuals"
    return (
        f"Model error: the residuals hold {error.excess**0.5:.2g} times the sensors' noise beyond "
        f"it, {100 * error.share:.0f} % of that as an error that repeats itself"
    )


def _horizons(validation: Validation) -> Iterator[str]:
    """How far each channel is predicted, a line each."""
    if not validation.horizons:
        return
    spans = ", ".join(f"{horizon:g}" for horizon in validation.horizons)
    for channel in validation.fit_percent:
        fits = [found[channel] for found in validation.horizons.values()]
        if any(map(isnan, fits)):
            continue
        shown = ", ".join(f"{fit:.1f}" for fit in fits)
        yield f"Prediction over {spans} s: {channel} {shown} %"


def _at_most(parameter: ParameterEstimate) -> str:
    """How large something could be that the model does without."""
    largest = max(map(abs, parameter.interval))
    if not isfinite(largest):
        return f"{parameter.name}, of which the log tells nothing"
    return f"{parameter.name} below {largest:.2g} {parameter.unit}"


def _estimates(title: str, estimates: Iterable[CoefficientEstimate | ParameterEstimate]) -> Table:
    table = titled_table(title)
    table.add_column("name", no_wrap=True)
    for heading in ("value", "95 % interval"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for e in estimates:
        value, lower, upper = format_with_interval(e.value, *e.interval)
        interval = f"[{lower}, {upper}]" if e.interval[0] != e.interval[1] else _fixed(e)
        table.add_row(e.name, value, interval, e.unit, Text(e.verdict, _COLOURS[e.verdict]))
    return table


def _fixed(estimate: CoefficientEstimate | ParameterEstimate) -> str:
    """Why something has no interval; a parameter follows from coefficients that say it."""
    return estimate.reason if isinstance(estimate, CoefficientEstimate) else "fixed"


def format_fits(fits: Mapping[str, float]) -> str:
    """Free-run fits of the channels as text."""
    return ", ".join(f"{channel} {format_fit(fit)}" for channel, fit in fits.items())


def format_fit(fit: float) -> str:
    """A free-run fit as text."""
    return "not tested (at rest)" if isnan(fit) else f"{fit:.1f} %"


def format_with_interval(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """Numbers as text, with as many digits as the width of the interval justifies.

    Examples
    --------
    >>> format_with_interval(99.98731, 99.93, 100.04)
    ('99.99', '99.93', '100.04')
    >>> format_with_interval(4.1e6, 3.9e6, 4.3e6)
    ('4100000', '3900000', '4300000')
    """
    width = upper - lower
    if not isfinite(width) or width <= 0:
        return f"{value:.5g}", f"{lower:.5g}", f"{upper:.5g}"
    decimals = min(12, max(0, 1 - floor(log10(width))))
    return f"{value:.{decimals}f}", f"{lower:.{decimals}f}", f"{upper:.{decimals}f}"
