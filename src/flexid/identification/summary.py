"""What was chosen and why, in three sentences."""

from flexid.identification.alignment import Alignment, Delay
from flexid.identification.result import Choices

_HOLDS = {"zero": "held between samples", "linear": "on straight lines", "cubic": "smoothly"}


def summary(choices: Choices) -> tuple[str, str, str]:
    """Terms, alignment and estimator, a sentence each.

    Parameters
    ----------
    choices : Choices
        What was chosen.
    """
    return (
        _model_sentence(choices),
        _alignment_sentence(choices.alignment),
        _estimator_sentence(choices),
    )


def _model_sentence(choices: Choices) -> str:
    named = ", ".join(choices.terms) or "no further term"
    sentence = f"Model: {named}"
    kept = [e for e in choices.term_evidence if e.kept and not e.name.endswith("delay")]
    gone = [e for e in choices.term_evidence if not e.kept and not e.name.endswith("delay")]
    if kept and choices.term_evidence:
        least = min(kept, key=lambda e: abs(e.value) / e.std)
        sentence += f"; of these {least.name} is {_deviations(least.value, least.std)} from zero"
    if gone:
        most = max(gone, key=lambda e: abs(e.value) / e.std)
        sentence += f", of those left out {most.name} was {_deviations(most.value, most.std)}"
    return sentence + "."


def _deviations(value: float, std: float) -> str:
    ratio = abs(value) / std if std else float("inf")
    return f"{ratio:.2g} standard deviations" if ratio < 100.0 else "over 100 standard deviations"


def _alignment_sentence(alignment: Alignment) -> str:
    delays = [
        _delay("input", alignment.input_delay),
        _delay("link encoder", alignment.link_delay),
    ]
    return f"Time: the input runs {_HOLDS[alignment.hold]}; {', '.join(delays)}."


def _delay(channel: str, delay: Delay) -> str:
    if delay.status == "given":
        return f"{channel} {1e3 * delay.value:.3g} ms late, as given"
    if delay.status == "found":
        lower, upper = (1e3 * end for end in delay.interval)
        return f"{channel} {1e3 * delay.value:.3g} [{lower:.3g}, {upper:.3g}] ms late"
    return f"{channel} delay none"


def _estimator_sentence(choices: Choices) -> str:
    if choices.estimator == "least-squares":
        return (
            f"Estimator: least squares on filtered positions, filter rate "
            f"{choices.filter_rate:.3g} 1/s."
        )
    sentence = f"Estimator: prediction error over segments of {choices.segment_duration:.3g} s"
    if len(choices.segment_evidence) > 1:
        sentence += f", of {len(choices.segment_evidence)} lengths the one with narrowest intervals"
    return sentence + "."
