"""What was chosen and why, in three sentences."""

import numpy as np

from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.alignment import Alignment, Delay
from flexid.identification.intervals import Fitted
from flexid.identification.result import Choices, TermEvidence


def summary(choices: Choices, fit: Fitted, start: LeastSquaresFit) -> tuple[str, str, str]:
    """Terms, alignment and estimator, a sentence each.

    Parameters
    ----------
    choices : Choices
        What was chosen.
    fit : Fitted
        What is reported.
    start : LeastSquaresFit
        Least squares of the same data.
    """
    return (
        _model_sentence(choices),
        _alignment_sentence(choices.alignment),
        _estimator_sentence(choices, fit, start),
    )


def _model_sentence(choices: Choices) -> str:
    named = ", ".join(choices.terms) or "no further term"
    chosen = [e for e in choices.term_evidence if e.chosen]
    rejected = [e for e in choices.term_evidence if not e.chosen]
    if not choices.term_evidence:
        return f"Model: {named}, as given."
    sentence = f"Model: {named}"
    if chosen:
        least = min(chosen, key=_saved)
        sentence += f"; each saves {_percent(_saved(least))} or more of the free run's error"
    if rejected:
        best = max(rejected, key=_saved)
        saved = _saved(best)
        gain = f"would save {_percent(saved)}" if saved > 0 else "would save none"
        sentence += f", the next best, {best.term}, {gain}"
    return sentence + "."


def _alignment_sentence(alignment: Alignment) -> str:
    hold = "held between samples" if alignment.hold == "zero" else "on straight lines"
    delays = [
        _delay("input", alignment.input_delay),
        _delay("link encoder", alignment.link_delay),
    ]
    return f"Time: the input runs {hold}; {', '.join(delays)}."


def _delay(channel: str, delay: Delay) -> str:
    if delay.status == "given":
        return f"{channel} {1e3 * delay.value:.3g} ms late, as given"
    if delay.status == "found":
        lower, upper = (1e3 * end for end in delay.interval)
        return f"{channel} {1e3 * delay.value:.3g} [{lower:.3g}, {upper:.3g}] ms late, corrected"
    return f"{channel} delay {'unknown' if delay.status == 'unknown' else 'none'}"


def _estimator_sentence(choices: Choices, fit: Fitted, start: LeastSquaresFit) -> str:
    rate = f"filter rate {choices.filter_rate:.3g} 1/s"
    if choices.estimator == "least-squares":
        return f"Estimator: least squares on filtered positions, {rate}."
    sentence = f"Estimator: prediction error over segments of {choices.segment_duration:g} s"
    if len(choices.segment_evidence) > 2:
        sentence += f", the best of {len(choices.segment_evidence) - 1} lengths in a free run"
    return f"{sentence}; least squares ({rate}) {_agreement(fit, start)}."


def _agreement(fit: Fitted, start: LeastSquaresFit) -> str:
    """How far least squares is from what is reported, in its own standard deviations."""
    with np.errstate(invalid="ignore", divide="ignore"):
        distances = np.abs(fit.values - start.values) / start.standard_deviations
    usable = np.isfinite(distances)
    if not usable.any():
        return "cannot be compared"
    place = int(np.argmax(np.where(usable, distances, -1.0)))
    if distances[place] <= 3.0:
        return "agrees"
    return f"puts {fit.names[place]} {distances[place]:.0f} standard deviations off"


def _saved(evidence: TermEvidence) -> float:
    return 1 - evidence.with_term / evidence.without_term


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
