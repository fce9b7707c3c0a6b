"""The page of an identification: parameters, whether to trust them, what to do next, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path

from rich.text import Text

from flexid.analysis.excitation import WEAK_CONDITION
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.report.charts.description import Chart
from flexid.report.identification import (
    coefficients_table,
    compliance_line,
    excitation_lines,
    explanation,
    parameters_table,
    prediction_lines,
    removed_lines,
    residual_lines,
    verdict_reasons,
)
from flexid.report.page.layout import (
    Answer,
    Bullets,
    Command,
    Facts,
    Folded,
    Item,
    Link,
    Page,
    Section,
    Tone,
    Warned,
    drawn,
)
from flexid.report.page.origin import (
    COLUMN_MAP,
    chosen_facts,
    excitation_command,
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
_MANY = 4  # names in a sentence

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
    yield Section("next", "What to record next", [Bullets(advice)] if advice else [])
    predicted = [*prediction_lines(result), f"Compliance: {compliance_line(result)}"]
    yield Section("fit", "Measured and predicted", [*drawn(charts, "fit"), Bullets(predicted)])
    left = Bullets([*residual_lines(result)])
    yield Section("residuals", "Residuals", [*drawn(charts, "residuals"), left])
    yield Section("estimates", "Estimates over time", drawn(charts, "estimates"))
    excited = Bullets([*excitation_lines(result.excitation)])
    yield Section("excitation", "Excitation", [*drawn(charts, "excitation"), excited])
    yield Section("bode", "Frequency response", drawn(charts, "bode"))
    yield Section("regions", "Correlation of parameters", drawn(charts, "regions"))
    reasons = Bullets([line.plain.strip() for line in verdict_reasons(result.coefficients)])
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
        yield Bullets([*removed_lines(result)])
    yield Folded("The evidence behind every choice", [*explanation(result)])


def trust(result: Identification) -> Answer:
    """Whether the parameters can be trusted, and what that rests on."""
    content: list[Item] = [Text(line) for line in (_counted(result), *_tested(result))]
    if result.warnings:
        many = len(result.warnings)
        content.append(Link(f"{many} warnings" if many > 1 else "A warning", "warnings"))
    return Answer("Can I trust them?", *_judged(result), content)


def _judged(result: Identification) -> tuple[str, Tone]:
    if result.verdict == "undetermined":
        usable = any(p.verdict != "undetermined" for p in result.parameters.values())
        return ("Not all of them" if usable else "No"), "bad"
    if _lost(result):
        return "With care, and not for long predictions", "bad"
    if result.verdict == "weak" or result.warnings:
        return "With care", "fair"
    return "Yes", "good"


def _lost(result: Identification) -> bool:
    """Whether a free run is further off than the mean of the data is."""
    return any(fit < 0.0 for fit in result.validation.fit_percent.values())


def _lacking(result: Identification) -> list[ValueEstimate]:
    """What is not determined: parameters, or else coefficients beneath them."""
    for found in (result.parameters, result.coefficients):
        lacking = [e for e in found.values() if e.verdict != "determined"]
        if lacking:
            return sorted(lacking, key=lambda e: e.verdict)  # undetermined before weak
    return []


def _counted(result: Identification) -> str:
    """How many parameters are determined, weakly or not at all."""
    verdicts = [p.verdict for p in result.parameters.values()]
    every, determined, weak = len(verdicts), verdicts.count("determined"), verdicts.count("weak")
    if determined == every:
        beneath = _named([c.name for c in _lacking(result)])
        return f"{_all(every)} determined" + (f", but not {beneath}." if beneath else ".")
    if determined + weak == 0:
        return (
            "The only one is not determined." if every == 1 else f"None of {every} is determined."
        )
    parts = {"determined": determined, "weak": weak, "undetermined": every - determined - weak}
    return f"Of {every}: {', '.join(f'{count} {name}' for name, count in parts.items() if count)}."


def _all(every: int) -> str:
    return "The only one is" if every == 1 else f"All {every} are"


def _named(names: Sequence[str]) -> str:
    if len(names) <= _MANY:
        return ", ".join(names)
    return f"{', '.join(names[: _MANY - 1])} and {len(names) - _MANY + 1} more"


def _tested(result: Identification) -> Iterator[str]:
    """What data say that the fit never saw, and what is left over."""
    fits = {c: fit for c, fit in result.validation.fit_percent.items() if isfinite(fit)}
    if fits:
        worst = min(fits, key=lambda channel: fits[channel])
        shown = f"{fits[worst]:.1f} %" if fits[worst] > 0.0 else "nothing"
        rest = ", more of the others" if len(fits) > 1 else ""
        yield (
            f"A free run over held-out data explains {shown} of the "
            f"{worst.replace('_', ' ')}{rest}."
        )
    else:
        yield "Nothing moves in the held-out data, so nothing was tested."
    if result.residual_excess:
        excess = max(result.residual_excess.values())
        yield f"The residuals are {excess:.3g} times the sensor noise."


def next_step(result: Identification, estimate: str, advice: Sequence[str] = ()) -> Answer:
    """What to do with the estimate, or what is lacking and what would mend that."""
    question, lacking = "What do I do next?", _lacking(result)
    if not lacking:
        said = Text("This log needs nothing more. On one that the estimate has never seen:")
        columns = f" --columns {COLUMN_MAP}" if mapped(result.provenance) else ""
        test = Command(f"flexid validate {estimate} NEXT.csv{columns}")
        return Answer(question, "Test it on another log", "", [said, test])
    reasons = [f"{e.name}: {e.reason}" for e in lacking[:1] if e.reason]
    word, asked = "Record another motion", "Which one, and how large, says"
    if result.model_error.share > 0.0:
        word, asked = "Look for what the model lacks", "Whether another motion would help, says"
        reasons.append("the residuals exceed the sensor noise, which widens intervals")
    said = Bullets([*reasons, *_confounded(result)])
    if advice:
        told = [Text(advice[0]), Link("What to record next", "next")]
        return Answer(question, word, "", [said, *told])
    return Answer(question, word, "", [said, Text(asked), Command(excitation_command(result))])


def _confounded(result: Identification) -> Iterator[str]:
    """The two coefficients that the motion confuses most, where it confuses any."""
    rows = (e for e in result.excitation.values() if e.condition_number > WEAK_CONDITION)
    worst = max((e for e in rows if e.correlated), key=lambda e: e.correlation, default=None)
    if worst is not None:
        first, second = worst.correlated
        size = f"{worst.correlation:.3f}"
        yield f"{first} and {second} are hardest to tell apart: they correlate by {size}"
