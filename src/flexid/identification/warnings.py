"""What the user should know before trusting the numbers."""

from collections.abc import Iterator, Mapping
from math import isnan

from flexid.identification.result import CoefficientEstimate, Compliance
from flexid.identification.verdict import WEAK_FIT

WARNED_EXCESS = 1.5
"""Residual over what noise explains from which a row earns a warning."""

_SIGN_ADVICE = {
    "theta2": "the sign of the deflection is probably wrong",
    "alpha1": "the sign of the deflection is probably wrong",
    "beta1": "the sign of the input is probably wrong",
}


def sign_warnings(coefficients: Mapping[str, CoefficientEstimate]) -> Iterator[str]:
    """Warn of coefficients that physics wants positive and the data want negative."""
    for name, advice in _SIGN_ADVICE.items():
        if name in coefficients and coefficients[name].interval[1] < 0:
            yield f"{name} came out negative, which no spring or inertia can be: {advice}"


def validation_warnings(fit_percent: Mapping[str, float]) -> Iterator[str]:
    """Warn of channels that the free run does not repeat."""
    for channel, fit in fit_percent.items():
        if isnan(fit):
            yield (
                f"the held-out {channel} hardly moves, so the free run tests nothing there: choose "
                f"another --validation-share, or record motion to the end"
            )
        elif fit < WEAK_FIT:
            yield (
                f"the free run repeats {max(fit, 0):.0f} % of the held-out {channel}: the model "
                f"lacks something the drive has (try further terms), or the coefficients are off"
            )


def residual_warnings(residual_excess: Mapping[str, float]) -> Iterator[str]:
    """Warn of rows that leave more unexplained than the noise of the positions accounts for."""
    for row, excess in residual_excess.items():
        if excess > WARNED_EXCESS:
            yield (
                f"the {row} row leaves {excess:.1f} times the residual that sensor noise explains: "
                f"a term is missing, or the input as recorded is not what acted (delayed, noisy, "
                f"filtered); the intervals do not cover that"
            )


def compliance_warnings(compliance: Compliance) -> Iterator[str]:
    """Warn where two encoders show no compliance."""
    if compliance.rigid_fit_percent and not compliance.visible:
        yield (
            f"no compliance to see: {compliance.reason}; trust no stiffness, and excite the joint "
            f"harder or log finer"
        )
