"""The evidence behind the choices of an identification: what ``--explain`` adds."""

from collections.abc import Iterator
from math import isclose, isfinite

from rich.text import Text

from flexid.identification.result.identification import Choices, Identification
from flexid.identification.vocabulary.evidence import Disturbances
from flexid.report.digits import value_cells
from flexid.report.terminal import Column, Part, Table, number, numbers

_LEAST_PROBABILITY = 1e-6  # below which a probability is no more than this


def explanation(result: Identification) -> Iterator[Part]:
    """Tables of what was tried, and sentences on what they rest on."""
    choices = result.choices
    yield Text()
    if choices.term_evidence:
        yield _terms(choices)
    if len(choices.segment_evidence) > 1:
        yield _segments(choices)
    yield _delays(result)
    if result.model != "link":
        yield Text(f"Input hold {choices.hold}: {choices.alignment.hold_reason}")
    if choices.coulomb_velocity is not None:
        yield Text(f"Coulomb friction changes sign over {choices.coulomb_velocity:.3g} rad/s")
    yield Text()
    if result.disturbances is not None:
        yield from _disturbances(result.disturbances)
    yield _least_squares(result)


def _terms(choices: Choices) -> Table:
    columns = (Column("name"), *numbers("value", "std", "by chance"), Column("in the model"))
    table = Table("Terms and delays of the full model, in SI units", columns)
    for e in choices.term_evidence:
        kept = "yes" if e.kept else "no"
        std = number(e.std, 2) if isfinite(e.std) else "unknown"
        value, _ = value_cells(e.value, e.value - e.std, e.value + e.std)
        table.add(e.name, value, std, _probability(e.probability), kept)
    return table


def _probability(probability: float) -> str:
    if probability < _LEAST_PROBABILITY:
        return f"< {_LEAST_PROBABILITY:g}"
    return f"{probability:.2g}" if isfinite(probability) else "unknown"


def _segments(choices: Choices) -> Table:
    columns = (Column("length"), *numbers("residual over noise", "mean relative std"), Column(""))
    table = Table("Segments of the prediction error", columns)
    for e in choices.segment_evidence:
        chosen = choices.segment_duration is not None and isclose(
            e.duration, choices.segment_duration
        )
        std = number(100 * e.std, 2, "%") if isfinite(e.std) else "unknown"
        length = number(e.duration, 3, "s")
        table.add(length, number(e.excess**0.5, 3), std, "chosen" if chosen else "")
    return table


def _delays(result: Identification) -> Table:
    columns = (Column("channel"), *numbers("late by", "95 % interval"), Column(""))
    table = Table("Time against the motor's encoder", columns)
    alignment = result.choices.alignment
    channels = {"input": alignment.input_delay, "link": alignment.link_delay}
    if result.model == "link":
        del channels["input"]
    for name, delay in channels.items():
        value, interval = value_cells(*(1e3 * x for x in (delay.value, *delay.interval)))
        table.add(name, value.with_unit("ms"), interval.with_unit("ms"), delay.status)
    return table


def _disturbances(found: Disturbances) -> Iterator[Part]:
    """What the drive does that no term describes."""
    table = Table("Unexplained acceleration, RMS", (Column("balance"), *numbers("share")))
    for name, share in found.shares.items():
        table.add(name, number(100.0 * share, 2, "%"))
    yield table
    yield Text(f"Fitted in the joint's band, one sample every {1e3 * found.sample_time:.3g} ms")
    yield Text()


def _least_squares(result: Identification) -> Table:
    rate = result.choices.filter_rate
    columns = (Column("name"), *numbers("estimate", "least squares"))
    table = Table(f"Least squares beside the estimate, filter rate {rate:.6g} 1/s", columns)
    for name, value in result.least_squares.items():
        estimate = result.coefficients[name]
        table.add(name, value_cells(estimate.value, *estimate.interval)[0], number(value, 6))
    return table
