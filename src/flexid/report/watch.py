"""The state of a stream as tables, JSON, and a live view."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from rich.console import Group
from rich.text import Text

from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.physical import ANGLES, difference
from flexid.report.identification import PARAMETERS, estimates_table, negligible_line
from flexid.report.terminal import Column, Part, laid_out, numbers
from flexid.streaming.health import Health
from flexid.streaming.session import Session

COLOURS = {
    Health.CONVERGING: "yellow",
    Health.CONVERGED: "green",
    Health.NOT_EXCITED: "yellow",
    Health.INCONSISTENT: "red",
    Health.SENSOR_FAULT: "red",
}


def parts(session: Session) -> Iterator[Part]:
    """Return tables and sentences on the state of a stream."""
    judgement = session.health
    yield Text.assemble(
        (judgement.health.words, f"bold {COLOURS[judgement.health]}"), f": {judgement.reason}."
    )
    yield ""
    yield estimates_table(PARAMETERS, session.parameters, _columns(session))
    yield from negligible_line(session.parameters.values())
    conditions = ", ".join(
        f"{name} {found.condition_number:.3g}" for name, found in session.excitation.items()
    )
    yield f"Excitation, condition number by row: {conditions}"
    yield session.counts.sentence
    for departure in session.departures:
        yield Text(f"Departure: {departure.sentence}.", style="red")
    known = session.findings
    for sentence in (*known.contradicted, *known.against):
        yield Text(f"Contradiction: {sentence}.", style="red")
    for change in session.changes[-3:]:
        yield Text(f"Change: {change.sentence}.", style="red")


def _columns(session: Session) -> dict[Column, Callable[[str], Text | str]]:
    """Return columns with the reference value of each parameter, and the change from it."""
    reference, gone = session.options.reference, {d.name for d in session.departures}
    found = session.parameters

    def change(name: str) -> Text | str:
        if name not in reference:
            return ""
        (was, half), now = reference[name], found[name].value
        shown = f"{difference(name, was, now):+.3g} {found[name].unit}"
        if name not in ANGLES and half < abs(was):  # no per cent of a value that may be zero
            shown = f"{round(100.0 * (now / was - 1.0), 1) + 0.0:+.1f} %"
        return Text(shown, "red" if name in gone else "")

    def estimate(name: str) -> str:
        return f"{reference[name][0]:.5g}" if name in reference else ""

    columns = zip(numbers("estimate", "change"), (estimate, change), strict=True)
    return dict(columns) if reference else {}


def live_view(session: Session | None, width: int) -> Group:
    """Return the live view for a terminal."""
    if session is None:
        return laid_out(("waiting for the first samples",), width)
    return laid_out((f"flexid watch, {session.time:.3f} s", *parts(session)), width)


def heading(session: Session) -> tuple[str, str]:
    """Return the title, and the time of the latest sample."""
    return "Running drive", f"{session.time:.3f} s"


def document(session: Session) -> dict[str, Any]:
    """Return health, parameters and counts of samples, for JSON."""
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
    keys = ("value", "interval", "unit", "verdict")
    return {name: {key: getattr(e, key) for key in keys} for name, e in found.items()}
