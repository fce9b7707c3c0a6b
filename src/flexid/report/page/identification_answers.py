"""What a reader of an identification asks first: can I trust it, and what do I do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite

from rich.text import Text

from flexid.analysis.excitation import WEAK_CONDITION
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.report.page.layout import Answer, Command, Item, Link, Points, Tone
from flexid.report.page.origin import COLUMN_MAP, excitation_command, mapped

_MANY = 4  # names in a sentence


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
    said = Points([*reasons, *_confounded(result)])
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
