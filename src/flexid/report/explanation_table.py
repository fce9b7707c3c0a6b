"""The evidence behind the choices of an identification: what ``--explain`` adds."""

from collections.abc import Iterator
from math import isclose, isfinite

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from flexid.identification.alignment import Delay
from flexid.identification.result import Choices, Identification
from flexid.report.terminal import titled_table

_LEAST_PROBABILITY = 1e-6  # below which a probability is no more than this


def explanation(result: Identification) -> Iterator[RenderableType]:
    """Tables of what was tried, and sentences on what they rest on."""
    choices = result.choices
    yield Text()
    if choices.term_evidence:
        yield _terms(choices)
    if len(choices.segment_evidence) > 1:
        yield _segments(choices)
    yield _delays(choices)
    yield Text(f"Input hold {choices.hold}: {choices.alignment.hold_reason}")
    if choices.coulomb_velocity is not None:
        yield Text(f"Coulomb friction changes sign over {choices.coulomb_velocity:.3g} rad/s")
    yield Text()
    yield _least_squares(result)


def _terms(choices: Choices) -> Table:
    table = titled_table("Terms and delays of the full model, in SI units")
    table.add_column("name", no_wrap=True)
    for heading in ("value", "std"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("by chance", justify="right", no_wrap=True)
    table.add_column("in the model", no_wrap=True)
    for e in choices.term_evidence:
        kept = "yes" if e.kept else "no"
        std = f"{e.std:.2g}" if isfinite(e.std) else "unknown"
        table.add_row(e.name, f"{e.value:.4g}", std, _probability(e.probability), kept)
    return table


def _probability(probability: float) -> str:
    if probability < _LEAST_PROBABILITY:
        return f"< {_LEAST_PROBABILITY:g}"
    return f"{probability:.2g}" if isfinite(probability) else "unknown"


def _segments(choices: Choices) -> Table:
    table = titled_table("Segments of the prediction error")
    for heading in ("length", "residual over noise", "mean relative std"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for e in choices.segment_evidence:
        chosen = choices.segment_duration is not None and isclose(
            e.duration, choices.segment_duration
        )
        std = f"{100 * e.std:.2g} %" if isfinite(e.std) else "unknown"
        note = "chosen" if chosen else ""
        table.add_row(f"{e.duration:.3g} s", f"{e.excess**0.5:.3g}", std, note)
    return table


def _delays(choices: Choices) -> Table:
    table = titled_table("Time against the motor's encoder")
    for heading in ("channel", "late by", "95 % interval", ""):
        justify = "left" if heading in ("channel", "") else "right"
        table.add_column(heading, justify=justify, no_wrap=True)
    alignment = choices.alignment
    for name, delay in (("input", alignment.input_delay), ("link", alignment.link_delay)):
        table.add_row(name, f"{1e3 * delay.value:.3g} ms", _interval(delay), delay.status)
    return table


def _interval(delay: Delay) -> str:
    lower, upper = (1e3 * end for end in delay.interval)
    return f"[{lower:.3g}, {upper:.3g}] ms"


def _least_squares(result: Identification) -> Table:
    rate = result.choices.filter_rate
    table = titled_table(f"Least squares beside the estimate, filter rate {rate:.6g} 1/s")
    table.add_column("name", no_wrap=True)
    for heading in ("estimate", "least squares"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, value in result.least_squares.items():
        table.add_row(name, f"{result.coefficients[name].value:.6g}", f"{value:.6g}")
    return table
