"""Result of an identification: values, provenance, warnings, and a summary of the choices."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import isfinite, isnan
from typing import Any, Literal

import flexid
from flexid.estimators.excitation import Excitation
from flexid.identification.judgement import WEAK_FIT
from flexid.identification.preparation.joint import Kind
from flexid.identification.preparation.recordings import IDEAL, Alignment, Amplifier, Delay
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import (
    Compliance,
    Disturbances,
    Estimate,
    ModelError,
    SegmentEvidence,
    TermEvidence,
    Validation,
    ValueEstimate,
    Verdict,
)
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import ANGLE_ORIGIN, PERIODIC_TERMS, SHAPE_TERMS
from flexid.models.motion import JointType
from flexid.models.physical import values_with
from flexid.recording.recording import Caution, Hold, Log, Rank, Recording

Estimator = Literal["prediction-error", "innovations", "least-squares"]


@dataclass(frozen=True)
class Choices:
    """Choices that the identification made, with the evidence for them."""

    terms: tuple[str, ...]  # terms of the model
    alignment: Alignment  # hold and delays
    hold: Hold  # behaviour of the input between samples
    # given velocity in rad/s over which Coulomb friction changes sign; None for dry friction
    coulomb_velocity: float | None
    filter_rate: float  # rate λ of the state-variable filter in 1/s
    estimator: Estimator  # the estimator of the coefficients
    segment_duration: float | None  # length of the segments in s; None for least squares
    # evidence of the full model on each optional coefficient
    term_evidence: tuple[TermEvidence, ...]
    segment_evidence: tuple[SegmentEvidence, ...]  # one for each segment length tried
    # constants of the shapes of unusual terms, by name
    shapes: Mapping[str, float] = field(default_factory=dict)
    amplifier: Amplifier = IDEAL  # difference between the logged input and the input that acted


@dataclass(frozen=True)
class Identification:
    """Result of `flexid.identification.identify.identify`."""

    # kind of model: the flexible joint, its link alone (no input) or the rigid joint (one encoder)
    model: Kind
    coefficients: Mapping[str, ValueEstimate]  # by name, in the model's order
    parameters: Mapping[str, ValueEstimate]  # by name
    least_squares: Mapping[str, float]  # least-squares values for comparison, by coefficient
    excitation: Mapping[str, Excitation]  # by row name
    # by position: root mean square of the residual over its sensor's noise
    residual_excess: Mapping[str, float]
    model_error: ModelError  # model error that the residuals show
    # free run over the held-out end of each recording, with coefficients fitted without it
    validation: Validation
    compliance: Compliance  # whether the log shows that the joint is flexible
    # parameters of removed terms, with intervals
    removed: Mapping[str, ValueEstimate]
    fit: Estimate  # estimated coefficients: names, values, covariance and degrees of freedom
    choices: Choices  # choices made, with the evidence
    summary: tuple[str, ...]  # the choices and their reasons in three sentences
    # warnings, the one to act on first at the front
    warnings: tuple[str, ...]
    # version, settings, inputs with their hashes
    provenance: Mapping[str, Any] = field(default_factory=dict)
    # the data; empty for a streamed estimate or one loaded from a file
    recordings: tuple[Recording, ...] = ()
    # disturbances that were fitted; None for an exact fit
    disturbances: Disturbances | None = None
    joint: JointType = "revolute"  # type of motion, which determines the units of all values

    @property
    def verdict(self) -> Verdict:
        """The worst verdict on any value, except those of unusual terms that nobody asked for."""
        every, unasked = (*self.parameters.values(), *self.coefficients.values()), self._unasked
        found = {e.verdict for e in every if e.name.partition("[")[0] not in unasked}
        worst: tuple[Verdict, ...] = ("undetermined", "weak", "determined")
        return next(verdict for verdict in worst if verdict in found)

    @property
    def _unasked(self) -> frozenset[str]:
        """Names of the values of unusual terms that no setting asked for."""
        settings = self.provenance.get("settings", {})
        if settings.get("terms", "auto") != "auto":
            return frozenset()
        asked = {*settings.get("known", ()), *settings.get("bounds", ())}
        added = (SHAPE_TERMS[name] for name in self.choices.terms if name in SHAPE_TERMS)
        values = (values_with(term.coefficients) for term in added)
        return frozenset().union(*(names for names in values if names.isdisjoint(asked)))

    @property
    def given(self) -> frozenset[str]:
        """Coefficients that were not estimated."""
        found = self.coefficients.items()
        return frozenset(name.partition("[")[0] for name, c in found if c.std == 0.0)

    @property
    def input_unit(self) -> str:
        """Unit of the input; empty for the link alone."""
        gain = self.coefficients.get("beta1")
        return "" if gain is None else gain.unit.partition("/s^2/")[2].strip("()")

    @property
    def unexplained(self) -> bool:
        """Whether the residuals show an effect that no term describes."""
        return self.disturbances is not None or self.model_error.share > 0.0

    def supports(self, *, strict: bool = False) -> bool:
        """Whether `verdict` is determined or weak; if `strict`, whether it is determined."""
        return self.verdict == "determined" or (self.verdict == "weak" and not strict)


def provenance(
    logs: Sequence[Log], settings: Settings, model: Kind, choices: Choices
) -> dict[str, object]:
    """Return all that is needed to repeat the identification."""
    return {
        "flexid_version": flexid.__version__,
        "settings": asdict(settings),
        "chosen": {
            "model": model,
            "terms": list(choices.terms),
            "hold": choices.hold,
            "input_delay": choices.alignment.input_delay.value,
            "link_delay": choices.alignment.link_delay.value,
            "coulomb_velocity": choices.coulomb_velocity,
            "filter_rate": round(choices.filter_rate, 6),
            "estimator": choices.estimator,
            "segment_duration": choices.segment_duration,
        },
        "inputs": [log.provenance for log in logs],
    }


_HOLDS = {
    "zero": "is held between samples",
    "linear": "runs on straight lines",
    "cubic": "runs smoothly",
}


def summary(choices: Choices, model: Kind, *, asked: bool = False) -> tuple[str, str, str]:
    """Return one sentence each on terms, alignment and estimator."""
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
    """Return a term's name; for a periodic one also the origin of its angles."""
    origin = choices.shapes.get(ANGLE_ORIGIN, 0.0)
    if name not in PERIODIC_TERMS or not origin:
        return name
    return f"{name} (its angle counted from {origin:.5g})"


def _errors(value: float, std: float) -> str:
    ratio = abs(value) / std if std else float("inf")
    return f"{ratio:.2g} standard errors" if ratio < 100.0 else "over 100 standard errors"


def _alignment_sentence(alignment: Alignment, model: Kind) -> str:
    link = _delay("link encoder", alignment.link_delay)
    if model == "link":
        return f"Time: the motor's measured position drives the link; {link}{_doubt(alignment)}."
    delays = f"{_delay('input', alignment.input_delay)}, {link}"
    return f"Time: the input {_HOLDS[alignment.hold]}; {delays}."


def _doubt(alignment: Alignment) -> str:
    """Return text on the link delays that the log cannot tell from damping and friction."""
    lower, upper = (1e3 * end for end in alignment.link_delay.interval)
    if alignment.link_delay.status != "none" or lower == upper:
        return ""
    return (
        f", though {lower:.3g} to {upper:.3g} ms would look like damping and friction: give "
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


_SLIGHT = 1.005  # a smaller ratio would be printed as 1
_NOTED_SHARE = 0.02  # least unexplained share of a row's acceleration that is worth a warning

_SIGN_ADVICE = {
    "theta2": "an encoder is read late, or the sign of an angle is wrong",
    "alpha1": "an encoder is read late, or the sign of an angle is wrong",
    "beta1": "the sign of the input is probably wrong",
}


def sign_warnings(
    coefficients: Mapping[str, ValueEstimate], driving: Collection[str]
) -> Iterator[Caution]:
    """Warn of negative estimates of coefficients that are positive in any real drive."""
    for name, advice in _SIGN_ADVICE.items():
        if name in coefficients and coefficients[name].interval[1] < 0:
            yield Caution(
                f"{name} came out negative, which no spring or inertia can be: {advice}", Rank.SCALE
            )
    if driving:
        yield Caution(
            f"{', '.join(sorted(driving))} came out negative, which no friction can be: it takes "
            f"the place of an effect that no term here describes; the intervals allow for that",
            Rank.MODEL,
        )


def one_way_warnings(frictions: Collection[str]) -> Iterator[Caution]:
    """Warn of dry frictions that the log cannot separate from a constant input."""
    if frictions:
        yield Caution(
            "the drive turns one way under a constant input, so the log cannot separate it from "
            "dry friction; the intervals allow for that: record motion both ways",
            Rank.MODEL,
        )


def division_warnings(parameters: Mapping[str, ValueEstimate]) -> Iterator[Caution]:
    """Warn if the total inertia is known better than the motor's part of it."""
    motor = parameters.get("motor_inertia")
    if motor and motor.verdict != "determined" and "total_inertia" in parameters:
        yield Caution(
            "the log determines total_inertia better than its parts, link and motor: give the "
            "motor's, from its data sheet, with `--known motor_inertia=VALUE`, or move faster",
            Rank.MOTION,
        )


def amplifier_warnings(amplifier: Amplifier, unit: str) -> Iterator[Caution]:
    """Warn of corrections of the input for filter, dead zone and limit."""
    found = []
    filters = {
        "input": amplifier.log_lag,
        "link_position": amplifier.link_lag,
        "motor_position": amplifier.motor_lag,
    }
    for channel, lag in filters.items():
        if lag:
            yield Caution(
                f"the drive moves as if its {channel} had been low-passed into the log, by a "
                f"filter of {1e3 * lag:.2g} ms: it was corrected for that; to be sure, log it "
                f"unfiltered",
                Rank.NOTE,
            )
    if amplifier.dead_zone:
        found.append(f"a dead zone of {amplifier.dead_zone:.2g} {unit}")
    if amplifier.limit is not None:
        found.append(f"a limit of {amplifier.limit:.3g} {unit}")
    if amplifier.lag:
        found.append(f"a lag of {1e3 * amplifier.lag:.2g} ms")
    if found:
        yield Caution(
            f"the motor moves as if its amplifier had {' and '.join(found)}: the input was "
            f"corrected for that; to be sure, log what reaches the motor",
            Rank.NOTE,
        )


def validation_warnings(fit_percent: Mapping[str, float]) -> Iterator[Caution]:
    """Warn of channels that the free run does not reproduce."""
    still = [channel for channel, fit in fit_percent.items() if isnan(fit)]
    weak = {channel: fit for channel, fit in fit_percent.items() if fit < WEAK_FIT}
    if weak:
        shown = [f"{name} {f'{fit:.0f} %' if fit > 0 else 'not'}" for name, fit in weak.items()]
        yield Caution(
            f"in a free run over the held-out part, the model reproduces {', '.join(shown)}: it "
            f"lacks something that the drive has; see its predictions over shorter horizons",
            Rank.MODEL,
        )
    if still:
        yield Caution(
            f"{', '.join(still)} hardly moves in the held-out part, so the free run tests nothing "
            f"there: cut the log where its motion ends, or choose another --validation-share",
            Rank.DATA,  # before warnings that this part of the log causes
        )


def model_warnings(
    error: ModelError,
    model: Kind,
    widest: float,
    disturbances: Disturbances | None = None,
    thresholds: Thresholds = THRESHOLDS,
) -> Iterator[Caution]:
    """Warn of a model error.

    There is no warning if the excess is within the uncertainty of the sensors' noise and every
    interval is narrow.
    """
    if disturbances is not None:
        worst = max(disturbances.shares, key=lambda name: disturbances.shares[name])
        share = 100.0 * disturbances.shares[worst]
        if share >= 100.0 * _NOTED_SHARE:
            yield Caution(
                f"no term here describes {share:.0f} % of the {worst}'s acceleration: other axes, "
                f"backlash, a further bending mode or another friction law also move it; "
                f"the intervals allow for that",
                Rank.MODEL,
            )
        return
    small = error.excess <= thresholds.sensor_excess - 1.0 and widest <= thresholds.noted_width
    if error.share == 0.0 or small:
        return
    cause = (
        "the joint has an effect that no term here describes, or an encoder is less accurate than "
        "its resolution"
        if model == "link"
        else "the drive has an effect that no term here describes, or the recorded input differs "
        "from the one that acted, by noise, a lag or a limit"
    )
    ratio = (1.0 + error.excess) ** 0.5
    times = "slightly above" if ratio < _SLIGHT else f"{ratio:.3g} times"
    yield Caution(
        f"the residuals are {times} the sensors' noise: {cause}; the intervals allow for that",
        Rank.MODEL,
    )


def compliance_warnings(compliance: Compliance) -> Iterator[Caution]:
    """Warn if a log with two encoders shows no compliance."""
    if isfinite(compliance.deflection) and not compliance.visible:
        yield Caution(
            f"the log shows no compliance: {compliance.reason}; do not use the stiffness, check "
            f"the gear ratio and the scales, then drive the joint harder or log finer",
            Rank.MOTION,
        )
