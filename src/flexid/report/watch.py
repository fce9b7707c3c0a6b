"""What is known of a stream, as tables, JSON, and a view that is renewed."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any

from rich.text import Text

from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.parameter_kinds import ANGLES, difference
from flexid.report.identification import PARAMETERS, estimates_table, negligible
from flexid.report.page import Presenter
from flexid.report.terminal import Cell, Column, Part, encodable, laid_out
from flexid.streaming.health import Health
from flexid.streaming.session import Session, clock_words

COLOURS = {
    Health.CONVERGING: "yellow",
    Health.CONVERGED: "green",
    Health.NOT_EXCITED: "yellow",
    Health.INCONSISTENT: "red",
    Health.SENSOR_FAULT: "red",
}

_BARS = "▁▂▃▄▅▆▇█"
_PLAIN_BARS = "_.-~=+*#"
_SPARKS = 24  # values of a sparkline


def parts(session: Session, sparks: "Sparks | None" = None) -> Iterator[Part]:
    """Tables and sentences of what is known."""
    judgement = session.health
    yield Text.assemble(
        (judgement.health.words, f"bold {COLOURS[judgement.health]}"), f": {judgement.reason}."
    )
    yield ""
    yield estimates_table(PARAMETERS, session.parameters, _columns(session, sparks))
    if small := negligible(session.parameters.values()):
        yield f"Negligible even at the ends of the interval: {', '.join(small)}"
    conditions = ", ".join(
        f"{name} {found.condition_number:.3g}" for name, found in session.excitation.items()
    )
    yield f"Excitation: condition number of the rows {conditions}"
    yield session.counts.sentence
    for departure in session.departures:
        yield Text(f"Departure: {departure.sentence}.", style="red")
    known = session.findings
    for sentence in (*known.contradicted, *known.against):
        yield Text(f"Contradiction: {sentence}.", style="red")
    for change in session.changes[-3:]:
        yield Text(f"Change: {change.sentence}.", style="red")


def _columns(
    session: Session, sparks: "Sparks | None"
) -> dict[Column, Callable[[str], Cell | str]]:
    """What is said of each parameter besides: the estimate it is held against, and how it went."""
    reference, gone = session.options.reference, {d.name for d in session.departures}
    found = session.parameters

    def change(name: str) -> Cell | str:
        if name not in reference:
            return ""
        was, now = reference[name][0], found[name].value
        angle = name in ANGLES
        shown = f"{difference(name, was, now):+.3g} rad" if angle else f"{now / was - 1.0:+.1%}"
        return Cell((shown,), "red" if name in gone else "")

    columns: dict[Column, Callable[[str], Cell | str]] = {}
    if reference:
        estimate = Column("estimate", right=True)
        columns[estimate] = lambda name: f"{reference[name][0]:.5g}" if name in reference else ""
        columns[Column("change", right=True)] = change
    if sparks is not None:
        columns[Column("lately", spare=1)] = lambda name: sparks.line(name, found[name].value)
    return columns


class Sparks:
    """The latest values of each parameter, as a line of small bars."""

    def __init__(self) -> None:
        self._values: dict[str, deque[float]] = {}

    def line(self, name: str, value: float) -> str:
        """Bars of the latest values, this one the last."""
        kept = self._values.setdefault(name, deque(maxlen=_SPARKS))
        kept.append(value)
        return sparkline(kept)


def sparkline(values: Sequence[float] | deque[float]) -> str:
    """Values as bars, the lowest the shortest; what is no number is a blank."""
    bars = _BARS if encodable(_BARS) else _PLAIN_BARS
    finite = [value for value in values if isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=0.0)
    span = high - low
    if not isfinite(span) or span == 0.0:
        return "".join(bars[0] if isfinite(value) else " " for value in values)
    return "".join(
        bars[round((value - low) / span * (len(bars) - 1))] if isfinite(value) else " "
        for value in values
    )


def live_view(session: Session | None, sparks: Sparks, width: int) -> Text:
    """The view of a terminal that is renewed."""
    if session is None:
        return Text("waiting for the first samples")
    title = f"flexid watch, {clock_words(session.time)}"
    return Text("\n").join(laid_out((title, *parts(session, sparks)), width))


def document(session: Session) -> dict[str, Any]:
    """Health, parameters and what happened to the samples."""
    judgement = session.health
    return {
        "time": session.time,
        "health": judgement.health.words,
        "reason": judgement.reason,
        "parameters": _values(session.parameters),
        "coefficients": _values(session.coefficients),
        "excitation": {name: found.condition_number for name, found in session.excitation.items()},
        "samples": asdict(session.counts),
        "changes": [asdict(change) for change in session.changes],
        "departures": [
            {key: getattr(departure, key) for key in ("name", "unit", "was", "now", "change")}
            for departure in session.departures
        ],
        "options": session.options.document,
    }


def _values(found: Mapping[str, ValueEstimate]) -> dict[str, Any]:
    said = ("value", "interval", "unit", "verdict")
    return {name: {key: getattr(e, key) for key in said} for name, e in found.items()}


PRESENTER = Presenter(parts, document)
