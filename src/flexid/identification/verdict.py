"""The verdict on each coefficient: determined, weak or undetermined, and why.

Five kinds of evidence count, and the worst decides:

- the interval: a coefficient is known if its standard deviation is small beside its value, or if
  what it could contribute to the motion within its interval is negligible (a friction that is
  zero is determined to be zero);
- the excitation: where the condition number of a row's normalised Gram matrix is beyond
  `LOST_CONDITION`, a step along the worst direction goes unseen, and whatever coefficient such a
  step would change is not known;
- the filter: in a right model the same coefficients explain the motion at every filter rate; one
  that moves with the rate by more than noise allows makes up for what the model lacks, and is weak;
- the sign: no spring and no inertia is negative;
- the validation: no interval covers a wrong model, so a row whose held-out motion the free run does
  not repeat knows no coefficient, and one that does not repeat the deflection knows no stiffness.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite

import numpy as np

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION, Excitation
from flexid.identification.result import Status

DETERMINED_DEVIATION = 0.1
"""Relative standard deviation up to which a coefficient is determined."""

WEAK_DEVIATION = 0.5
"""Relative standard deviation up to which a coefficient is weakly determined."""

NEGLIGIBLE_SHARE = 0.02
"""Share of the row's acceleration below which the uncertainty of a term does not matter."""

DETERMINED_SHIFT = 0.05
"""Relative shift with the filter rate, beyond noise, up to which a coefficient is determined."""

WEAK_FIT = 50.0
"""Free-run fit in per cent below which what it depends on is doubtful."""

_STIFFNESS = ("theta2", "alpha1")
_POSITIVE = (*_STIFFNESS, "beta1")
_TAINTED = 0.1  # relative change along a lost direction from which on a coefficient is not known

_RANK: dict[Status, int] = {"determined": 0, "weak": 1, "undetermined": 2}

Verdict = tuple[Status, str]

_FINE: Verdict = ("determined", "")


@dataclass(frozen=True)
class Evidence:
    """What is known about one coefficient.

    Parameters
    ----------
    name : str
        Its name.
    values : mapping of str to float
        Estimates of all coefficients of its row.
    std : float
        Standard deviation of its estimate.
    shift : float
        How far the estimate moves with the filter rate, beyond noise; in its own unit.
    size : float
        Root mean square of its regressor over that of the row's acceleration.
    excitation : Excitation
        Of its row.
    fit_percent : mapping of str to float
        Free-run fit per channel.
    """

    name: str
    values: Mapping[str, float]
    std: float
    shift: float
    size: float
    excitation: Excitation
    fit_percent: Mapping[str, float]

    def relative(self, amount: float) -> float:
        """An amount of the coefficient as a share of its value."""
        value = self.values[self.name]
        return amount / abs(value) if value else np.inf


def verdict(evidence: Evidence) -> Verdict:
    """Judge one coefficient.

    Returns
    -------
    status : {"determined", "weak", "undetermined"}
    reason : str
        Empty for a determined coefficient.
    """
    rules = (_by_interval, _by_excitation, _by_filter, _by_sign, _by_validation)
    return max((rule(evidence) for rule in rules), key=lambda judged: _RANK[judged[0]])


def worst(statuses: Iterable[Status]) -> Status:
    """The worst of several verdicts: a parameter is no better known than its coefficients."""
    return max(statuses, key=_RANK.__getitem__)


def _by_interval(evidence: Evidence) -> Verdict:
    if not isfinite(evidence.std):
        return "undetermined", "the log holds no information on it"
    relative = evidence.relative(evidence.std)
    if relative <= DETERMINED_DEVIATION or evidence.std * evidence.size <= NEGLIGIBLE_SHARE:
        return _FINE
    percent = f"its standard deviation is {100 * relative:.0f} % of its value"
    return ("weak" if relative <= WEAK_DEVIATION else "undetermined"), percent


def _by_excitation(evidence: Evidence) -> Verdict:
    excitation = evidence.excitation
    condition = excitation.condition_number
    if condition <= WEAK_CONDITION or not _tainted(evidence):
        return _FINE
    others = " and ".join(c for c in excitation.confounded if c != evidence.name) or "zero"
    reason = f"confounded with {others} (condition number {condition:.1e})"
    return ("weak" if condition <= LOST_CONDITION else "undetermined"), reason


def _tainted(evidence: Evidence) -> bool:
    """Whether a step that doubles a confounded coefficient unseen changes this one too."""
    excitation = evidence.excitation
    step = dict(zip(excitation.coefficients, excitation.direction, strict=True))
    value = evidence.values
    longest = max(abs(step[c]) / max(abs(value[c]), 1e-300) for c in excitation.confounded)
    unseen = evidence.relative(abs(step[evidence.name]) / longest)
    return evidence.name in excitation.confounded or unseen >= _TAINTED


def _by_filter(evidence: Evidence) -> Verdict:
    relative = evidence.relative(evidence.shift)
    if relative <= DETERMINED_SHIFT or evidence.shift * evidence.size <= NEGLIGIBLE_SHARE:
        return _FINE
    return "weak", (
        f"it moves by {100 * relative:.0f} % with the filter rate: the model lacks something"
    )


def _by_sign(evidence: Evidence) -> Verdict:
    if evidence.name not in _POSITIVE or evidence.values[evidence.name] >= 0:
        return _FINE
    return "undetermined", "it came out negative, which no spring or inertia can be"


def _by_validation(evidence: Evidence) -> Verdict:
    channels = [f"{evidence.excitation.row}_position"]
    channels += ["deflection"] * (evidence.name in _STIFFNESS)
    fit, channel = min((evidence.fit_percent[channel], channel) for channel in channels)
    name = channel.replace("_", " ")
    if fit >= WEAK_FIT:
        return _FINE
    if fit > 0:
        return "weak", f"the free run repeats only {fit:.0f} % of the held-out {name}"
    return "undetermined", f"the free run predicts the held-out {name} no better than its mean"
