"""The page of a validation: how well, and for how long, an estimate predicts other logs."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from math import isfinite, isnan
from pathlib import Path

from rich.text import Text

from flexid.identification.judgement.compliance import WEAK_FIT
from flexid.report.charts.description import Chart
from flexid.report.page.layout import (
    Answer,
    Command,
    Facts,
    Item,
    Page,
    Section,
    Warned,
    drawn,
)
from flexid.report.page.origin import input_facts
from flexid.report.validation_table import errors_parts, fits_table
from flexid.stored_estimates.validate_estimate import EstimateValidation


def validation_page(result: EstimateValidation, charts: Sequence[Chart], command: str = "") -> Page:
    """What there is to say of a validation."""
    logs = [Path(log["file"]).name for log in result.provenance["inputs"] if log.get("file")]
    origin: list[Item] = [Facts([*input_facts(result.provenance)])]
    sections = (
        Section("warnings", "Warnings", [*map(Warned, result.warnings)]),
        Section("fit", "Measured and predicted", drawn(charts, "validation")),
        Section(
            "residuals",
            "Residuals",
            [*drawn(charts, "residuals"), *errors_parts(result)],
        ),
        Section("origin", "How to repeat it", [Command(command), *origin] if command else origin),
    )
    return Page(
        "validation",
        f"Estimate of a {result.model} joint on other logs",
        ", ".join(logs) or "data in memory",
        fits_table(result),
        (_predicts(result), _next(result)),
        [section for section in sections if section.content],
    )


def _worst(result: EstimateValidation) -> tuple[str, float]:
    """The channel that a free run repeats least, and how much of it, in per cent."""
    moving = {c: fit for c, fit in result.fit_percent.items() if not isnan(fit)}
    if not moving:
        return "", float("nan")
    worst = min(moving, key=lambda channel: moving[channel])
    return worst, moving[worst]


def _predicts(result: EstimateValidation) -> Answer:
    channel, fit = _worst(result)
    question = "How much of these logs does it predict?"
    if not channel:
        return Answer(question, "Nothing moves", "bad", [Text("Every channel is at rest.")])
    tone = "bad" if not fit >= WEAK_FIT else "fair" if result.warnings else "good"
    word = f"{fit:.2f} %" if isfinite(fit) and fit > 0.0 else "Nothing"
    rest = ", and more of the rest" if len(result.fit_percent) > 1 else ""
    content = [Text(f"Of the {channel.replace('_', ' ')} in a free run{rest}.")]
    noise = {
        c: off / result.noise[c]
        for c, off in result.residuals[float("inf")].items()
        if result.noise.get(c) and isfinite(off)
    }
    if noise:
        most = max(noise.values())
        content.append(Text(f"The error is at most {most:.3g} times the sensor noise."))
    return Answer(question, word, tone, content)


def _next(result: EstimateValidation) -> Answer:
    question, (_, fit) = "What do I do next?", _worst(result)
    if fit >= WEAK_FIT:
        said = Text("For motions like those of these logs, as far ahead as the table says.")
        return Answer(question, "Use the estimate", "", [said])
    said = Text("Over short horizons it may still predict. What these logs say of the drive:")
    files = shlex.join(str(log.get("file") or "LOG") for log in result.provenance["inputs"])
    asked = Command(f"flexid identify {files}")
    return Answer(question, "Identify these logs as well", "", [said, asked])
