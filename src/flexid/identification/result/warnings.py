"""What the user should know before trusting the numbers."""

from collections.abc import Collection, Iterator, Mapping
from math import isfinite, isnan

from flexid.identification.judgement.compliance import WEAK_FIT
from flexid.identification.preparation.joint import Kind
from flexid.identification.vocabulary.evidence import (
    CoefficientEstimate,
    Compliance,
    LinkRow,
    ModelError,
)
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds

_SLIGHT = 1.005  # which would be printed as 1

_SIGN_ADVICE = {
    "theta2": "an encoder is read late, or the sign of an angle is wrong",
    "alpha1": "an encoder is read late, or the sign of an angle is wrong",
    "beta1": "the sign of the input is probably wrong",
}


def sign_warnings(
    coefficients: Mapping[str, CoefficientEstimate], driving: Collection[str]
) -> Iterator[str]:
    """Warn of coefficients that physics wants positive and the data want negative.

    Parameters
    ----------
    coefficients : mapping of str to CoefficientEstimate
    driving : collection of str
        Frictions that came out negative beyond noise.
    """
    for name, advice in _SIGN_ADVICE.items():
        if name in coefficients and coefficients[name].interval[1] < 0:
            yield f"{name} came out negative, which no spring or inertia can be: {advice}"
    if driving:
        yield (
            f"{', '.join(sorted(driving))} came out negative, which no friction can be: it stands "
            f"for something that no term here describes; the intervals allow for that"
        )


def deflection_warnings(*, turned_round: bool) -> Iterator[str]:
    """Warn of a deflection of the wrong sign."""
    if turned_round:
        yield (
            "the deflection has the wrong sign: with the other one it explains the link's motion, "
            "as it is it does not; give it scale = -1 in a column map (deflection is link angle "
            "less motor angle), and trust nothing here until then"
        )


def validation_warnings(fit_percent: Mapping[str, float]) -> Iterator[str]:
    """Warn of channels that the free run does not repeat."""
    for channel, fit in fit_percent.items():
        if isnan(fit):
            yield (
                f"the held-out {channel} hardly moves, so the free run tests nothing there: choose "
                f"another --validation-share, or record motion to the end"
            )
        elif fit < WEAK_FIT:
            what = f"repeats {fit:.0f} %" if fit > 0 and isfinite(fit) else "repeats nothing"
            yield (
                f"the free run {what} of the held-out {channel}: over so long a time the model "
                f"lacks something the drive has; see how far it predicts over shorter horizons"
            )


def model_warnings(
    error: ModelError,
    model: Kind,
    widest: float,
    link_row: LinkRow | None = None,
    thresholds: Thresholds = THRESHOLDS,
) -> Iterator[str]:
    """Warn of residuals that show a drive which no model here describes.

    One that is no larger than the sensors' noise is uncertain, and that leaves every interval
    narrow, is no cause for alarm.

    Parameters
    ----------
    error : ModelError
        What they show.
    model : {"flexible", "link", "rigid"}
        What was fitted.
    widest : float
        Half the widest interval with the allowance for it, as `judgement.estimates` has it.
    link_row : LinkRow, optional
        The link's row alone.
    thresholds : Thresholds, optional
        How large the one and how wide the other has to be.
    """
    taken = link_row.alone if link_row is not None and link_row.taken else {}
    small = error.excess <= thresholds.sensor_excess - 1.0 and widest <= thresholds.noted_width
    if small and not taken:
        return
    if error.share > 0.0 and model == "link":
        yield (
            f"the residuals are {_times(error)} the sensors' noise: the joint has something that "
            f"no term here describes, or an encoder is not as even as it is fine; the intervals "
            f"make allowance for that"
        )
    elif error.share > 0.0:
        alone = ", and --model link does without motor and input" if model == "flexible" else ""
        if taken:
            alone = (
                "; the link's row alone, driven by the motor's measured motion, knows "
                f"{', '.join(taken)} better, so these are taken from it"
            )
        yield (
            f"the residuals are {_times(error)} the sensors' noise, and not as noise of the torque "
            f"would make them: the drive has something that no term here describes, or the input "
            f"as recorded is not what acted; the intervals make allowance for that{alone}"
        )


def _times(error: ModelError) -> str:
    times = (1.0 + error.excess) ** 0.5
    return "slightly above" if times < _SLIGHT else f"{times:.3g} times"


def compliance_warnings(compliance: Compliance) -> Iterator[str]:
    """Warn where two encoders show no compliance."""
    if isfinite(compliance.deflection) and not compliance.visible:
        yield (
            f"no compliance to see: {compliance.reason}; trust no stiffness, and excite the joint "
            f"harder or log finer"
        )
