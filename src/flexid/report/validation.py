"""A validation as tables, JSON, figures and a page."""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf, isfinite, isinf, isnan
from pathlib import Path
from typing import Any

from flexid.arrays import plain
from flexid.identification.judgement.compliance import WEAK_FIT
from flexid.identification.vocabulary.evidence import Validation
from flexid.report.chart import Chart
from flexid.report.identification_page import input_facts
from flexid.report.page import Answer, Command, Page, Presenter, Section, drawn, sections_of
from flexid.report.response_charts import free_run_chart, residual_chart
from flexid.report.terminal import Cell, Column, Part, Table, number, numbers
from flexid.stored_estimates.validate_estimate import EstimateValidation


def parts(result: EstimateValidation) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield fits_table(result)
    yield from errors_parts(result)


def fits_table(result: Validation) -> Table:
    """How much of each channel is predicted, by horizon."""
    fits = {**result.horizons, inf: result.fit_percent}
    columns = (Column("channel"), *numbers(*map(_horizon, fits)))
    table = Table("Prediction fit by horizon (%)", columns)
    for channel in result.fit_percent:
        table.add(channel, *(_fit(found[channel]) for found in fits.values()))
    return table


def errors_parts(result: EstimateValidation) -> Iterator[Part]:
    """What the predictions are off, and what they begin with."""
    columns = (Column("channel"), *numbers("sensor noise", *map(_horizon, result.residuals)))
    table = Table("Prediction error by horizon (rad, RMS)", columns)
    for channel, noise in result.noise.items():
        off = (found[channel] for found in result.residuals.values())
        table.add(channel, number(noise, 3), *(number(x, 3) if isfinite(x) else "–" for x in off))
    yield table
    worst, fit = _worst(result)
    if worst and not fit >= WEAK_FIT:
        yield (
            f"The estimate does not describe this drive: the free run explains {fit:.3g} "
            f"% of {worst}. Identify these logs, and compare both estimates."
        )
    count = len(result.runs)
    yield (
        f"{count} recording{'s' if count > 1 else ''} of {_drive(result)}. Each "
        f"prediction starts from the state that the half second before it shows."
    )


def _drive(result: EstimateValidation) -> str:
    return "an arm" if result.model == "arm" else f"a {result.model} joint"


def _horizon(horizon: float) -> str:
    return "free run" if isinf(horizon) else f"{horizon:g} s"


def _fit(fit: float) -> str | Cell:
    if isnan(fit):
        return "at rest"
    if not isfinite(fit):
        return "diverges"
    return f"{fit:.2f}" if fit > -1000.0 else number(fit, 3)


def page(
    result: EstimateValidation, charts: Sequence[Chart], command: str = "", _out: str = ""
) -> Page:
    """What there is to say of a validation."""
    logs = [Path(log["file"]).name for log in result.provenance["inputs"] if log.get("file")]
    residuals = [*drawn(charts, "residuals"), *errors_parts(result)]
    sections = (
        Section("fit", "Measured and predicted", drawn(charts, "validation")),
        Section("residuals", "Residuals", residuals),
    )
    return Page(
        "validation",
        f"Estimate of {_drive(result)} on other logs",
        ", ".join(logs) or "data in memory",
        fits_table(result),
        (_predicts(result), _next(result)),
        sections_of(result.warnings, sections, command, input_facts(result.provenance)),
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
        return Answer(question, "Nothing moves", "bad", ["Every channel is at rest."])
    tone = "bad" if not fit >= WEAK_FIT else "fair" if result.warnings else "good"
    word = f"{fit:.2f} %" if isfinite(fit) and fit > 0.0 else "Nothing"
    rest = ", and more of the rest" if len(result.fit_percent) > 1 else ""
    content = [f"Of the {channel.replace('_', ' ')} in a free run{rest}."]
    noise = {
        c: off / result.noise[c]
        for c, off in result.residuals[float("inf")].items()
        if result.noise.get(c) and isfinite(off)
    }
    if noise:
        most = max(noise.values())
        content.append(f"The error is at most {most:.3g} times the sensor noise.")
    return Answer(question, word, tone, content)


def _next(result: EstimateValidation) -> Answer:
    question, (_, fit) = "What do I do next?", _worst(result)
    if fit >= WEAK_FIT:
        said = "For motions like those of these logs, as far ahead as the table says."
        return Answer(question, "Use the estimate", "", [said])
    said = "Over short horizons it may still predict. What these logs say of the drive:"
    files = shlex.join(str(log.get("file") or "LOG") for log in result.provenance["inputs"])
    model = " --model arm.toml" if result.model == "arm" else ""
    asked = Command(f"flexid identify {files}{model}")
    return Answer(question, "Identify these logs as well", "", [said, asked])


def charts(result: EstimateValidation) -> tuple[Chart, Chart]:
    """Free run over each log, and its residuals."""
    return fit_chart(result), residual_chart(result)


def fit_chart(result: EstimateValidation) -> Chart:
    """Free run over each log, channel by channel, with the residual below."""
    title = "Free run of the estimate over other logs"
    return free_run_chart("validation", title, result, result.noise)


def document(result: EstimateValidation) -> dict[str, Any]:
    """Fits and residuals, for JSON."""
    made = plain(replace(result, runs=()))
    del made["runs"]
    return made


PRESENTER = Presenter(parts, document, charts, page)
