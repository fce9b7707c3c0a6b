"""An identification as tables and sentences, and the evidence for ``--explain``."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import isclose, isfinite, isnan
from types import MappingProxyType
from typing import Any

from rich.text import Text

from flexid.estimators.excitation import Excitation
from flexid.identification.result import Choices, Identification
from flexid.identification.vocabulary.evidence import (
    Validation,
    ValueEstimate,
    Verdict,
)
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.motion import unit_of
from flexid.models.physical import ANGLES
from flexid.report.chart import Chart
from flexid.report.page import Answer, Command, Tone, logs_of
from flexid.report.terminal import (
    UNIT,
    VERDICT_STYLES,
    Column,
    Part,
    Table,
    format_fit,
    number,
    numbers,
    value_texts,
)
from flexid.stored_estimates.estimate_file import estimate_document

PARAMETERS, COEFFICIENTS = "Physical parameters", "Coefficients"


def parts(result: Identification) -> Iterator[Part]:
    """Return tables and sentences of the result."""
    yield estimates_table(PARAMETERS, result.parameters)
    yield estimates_table(COEFFICIENTS, result.coefficients)
    yield from verdict_reasons(result.coefficients)
    yield from negligible_line(result.parameters.values())
    yield ""
    yield from excitation_lines(result.excitation)
    yield from residual_lines(result)
    yield f"Free-run fit to held-out data: {format_fits(result.validation.fit_percent)}"
    yield from _horizons(result.validation)
    seen = "visible" if result.compliance.visible else "not visible"
    yield f"Compliance: {seen}; {result.compliance.reason}."
    if result.removed:
        bounds = []
        for name, parameter in result.removed.items():
            largest = max(map(abs, parameter.interval))
            below = f"below {largest:.2g} {parameter.unit}"
            bound = below if isfinite(largest) else "(not determined by this log)"
            bounds.append(f"{name} {bound}")
        yield f"Excluded terms, with upper bounds: {', '.join(bounds)}."
    yield ""
    yield from result.summary


def negligible_line(estimates: Iterable[ValueEstimate]) -> Iterator[str]:
    """Return a line on determined values whose interval includes zero, if there are any."""
    small = [
        found.name
        for found in estimates
        if found.verdict == "determined"
        and found.interval[0] < 0.0 < found.interval[1]
        and found.name not in ANGLES
    ]
    if small:
        yield f"  Negligible (the interval includes zero): {', '.join(small)}"


def verdict_reasons(estimates: Mapping[str, Any]) -> Iterator[Text]:
    """Return a line for each reason why values are weak or undetermined."""
    names: dict[tuple[str, Verdict], list[str]] = {}
    for name, e in estimates.items():
        if e.verdict != "determined":
            names.setdefault((e.reason, e.verdict), []).append(name)
    for (reason, verdict), alike in names.items():
        yield Text(f"  {', '.join(alike)}: {reason}", style=VERDICT_STYLES[verdict])


def excitation_lines(rows: Mapping[str, Excitation]) -> Iterator[str]:
    """Return the condition number of each row, and its two most correlated coefficients."""
    for row, excitation in rows.items():
        pair = " and ".join(excitation.correlated)
        detail = f"; {pair} correlate by {excitation.correlation:.3f}" if pair else ""
        yield f"Excitation, {row} row: condition number {excitation.condition_number:.3g}{detail}"


def residual_lines(result: Identification) -> Iterator[str]:
    """Return sentences on the residuals, and on the model error that they show."""
    if result.residual_excess:
        excess = ", ".join(f"{name} {x:.3g}" for name, x in result.residual_excess.items())
        yield f"Residual over sensor noise (ideal: 1): {excess}"
    if result.disturbances is None:
        error = result.model_error
        yield (
            f"Model error: {error.excess**0.5:.2g} times the sensors' noise, "
            f"{100 * error.share:.0f} % of it systematic"
            if error.share
            else "Model error: none visible in the residuals"
        )
        return
    shares = result.disturbances.shares.items()
    listed = ", ".join(f"{name} {100.0 * share:.2g} %" for name, share in shares)
    yield f"Unexplained acceleration: {listed}"
    if noise := result.disturbances.input_noise:
        yield f"Noise removed from the input: {noise:.2g} {result.input_unit}"


def _horizons(validation: Validation) -> Iterator[str]:
    """Return a line for each channel with its fits by prediction horizon."""
    if not validation.horizons:
        return
    spans = ", ".join(f"{horizon:g}" for horizon in validation.horizons)
    for channel in validation.fit_percent:
        fits = [found[channel] for found in validation.horizons.values()]
        if any(map(isnan, fits)):
            continue
        shown = ", ".join(f"{fit:.1f}" for fit in fits)
        yield f"Prediction over {spans} s: {channel} {shown} %"


def estimates_table(
    title: str,
    estimates: Mapping[str, ValueEstimate],
    more: Mapping[Column, Callable[[str], Text | str]] = MappingProxyType({}),
) -> Table:
    """Return values with intervals and verdicts; `more` adds columns by a function of the name."""
    usual = ("name", *numbers("value", "95 % interval"), UNIT, "verdict")
    table = Table(title, (*usual, *more))
    for name, e in estimates.items():
        value, interval = value_texts(e.value, *e.interval)
        if e.interval[0] == e.interval[1]:
            known = e.reason in ("given", "at its bound")
            interval = e.reason if known else "fixed"
        others = (text(name) for text in more.values())
        verdict = Text(e.verdict, VERDICT_STYLES[e.verdict])
        table.add(name, value, interval, e.unit, verdict, *others)
    return table


def format_fits(fits: Mapping[str, float]) -> str:
    """Return the free-run fits of all channels as text."""
    return ", ".join(f"{channel} {format_fit(fit)}" for channel, fit in fits.items())


_LEAST_PROBABILITY = 1e-6  # smaller probabilities are shown as "< 1e-06"


def evidence(result: Identification) -> Iterator[Part]:
    """Return the evidence for the choices: tables of the alternatives, and sentences."""
    choices = result.choices
    yield ""
    if choices.term_evidence:
        yield _terms(choices)
    if len(choices.segment_evidence) > 1:
        yield _segments(choices)
    yield _delays(result)
    if result.model != "link":
        yield f"Input hold {choices.hold}: {choices.alignment.hold_reason}"
    if choices.coulomb_velocity is not None:
        velocity = unit_of("rad/s", result.joint)
        yield f"Coulomb friction changes sign over {choices.coulomb_velocity:.3g} {velocity}"
    yield ""
    if found := result.disturbances:
        rows = ((name, number(100.0 * share, 2, "%")) for name, share in found.shares.items())
        yield Table("Unexplained acceleration, RMS", ("balance", *numbers("share")), rows)
        yield f"Fitted in the joint's band, one sample every {1e3 * found.sample_time:.3g} ms"
        yield ""
    if choices.estimator != "least-squares":
        yield _least_squares(result)


def _terms(choices: Choices) -> Table:
    columns = ("name", *numbers("value", "std", "p-value"), "in the model")
    table = Table("Terms and delays of the full model, in SI units", columns)
    for e in choices.term_evidence:
        kept = "yes" if e.kept else "no"
        std = number(e.std, 2) if isfinite(e.std) else "unknown"
        value, _ = value_texts(e.value, e.value - e.std, e.value + e.std)
        p = f"{e.probability:.2g}" if isfinite(e.probability) else "unknown"
        if e.probability < _LEAST_PROBABILITY:
            p = f"< {_LEAST_PROBABILITY:g}"
        table.add(e.name, value, std, p, kept)
    return table


def _segments(choices: Choices) -> Table:
    columns = ("length", *numbers("residual over noise", "mean relative std"), "")
    table = Table("Segment lengths of the prediction error", columns)
    for e in choices.segment_evidence:
        chosen = choices.segment_duration is not None and isclose(
            e.duration, choices.segment_duration
        )
        std = number(100 * e.std, 2, "%") if isfinite(e.std) else "unknown"
        length = number(e.duration, 3, "s")
        table.add(length, number(e.excess**0.5, 3), std, "chosen" if chosen else "")
    return table


def _delays(result: Identification) -> Table:
    columns = ("channel", *numbers("delay", "95 % interval"), "status")
    table = Table("Delays relative to the motor's encoder", columns)
    alignment = result.choices.alignment
    channels = {"input": alignment.input_delay, "link": alignment.link_delay}
    if result.model == "link":
        del channels["input"]
    for name, delay in channels.items():
        value, interval = value_texts(*(1e3 * x for x in (delay.value, *delay.interval)))
        table.add(name, f"{value} ms", f"{interval} ms", delay.status)
    return table


def _least_squares(result: Identification) -> Table:
    rate = result.choices.filter_rate
    columns = ("name", *numbers("estimate", "least squares"))
    table = Table(f"Least squares for comparison, filter rate {rate:.6g} 1/s", columns)
    for name, value in result.least_squares.items():
        estimate = result.coefficients[name]
        shown = (value_texts(each, *estimate.interval)[0] for each in (estimate.value, value))
        table.add(name, *shown)
    return table


document = estimate_document

_TITLES = {"flexible": "Flexible joint", "link": "Link of a flexible joint", "rigid": "Rigid joint"}


def heading(result: Identification) -> tuple[str, str]:
    """Return the kind of joint, and the files with the recorded duration."""
    named = logs_of(result.provenance)
    if result.recordings:
        duration = sum(len(r) * r.sample_time for r in result.recordings)
        named += f": {duration:.4g} s"
    slides = ", prismatic" if result.joint == "prismatic" else ""
    return _TITLES[result.model] + slides, named


def answers(result: Identification) -> tuple[Answer, Answer]:
    """Return whether the parameters can be trusted, and the next step."""
    lacking = [e for e in result.parameters.values() if e.verdict != "determined"]
    lacking = lacking or [e for e in result.coefficients.values() if e.verdict != "determined"]
    trust = Answer(
        "Can I trust the values?", *_judged(result, lacking), [*_grounds(result, lacking)]
    )
    return trust, _next_step(result, lacking)


def _judged(result: Identification, lacking: Sequence[ValueEstimate]) -> tuple[str, Tone]:
    if result.verdict == "undetermined":
        usable = any(p.verdict != "undetermined" for p in result.parameters.values())
        return ("Not all of them" if usable else "No"), "bad"
    if any(fit < 0.0 for fit in result.validation.fit_percent.values()):  # worse than the mean
        return "With care, and not for long predictions", "bad"
    if lacking or result.warnings:
        return "With care", "fair"
    return "Yes", "good"


def _grounds(result: Identification, lacking: Sequence[ValueEstimate]) -> Iterator[str]:
    """Return sentences on the intervals, the test on held-out data, and warnings."""
    yield (
        f"Weak or undetermined: {', '.join(e.name for e in lacking)}."
        if lacking
        else f"Each value is determined to ±{100 * THRESHOLDS.determined_width:g} % or negligible."
    )
    fits = {c: fit for c, fit in result.validation.fit_percent.items() if isfinite(fit)}
    if fits:
        worst = min(fits, key=lambda channel: fits[channel])
        yield f"Worst fit of the free run to held-out data: {fits[worst]:.1f} % ({worst})."
    else:
        yield "The held-out data have no motion, so the model was not tested."
    if result.warnings:
        yield "Read the warnings below."


def _next_step(result: Identification, lacking: Sequence[ValueEstimate]) -> Answer:
    """Return the next step: a test on another log, or a way to determine all parameters."""
    question = "What should I do next?"
    if not lacking:
        test = Command("flexid validate estimate.json NEXT.csv")
        return Answer(question, "Test the values on another log", "", [test])
    worst = min(lacking, key=lambda e: e.verdict)  # undetermined before weak
    word = "Record another motion"
    if result.unexplained:
        word = "Find the effect that the model lacks"
    reason = f"{worst.name}: {worst.reason}. To see if another motion would help, run"
    return Answer(question, word, "", [reason, Command("flexid excitation LOG.csv")])


def charts(result: Identification) -> Sequence[Chart]:
    """Return all charts for which the result has data; a loaded one has no time series."""
    # Imported late: a result that is only printed has no charts.
    from flexid.report.response_charts import bode_chart, fit_chart, residual_chart
    from flexid.stored_estimates.frequency_response import frequency_response

    bode = bode_chart(frequency_response(result))
    if not result.validation.runs:
        return (bode,)
    return fit_chart(result), residual_chart(result.validation, (result.joint,)), bode
