"""The verdict on each coefficient: determined, weak or undetermined, and why.

Three kinds of evidence count, and the worst decides:

- the interval: a coefficient is known if its standard deviation is small beside its value, or if
  what it could contribute to the motion within its interval is negligible (a friction that is
  zero is determined to be zero);
- the excitation: where the condition number of a row's normalised Gram matrix is beyond
  `LOST_CONDITION`, the coefficients that make up the worst direction cannot be told apart;
- the validation: a model that does not repeat the held-out deflection knows no stiffness, however
  narrow the interval, because no interval covers a wrong model.
"""

from collections.abc import Iterable, Mapping
from math import isfinite

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION, Excitation
from flexid.identification.result import Status

DETERMINED_DEVIATION = 0.1
"""Relative standard deviation up to which a coefficient is determined."""

WEAK_DEVIATION = 0.5
"""Relative standard deviation up to which a coefficient is weakly determined."""

NEGLIGIBLE_SHARE = 0.02
"""Share of the row's acceleration below which the uncertainty of a term does not matter."""

WEAK_FIT = 50.0
"""Free-run fit of the deflection in per cent below which the stiffness is doubtful."""

_STIFFNESS = ("theta2", "alpha1")

_RANK: dict[Status, int] = {"determined": 0, "weak": 1, "undetermined": 2}

Verdict = tuple[Status, str]


def verdict(
    name: str,
    value: float,
    std: float,
    share: float,
    excitation: Excitation,
    fit_percent: Mapping[str, float],
) -> Verdict:
    """Judge one coefficient.

    Parameters
    ----------
    name : str
        Its name.
    value, std : float
        Estimate and standard deviation.
    share : float
        Root mean square of std times its regressor, over that of the row's acceleration.
    excitation : Excitation
        Of its row.
    fit_percent : mapping of str to float
        Free-run fit per channel.

    Returns
    -------
    status : {"determined", "weak", "undetermined"}
    reason : str
        Empty for a determined coefficient.
    """
    verdicts = (
        _by_interval(value, std, share),
        _by_excitation(name, excitation),
        _by_validation(name, fit_percent["deflection"]),
    )
    return max(verdicts, key=lambda judged: _RANK[judged[0]])


def worst(statuses: Iterable[Status]) -> Status:
    """The worst of several verdicts: a parameter is no better known than its coefficients."""
    return max(statuses, key=_RANK.__getitem__)


def _by_interval(value: float, std: float, share: float) -> Verdict:
    if not isfinite(std):
        return "undetermined", "the log holds no information on it"
    relative = std / abs(value) if value else float("inf")
    if relative <= DETERMINED_DEVIATION or share <= NEGLIGIBLE_SHARE:
        return "determined", ""
    percent = f"its standard deviation is {100 * relative:.0f} % of its value"
    return ("weak" if relative <= WEAK_DEVIATION else "undetermined"), percent


def _by_excitation(name: str, excitation: Excitation) -> Verdict:
    condition = excitation.condition_number
    if condition <= WEAK_CONDITION or name not in excitation.confounded:
        return "determined", ""
    others = " and ".join(c for c in excitation.confounded if c != name) or "zero"
    reason = f"confounded with {others} (condition number {condition:.1e})"
    return ("weak" if condition <= LOST_CONDITION else "undetermined"), reason


def _by_validation(name: str, fit: float) -> Verdict:
    if name not in _STIFFNESS or fit >= WEAK_FIT:
        return "determined", ""
    if fit > 0:
        return "weak", f"the free run repeats only {fit:.0f} % of the held-out deflection"
    return "undetermined", "the free run predicts the held-out deflection no better than its mean"
