"""The page of an identification: parameters, whether to trust them, what to do next, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.text import Text

from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.report.charts.description import Chart
from flexid.report.explanation_table import explanation
from flexid.report.identification_table import (
    coefficients_table,
    compliance_line,
    excitation_lines,
    parameters_table,
    prediction_lines,
    removed_lines,
    residual_lines,
    verdict_reasons,
)
from flexid.report.page.identification_answers import next_step, trust
from flexid.report.page.layout import (
    Command,
    Facts,
    Folded,
    Item,
    Page,
    Points,
    Section,
    Warned,
    drawn,
)
from flexid.report.page.origin import (
    COLUMN_MAP,
    chosen_facts,
    identification_command,
    input_facts,
    mapped,
)

_TITLES = {
    "flexible": "Flexible joint",
    "link": "Link of a flexible joint",
    "rigid": "Rigid joint",
}
_INPUTS = {"N m": " and the torque", "V": " and the voltage", "A": " and the current"}
_MAP = (
    f"{COLUMN_MAP} stands for the column map: the channels were computed as below, which the "
    f"columns' names alone do not say."
)
_NAMED = 3  # files in a heading

_NOTE = (
    f"determined: the interval reaches {100 * THRESHOLDS.determined_width:g} % of the value to "
    f"either side at most; weak: {100 * THRESHOLDS.weak_width:g} %; undetermined: further, so that "
    f"not even the sign is known"
)


def identification_page(
    result: Identification,
    charts: Sequence[Chart],
    command: str = "",
    estimate: str = "estimate.json",
    advice: Sequence[str] = (),
) -> Page:
    """What there is to say of an identification."""
    sections = _sections(result, charts, command or identification_command(result), advice)
    return Page(
        "identification",
        _TITLES[result.model],
        _subject(result),
        parameters_table(result),
        (trust(result), next_step(result, estimate, advice)),
        [section for section in sections if section.content],
        (_NOTE,),
    )


def _sections(
    result: Identification, charts: Sequence[Chart], command: str, advice: Sequence[str]
) -> Iterator[Section]:
    yield Section("warnings", "Warnings", [*map(Warned, result.warnings)])
    yield Section("next", "What to record next", [Points(advice)] if advice else [])
    predicted = [*prediction_lines(result), f"Compliance: {compliance_line(result)}"]
    yield Section("fit", "Measured and predicted", [*drawn(charts, "fit"), Points(predicted)])
    left = Points([*residual_lines(result)])
    yield Section("residuals", "Residuals", [*drawn(charts, "residuals"), left])
    yield Section("estimates", "Estimates over time", drawn(charts, "estimates"))
    excited = Points([*excitation_lines(result)])
    yield Section("excitation", "Excitation", [*drawn(charts, "excitation"), excited])
    yield Section("bode", "Frequency response", drawn(charts, "bode"))
    yield Section("regions", "Correlation of parameters", drawn(charts, "regions"))
    reasons = Points([line.plain.strip() for line in verdict_reasons(result)])
    coefficients = [coefficients_table(result), *([reasons] if reasons.lines else [])]
    yield Section("coefficients", "Coefficients", coefficients)
    yield Section("choices", "What was chosen, and the alternatives", [*_choices(result)])
    origin = Facts([*input_facts(result.provenance), *chosen_facts(result.provenance)])
    missing = [Text(_MAP)] if COLUMN_MAP in command and mapped(result.provenance) else []
    yield Section("origin", "How to repeat it", [Command(command), *missing, origin])


def _subject(result: Identification) -> str:
    """The files, and what was recorded."""
    inputs = result.provenance.get("inputs", ())
    files = [Path(source["file"]).name for source in inputs if source.get("file")]
    named = ", ".join(files[:_NAMED]) or "data in memory"
    if len(files) > _NAMED:
        named += f" and {len(files) - _NAMED} more"
    recordings = result.recordings
    if not recordings:
        return named
    duration = sum(len(recording) * recording.sample_time for recording in recordings)
    rates = sorted({round(1.0 / recording.sample_time, 3) for recording in recordings})
    at = " and ".join(f"{rate:g} Hz" for rate in rates)
    encoders = "one encoder" if recordings[0].link_position is None else "two encoders"
    driven = _INPUTS.get(recordings[0].input_unit, "")
    return f"{named}: {duration:.4g} s at {at}, {encoders}{driven}"


def _choices(result: Identification) -> Iterator[Item]:
    yield from map(Text, result.summary)
    if result.removed:
        yield Text("The model does without these; if there, they are no larger than this:")
        yield Points([*removed_lines(result)])
    yield Folded("The evidence behind every choice", [*explanation(result)])
