"""The verdict on each coefficient: determined, weak or undetermined, and why.

Seven kinds of evidence count, and the worst decides:

- the interval: a coefficient is known if its standard deviation is small beside its value, or if
  what it could contribute to the motion within its interval is negligible (a friction that is
  zero is determined to be zero);
- the excitation: where the condition number of a row's normalised Gram matrix is beyond
  `LOST_CONDITION`, a step along the worst direction goes unseen, and whatever coefficient such a
  step would change is not known;
- the shift: in a right model the same coefficients explain the motion at every filter rate, over
  segments of every length, and to least squares as to prediction error; one that moves with any of
  these by more than noise allows makes up for what the model lacks, and makes its row weak;
- the residual: where a row leaves far more unexplained than the noise of the positions accounts
  for, the model or the recorded input lacks something, and the row is weak; to prediction error,
  which fits the rows together, all of them are;
- the alignment: where the delay between the encoders is known only so far that another would make a
  good part of the deflection, the log knows no stiffness;
- the sign: no spring, no inertia and no friction is negative;
- the validation: no interval covers a wrong model, so a row whose held-out motion the free run does
  not repeat knows no coefficient, and one that does not repeat the deflection knows no stiffness,
  and what stands beside it in a row only weakly: the spring's torque is what tells the two
  inertias apart.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite, isnan

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
"""Relative shift, beyond noise, up to which a coefficient is determined."""

NOISE_EXCESS = 5.0
"""Residual over what noise explains up to which a row's coefficients are determined."""

WEAK_FIT = 50.0
"""Free-run fit in per cent below which what it depends on is doubtful."""

LOST_FIT = 10.0
"""Free-run fit in per cent below which a model predicts hardly better than the mean."""

WEAK_DOUBT = 0.1
"""Share of the deflection that a delay could make, up to which a stiffness is determined."""

LOST_DOUBT = 0.3
"""Share of the deflection that a delay could make, up to which a stiffness is weakly determined."""

DISSIPATIVE = frozenset(
    {"alpha2", "theta_viscous", "theta_damping", "alpha_damping", "theta_coulomb", "alpha_coulomb"}
    | {"gamma_viscous", "gamma_coulomb"}
)
"""Frictions and dampings, which no drive has negative."""

NEGATIVE_DEVIATIONS = 2.0
"""Standard deviations below zero from which on a friction is no friction."""

_STIFFNESS = ("theta2", "alpha1")
_POSITIVE = (*_STIFFNESS, "beta1")
_TAINTED = 0.1  # relative change along a lost direction from which on a coefficient is not known

_CHANNELS = {"link": "link_position", "motor": "motor_position", "rigid": "motor_position"}

_RANK: dict[Status, int] = {"determined": 0, "weak": 1, "undetermined": 2}

Verdict = tuple[Status, str]

_FINE: Verdict = ("determined", "")


@dataclass(frozen=True)
class Evidence:
    """What is known about the coefficients of one row.

    Parameters
    ----------
    values, deviations : mapping of str to float
        Estimate and standard deviation of each coefficient.
    shifts : mapping of str to float
        How far each estimate moves with filter rate or segment length, beyond noise; in its own
        unit.
    sizes : mapping of str to float
        Root mean square of each regressor over that of the row's acceleration.
    residual_excess : float
        Residual of the row over what the noise of the positions explains.
    excitation : Excitation
        Of the row.
    fit_percent : mapping of str to float
        Free-run fit per channel.
    deflection_doubt : float
        Share of the deflection that another delay between the encoders could make.
    """

    values: Mapping[str, float]
    deviations: Mapping[str, float]
    shifts: Mapping[str, float]
    sizes: Mapping[str, float]
    residual_excess: float
    excitation: Excitation
    fit_percent: Mapping[str, float]
    deflection_doubt: float

    def relative(self, name: str, amount: float) -> float:
        """An amount of a coefficient as a share of its value."""
        value = self.values[name]
        return amount / abs(value) if value else np.inf

    def matters(self, name: str, amount: float) -> bool:
        """Whether an amount of a coefficient is more than a negligible share of the motion."""
        return amount * self.sizes[name] > NEGLIGIBLE_SHARE


def verdict(name: str, row: Evidence) -> Verdict:
    """Judge one coefficient of a row.

    Returns
    -------
    status : {"determined", "weak", "undetermined"}
    reason : str
        Empty for a determined coefficient.
    """
    rules = (
        *(_by_interval, _by_excitation, _by_shift, _by_residual),
        *(_by_alignment, _by_sign, _by_validation),
    )
    return max((rule(name, row) for rule in rules), key=lambda judged: _RANK[judged[0]])


def worst(statuses: Iterable[Status]) -> Status:
    """The worst of several verdicts: a parameter is no better known than its coefficients."""
    return max(statuses, key=_RANK.__getitem__)


def _by_interval(name: str, row: Evidence) -> Verdict:
    std = row.deviations[name]
    if not isfinite(std):
        return "undetermined", "the log holds no information on it"
    relative = row.relative(name, std)
    if relative <= DETERMINED_DEVIATION or not row.matters(name, std):
        return _FINE
    percent = f"its standard deviation is {100 * relative:.0f} % of its value"
    return ("weak" if relative <= WEAK_DEVIATION else "undetermined"), percent


def _by_excitation(name: str, row: Evidence) -> Verdict:
    if name not in row.excitation.coefficients:  # known beforehand, so not sought
        return _FINE
    condition = row.excitation.condition_number
    if condition <= WEAK_CONDITION or not _tainted(name, row):
        return _FINE
    others = " and ".join(c for c in row.excitation.confounded if c != name) or "zero"
    reason = f"confounded with {others} (condition number {condition:.1e})"
    return ("weak" if condition <= LOST_CONDITION else "undetermined"), reason


def _tainted(name: str, row: Evidence) -> bool:
    """Whether a step that doubles a confounded coefficient unseen changes this one too."""
    excitation = row.excitation
    step = dict(zip(excitation.coefficients, excitation.direction, strict=True))
    longest = max(abs(step[c]) / max(abs(row.values[c]), 1e-300) for c in excitation.confounded)
    unseen = row.relative(name, abs(step[name]) / longest)
    return name in excitation.confounded or unseen >= _TAINTED


def _by_shift(name: str, row: Evidence) -> Verdict:
    moved = {
        c: row.relative(c, shift)
        for c, shift in row.shifts.items()
        if row.relative(c, shift) > DETERMINED_SHIFT and row.matters(c, shift)
    }
    if not moved:
        return _FINE
    # What moves one coefficient biases its neighbours too, at every rate alike if need be.
    most = max(moved, key=moved.__getitem__)
    who, share = ("it", moved[name]) if name in moved else (f"{most} of its row", moved[most])
    return (
        "weak",
        f"{who} moves by {100 * share:.0f} % with how it is estimated: the model lacks something",
    )


def _by_residual(_: str, row: Evidence) -> Verdict:
    if row.residual_excess <= NOISE_EXCESS:
        return _FINE
    return "weak", f"the fit leaves {row.residual_excess:.0f} times what sensor noise explains"


def _by_alignment(name: str, row: Evidence) -> Verdict:
    if name not in _STIFFNESS or row.deflection_doubt <= WEAK_DOUBT:
        return _FINE
    share = f"{100 * min(row.deflection_doubt, 1.0):.0f} %"
    status: Status = "weak" if row.deflection_doubt <= LOST_DOUBT else "undetermined"
    return status, f"a delay between the encoders could make {share} of the deflection"


def _by_sign(name: str, row: Evidence) -> Verdict:
    value = row.values[name]
    if name in _POSITIVE and value < 0:
        return "undetermined", "it came out negative, which no spring or inertia can be"
    base = name.partition("[")[0]
    if base in DISSIPATIVE and value < -NEGATIVE_DEVIATIONS * row.deviations[name]:
        return (
            "weak",
            "it came out negative: no friction feeds energy in",
        )
    return _FINE


def _by_validation(name: str, row: Evidence) -> Verdict:
    channels = [_CHANNELS[row.excitation.row]]
    channels += ["deflection"] * (name in _STIFFNESS)
    # NaN marks a channel that rests while it is held out: it says nothing for or against.
    tested = {c: row.fit_percent[c] for c in channels if not isnan(row.fit_percent[c])}
    if not tested:
        return _FINE
    rests = name not in _STIFFNESS and any(c in row.values for c in _STIFFNESS)
    if rests and row.fit_percent["deflection"] <= LOST_FIT and tested[channels[0]] >= WEAK_FIT:
        return "weak", "the free run does not repeat the deflection, which its row rests on"
    channel = min(tested, key=tested.__getitem__)
    fit = tested[channel]
    shown = channel.replace("_", " ")
    if fit >= WEAK_FIT:
        return _FINE
    if fit > LOST_FIT:
        return "weak", f"the free run repeats only {fit:.0f} % of the held-out {shown}"
    how = "hardly" if fit > 0 else "no"
    return "undetermined", f"the free run predicts the held-out {shown} {how} better than its mean"
