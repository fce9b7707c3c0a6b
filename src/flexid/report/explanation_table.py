"""The evidence behind the choices of an identification: what ``--explain`` adds."""

from collections.abc import Iterator

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from flexid.identification.alignment import Delay
from flexid.identification.result import Choices, Identification
from flexid.report.terminal import titled_table


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
    yield Text(f"Filter rate {choices.filter_rate:.6g} 1/s, estimator {choices.estimator}")
    if choices.coulomb_velocity is not None:
        yield Text(f"Coulomb friction changes sign over {choices.coulomb_velocity:.3g} rad/s")
    if choices.stopping_time is not None:
        yield Text(f"Friction stops the motor within {choices.stopping_time:.3g} s")
    yield Text()
    yield _least_squares(result)


def _terms(choices: Choices) -> Table:
    table = titled_table("Terms: error of the free run over data to choose by, in % of the motion")
    for heading in ("term", "in the model"):
        table.add_column(heading, no_wrap=True)
    for heading in ("with it", "without it"):
        table.add_column(heading, justify="right", no_wrap=True)
    for e in choices.term_evidence:
        chosen = "yes" if e.chosen else "no"
        table.add_row(e.term, chosen, _percent(e.with_term), _percent(e.without_term))
    return table


def _segments(choices: Choices) -> Table:
    table = titled_table("Segments of the prediction error")
    table.add_column("length", justify="right", no_wrap=True)
    table.add_column("error of the free run in %", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for e in choices.segment_evidence:
        if e.duration == 0:
            length, note = "none", "least squares"
        else:
            length = f"{e.duration:g} s"
            note = "" if e.converged else "did not converge"
        if e.duration == (choices.segment_duration or 0):
            note = "chosen" if e.duration else "least squares, chosen"
        table.add_row(length, _percent(e.error), note)
    return table


def _delays(choices: Choices) -> Table:
    table = titled_table("Time against the motor's encoder")
    for heading in ("channel", "corrected", "95 % interval", "why"):
        justify = "left" if heading in ("channel", "why") else "right"
        table.add_column(heading, justify=justify, no_wrap=heading != "why")
    alignment = choices.alignment
    for name, delay in (("input", alignment.input_delay), ("link", alignment.link_delay)):
        table.add_row(name, f"{1e3 * delay.value:.3g} ms", _interval(delay), delay.reason)
    return table


def _interval(delay: Delay) -> str:
    lower, upper = (1e3 * end for end in delay.interval)
    return f"[{lower:.3g}, {upper:.3g}] ms"


def _least_squares(result: Identification) -> Table:
    table = titled_table("Least squares beside the estimate")
    table.add_column("name", no_wrap=True)
    for heading in ("estimate", "least squares"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, value in result.least_squares.items():
        table.add_row(name, f"{result.coefficients[name].value:.6g}", f"{value:.6g}")
    return table


def _percent(error: float) -> str:
    return f"{100 * error:.3g}"
