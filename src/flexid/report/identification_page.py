"""The page of an identification: parameters, whether to trust them, what to do next, and why."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from math import isclose, isfinite
from pathlib import Path
from typing import Any

from flexid.analysis.excitation import WEAK_CONDITION
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.recording.columns import is_by_name
from flexid.report.chart import Chart
from flexid.report.identification import (
    COEFFICIENTS,
    PARAMETERS,
    compliance_line,
    estimates_table,
    excitation_lines,
    explanation,
    prediction_lines,
    removed_lines,
    residual_lines,
    verdict_reasons,
)
from flexid.report.page import (
    Answer,
    Bullets,
    Command,
    Folded,
    Item,
    Link,
    Page,
    Section,
    Tone,
    drawn,
    sections_of,
)

_USUAL = Settings()
_COLUMN_MAP = "MAP.toml"  # what stands for a column map, whose name no estimate holds

_CHOSEN = ("hold", "input_delay", "link_delay", "coulomb_velocity", "filter_rate")


def identification_command(result: Identification) -> str:
    """The command that repeats an identification; see `mapped` for its column map."""
    return _command("identify", result, ["--stream"] if "stream" in result.provenance else [])


def _command(name: str, result: Identification, more: list[str]) -> str:
    logs = result.provenance.get("inputs", ())
    files = [str(source.get("file") or "LOG") for source in logs] or ["LOG"]
    options = [*_options(result.provenance.get("settings", {}))]
    if mapped(result.provenance):
        options += ["--columns", _COLUMN_MAP]
    return shlex.join(["flexid", name, *files, *options, *more])


def mapped(provenance: Mapping[str, Any]) -> bool:
    """Whether a channel was computed as no column's name says, but a column map."""
    return any(
        not is_by_name(channel, origin)
        for source in provenance.get("inputs", ())
        for channel, origin in source.get("columns", {}).items()
    )


def _options(settings: Mapping[str, Any]) -> Iterator[str]:
    """Options of the command line for settings that are not the usual ones."""
    if settings.get("model", "auto") != "auto":
        yield from ("--model", settings["model"])
    if settings.get("terms", "auto") != "auto":
        yield from ("--terms", ",".join(settings["terms"]))
    deviations = settings.get("known_deviations") or {}
    for name, value in (settings.get("known") or {}).items():
        spread = f"+-{deviations[name]:.10g}" if name in deviations else ""
        yield from ("--known", f"{name}={value:.10g}{spread}")
    for name, (low, high) in (settings.get("bounds") or {}).items():
        yield from ("--bounds", f"{name}={_end(low)}:{_end(high)}")
    for name in (*_CHOSEN, "segment_duration"):
        value = settings.get(name, "auto")
        if value not in ("auto", None):
            text = value if isinstance(value, str) else f"{value:.10g}"
            yield from (f"--{name.replace('_', '-')}", text)
    share = settings.get("validation_share", _USUAL.validation_share)
    if not isclose(share, _USUAL.validation_share):
        yield from ("--validation-share", f"{share:.10g}")


def _end(value: float | None) -> str:
    return "" if value is None or not isfinite(value) else f"{value:.10g}"


def input_facts(provenance: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Version and logs: each with its digest, and what its channels are made of."""
    yield "flexid", str(provenance.get("flexid_version", "unknown"))
    if "estimate" in provenance:
        yield "estimate", str(provenance["estimate"].get("file") or "in memory")
    for source in provenance.get("inputs", ()):
        yield "log", str(source.get("file") or "data in memory")
        if source.get("sha256"):
            yield "SHA-256", str(source["sha256"])
        for channel, origin in source.get("columns", {}).items():
            yield channel.replace("_", " "), _origin(origin)


def _origin(origin: Mapping[str, Any]) -> str:
    """A channel as a formula of the file's columns, in SI units."""
    terms = [
        name if weight == 1.0 else f"{weight:.6g} × {name}"
        for name, weight in origin["columns"].items()
    ]
    total = " + ".join(terms)
    factor, offset = origin["factor"], origin["offset"]
    if factor != 1.0:
        total = f"{factor:.6g} × ({total})" if len(terms) > 1 else f"{factor:.6g} × {total}"
    shift = f" + {offset:.6g}" if offset else ""
    gear = f", carried through a gear of {origin['gear_ratio']:.6g}" if origin["gear_ratio"] else ""
    return f"{total}{shift} in {origin['unit']}{gear}"


def chosen_facts(provenance: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What was chosen from the log, or given."""
    chosen = provenance.get("chosen", {})
    if chosen.get("terms") is not None:
        yield "terms", ", ".join(chosen["terms"]) or "none"
    for name, unit in (
        ("input_delay", "s"),
        ("link_delay", "s"),
        ("filter_rate", "1/s"),
        ("segment_duration", "s"),
    ):
        if chosen.get(name) is not None:
            yield name.replace("_", " "), f"{chosen[name]:.6g} {unit}"
    for name in ("hold", "estimator"):
        if chosen.get(name) is not None:
            yield name, str(chosen[name])


_TITLES = {"flexible": "Flexible joint", "link": "Link of a flexible joint", "rigid": "Rigid joint"}
_INPUTS = {"N m": " and the torque", "V": " and the voltage", "A": " and the current"}
_MAP = (
    f"{_COLUMN_MAP} stands for the column map: the channels were computed as below, which the "
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
    command = command or identification_command(result)
    facts = (*input_facts(result.provenance), *chosen_facts(result.provenance))
    remarks = [_MAP] if _COLUMN_MAP in command and mapped(result.provenance) else []
    sections = _sections(result, charts, advice)
    return Page(
        "identification",
        _TITLES[result.model],
        _subject(result),
        estimates_table(PARAMETERS, result.parameters),
        (trust(result), next_step(result, estimate, advice)),
        sections_of(result.warnings, sections, command, facts, remarks),
        (_NOTE,),
    )


def _sections(
    result: Identification, charts: Sequence[Chart], advice: Sequence[str]
) -> Iterator[Section]:
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
    table = estimates_table(COEFFICIENTS, result.coefficients)
    yield Section("coefficients", COEFFICIENTS, [table, *([reasons] if reasons.lines else [])])
    yield Section("choices", "What was chosen, and the alternatives", [*_choices(result)])


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
    yield from result.summary
    if result.removed:
        yield "The model does without these; if there, they are no larger than this:"
        yield Bullets([*removed_lines(result)])
    yield Folded("The evidence behind every choice", [*explanation(result)])


def trust(result: Identification) -> Answer:
    """Whether the parameters can be trusted, and what that rests on."""
    content: list[Item] = [_counted(result), *_tested(result)]
    if result.warnings:
        many = len(result.warnings)
        content.append(Link(f"{many} warnings" if many > 1 else "A warning", "warnings"))
    return Answer("Can I trust them?", *_judged(result), content)


def _judged(result: Identification) -> tuple[str, Tone]:
    if result.verdict == "undetermined":
        usable = any(p.verdict != "undetermined" for p in result.parameters.values())
        return ("Not all of them" if usable else "No"), "bad"
    if any(fit < 0.0 for fit in result.validation.fit_percent.values()):  # worse than the mean
        return "With care, and not for long predictions", "bad"
    if result.verdict == "weak" or result.warnings:
        return "With care", "fair"
    return "Yes", "good"


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
        every_one = "The only one is" if every == 1 else f"All {every} are"
        return f"{every_one} determined" + (f", but not {beneath}." if beneath else ".")
    if determined + weak == 0:
        return (
            "The only one is not determined." if every == 1 else f"None of {every} is determined."
        )
    parts = {"determined": determined, "weak": weak, "undetermined": every - determined - weak}
    return f"Of {every}: {', '.join(f'{count} {name}' for name, count in parts.items() if count)}."


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
        said = "This log needs nothing more. On one that the estimate has never seen:"
        columns = f" --columns {_COLUMN_MAP}" if mapped(result.provenance) else ""
        test = Command(f"flexid validate {estimate} NEXT.csv{columns}")
        return Answer(question, "Test it on another log", "", [said, test])
    reasons = [f"{e.name}: {e.reason}" for e in lacking[:1] if e.reason]
    word, asked = "Record another motion", "Which one, and how large, says"
    if result.model_error.share > 0.0:
        word, asked = "Look for what the model lacks", "Whether another motion would help, says"
        reasons.append("the residuals exceed the sensor noise, which widens intervals")
    said = Bullets([*reasons, *_confounded(result)])
    if advice:
        told = [advice[0], Link("What to record next", "next")]
        return Answer(question, word, "", [said, *told])
    return Answer(question, word, "", [said, asked, Command(_command("excitation", result, []))])


def _confounded(result: Identification) -> Iterator[str]:
    """The two coefficients that the motion confuses most, where it confuses any."""
    rows = (e for e in result.excitation.values() if e.condition_number > WEAK_CONDITION)
    worst = max((e for e in rows if e.correlated), key=lambda e: e.correlation, default=None)
    if worst is not None:
        first, second = worst.correlated
        size = f"{worst.correlation:.3f}"
        yield f"{first} and {second} are hardest to tell apart: they correlate by {size}"
