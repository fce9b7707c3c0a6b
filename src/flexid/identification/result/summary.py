"""What was chosen and why, in three sentences."""

from flexid.identification.preparation.alignment import Alignment, Delay
from flexid.identification.preparation.joint import Kind
from flexid.identification.result.identification import Choices
from flexid.models.flexible_joint import RIPPLE_ORIGIN

_HOLDS = {"zero": "held between samples", "linear": "on straight lines", "cubic": "smoothly"}


def summary(choices: Choices, model: Kind, *, asked: bool = False) -> tuple[str, str, str]:
    """Terms, alignment and estimator, a sentence each."""
    return (
        _model_sentence(choices, model, asked=asked),
        _alignment_sentence(choices.alignment, model),
        _estimator_sentence(choices),
    )


def _model_sentence(choices: Choices, model: Kind, *, asked: bool) -> str:
    named = ", ".join(_term(name, choices) for name in choices.terms) or "no further term"
    why = "as the settings say" if asked else "since the log has no input"
    alone = f"the link alone, {why}, with " if model == "link" else ""
    sentence = f"Model: {alone}{named}."
    kept = [e for e in choices.term_evidence if e.kept and not e.name.endswith("delay")]
    gone = [e for e in choices.term_evidence if not e.kept and not e.name.endswith("delay")]
    if kept:
        least = min(kept, key=lambda e: abs(e.value) / e.std)
        sentence += f" Least certain: {least.name}, {_errors(least.value, least.std)} from zero."
    if gone:
        most = max(gone, key=lambda e: abs(e.value) / e.std)
        sentence += f" Largest excluded: {most.name}, {_errors(most.value, most.std)} from zero."
    return sentence


def _term(name: str, choices: Choices) -> str:
    """A term; of a ripple, from where its angle counts."""
    origin = choices.shapes.get(RIPPLE_ORIGIN, 0.0)
    if name != "torque_ripple" or not origin:
        return name
    return f"{name} (its angle counted from {origin:.5g} rad)"


def _errors(value: float, std: float) -> str:
    ratio = abs(value) / std if std else float("inf")
    return f"{ratio:.2g} standard errors" if ratio < 100.0 else "over 100 standard errors"


def _alignment_sentence(alignment: Alignment, model: Kind) -> str:
    link = _delay("link encoder", alignment.link_delay)
    if model == "link":
        return f"Time: the motor's measured position drives the link; {link}{_doubt(alignment)}."
    delays = f"{_delay('input', alignment.input_delay)}, {link}"
    return f"Time: the input runs {_HOLDS[alignment.hold]}; {delays}."


def _doubt(alignment: Alignment) -> str:
    """What the link alone cannot tell from a delay."""
    lower, upper = (1e3 * end for end in alignment.link_delay.interval)
    if alignment.link_delay.status != "none" or lower == upper:
        return ""
    return (
        f", though one of {lower:.3g} to {upper:.3g} ms would pass for damping and friction: give "
        f"--link-delay if you know it"
    )


def _delay(channel: str, delay: Delay) -> str:
    if delay.status == "given":
        return f"{channel} {1e3 * delay.value:.3g} ms late, as given"
    if delay.status == "found":
        value, lower, upper = (1e3 * each for each in (delay.value, *delay.interval))
        digits = next((d for d in range(3, 9) if f"{lower:.{d}g}" != f"{upper:.{d}g}"), 9)
        ends = f"{lower:.{digits}g}, {upper:.{digits}g}"
        return f"{channel} {value:.{digits}g} [{ends}] ms late"
    return f"{channel} delay none"


def _estimator_sentence(choices: Choices) -> str:
    if choices.estimator == "least-squares":
        return (
            f"Estimator: least squares on filtered positions, filter rate "
            f"{choices.filter_rate:.3g} 1/s."
        )
    if choices.estimator == "innovations":
        return "Estimator: innovations in the joint's band, with disturbances of each balance."
    sentence = f"Estimator: prediction error over segments of {choices.segment_duration:.3g} s"
    if len(choices.segment_evidence) > 1:
        sentence += f", of {len(choices.segment_evidence)} lengths the one with narrowest intervals"
    return sentence + "."
