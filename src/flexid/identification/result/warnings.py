"""What the user should know before trusting the numbers."""

from collections.abc import Collection, Iterator, Mapping
from math import isfinite, isnan

from flexid.identification.full_model.amplifier import Amplifier
from flexid.identification.judgement.compliance import WEAK_FIT
from flexid.identification.preparation.joint import Kind
from flexid.identification.vocabulary.evidence import (
    CoefficientEstimate,
    Compliance,
    Disturbances,
    ModelError,
)
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.recording.caution import Caution, Rank

_SLIGHT = 1.005  # which would be printed as 1
_NOTED_SHARE = 0.02  # of a row's acceleration, unexplained, from which on it is worth a warning

_SIGN_ADVICE = {
    "theta2": "an encoder is read late, or the sign of an angle is wrong",
    "alpha1": "an encoder is read late, or the sign of an angle is wrong",
    "beta1": "the sign of the input is probably wrong",
}


def sign_warnings(
    coefficients: Mapping[str, CoefficientEstimate], driving: Collection[str]
) -> Iterator[Caution]:
    """Warn of coefficients that physics wants positive and the data want negative."""
    for name, advice in _SIGN_ADVICE.items():
        if name in coefficients and coefficients[name].interval[1] < 0:
            yield Caution(
                f"{name} came out negative, which no spring or inertia can be: {advice}", Rank.SCALE
            )
    if driving:
        yield Caution(
            f"{', '.join(sorted(driving))} came out negative, which no friction can be: it stands "
            f"for something that no term here describes; the intervals allow for that",
            Rank.MODEL,
        )


def amplifier_warnings(amplifier: Amplifier) -> Iterator[Caution]:
    """Warn of a voltage that was corrected before anything was fitted to it."""
    found = []
    if amplifier.dead_zone:
        found.append(f"a dead zone of {amplifier.dead_zone:.2g} V")
    if amplifier.limit is not None:
        found.append(f"a limit of {amplifier.limit:.3g} V")
    if found:
        yield Caution(
            f"the motor moves as if its amplifier had {' and '.join(found)}: the voltage was "
            f"corrected for that; to be sure, log the voltage at the motor",
            Rank.NOTE,
        )


def deflection_warnings(*, turned_round: bool) -> Iterator[Caution]:
    """Warn of a deflection of the wrong sign."""
    if turned_round:
        yield Caution(
            "the deflection has the wrong sign: with the other one it explains the link's motion, "
            "as it is it does not; give it scale = -1 in a column map (deflection is link angle "
            "less motor angle), and trust nothing here until then",
            Rank.SCALE,
        )


def validation_warnings(fit_percent: Mapping[str, float]) -> Iterator[Caution]:
    """Warn of channels that the free run does not repeat."""
    still = [channel for channel, fit in fit_percent.items() if isnan(fit)]
    weak = {channel: fit for channel, fit in fit_percent.items() if fit < WEAK_FIT}
    if weak:
        shown = [f"{name} {f'{fit:.0f} %' if fit > 0 else 'not'}" for name, fit in weak.items()]
        yield Caution(
            f"simulated freely over the held-out part, the model repeats {', '.join(shown)}: it "
            f"lacks something that the drive has; see how far it predicts over shorter horizons",
            Rank.MODEL,
        )
    if still:
        yield Caution(
            f"{', '.join(still)} hardly moves in the held-out part, so the free run tests nothing "
            f"there: cut the log where its motion ends, or choose another --validation-share",
            Rank.DATA,  # what is judged by that part follows from it
        )


def model_warnings(
    error: ModelError,
    model: Kind,
    widest: float,
    disturbances: Disturbances | None = None,
    thresholds: Thresholds = THRESHOLDS,
) -> Iterator[Caution]:
    """Warn of residuals that show a drive which no model here describes.

    One that is no larger than the sensors' noise is uncertain, and that leaves every interval
    narrow, is no cause for alarm.
    """
    if disturbances is not None:
        worst = max(disturbances.shares, key=lambda name: disturbances.shares[name])
        share = 100.0 * disturbances.shares[worst]
        if share >= 100.0 * _NOTED_SHARE:
            yield Caution(
                f"no term here describes {share:.0f} % of the {worst}'s acceleration: other axes, "
                f"backlash, a further bending mode or a friction of another law move it as well; "
                f"the intervals allow for that",
                Rank.MODEL,
            )
        return
    small = error.excess <= thresholds.sensor_excess - 1.0 and widest <= thresholds.noted_width
    if error.share == 0.0 or small:
        return
    cause = (
        "the joint has something that no term here describes, or an encoder is not as even as it "
        "is fine"
        if model == "link"
        else "the drive has something that no term here describes, or the input as recorded is not "
        "what acted, by noise, a lag or a limit"
    )
    yield Caution(
        f"the residuals are {_times(error)} the sensors' noise: {cause}; the intervals make "
        f"allowance for that",
        Rank.MODEL,
    )


def _times(error: ModelError) -> str:
    times = (1.0 + error.excess) ** 0.5
    return "slightly above" if times < _SLIGHT else f"{times:.3g} times"


def compliance_warnings(compliance: Compliance) -> Iterator[Caution]:
    """Warn where two encoders show no compliance."""
    if isfinite(compliance.deflection) and not compliance.visible:
        yield Caution(
            f"no compliance to see: {compliance.reason}; do not use the stiffness, check the gear "
            f"ratio and the scales, then drive the joint harder or log finer",
            Rank.MOTION,
        )
