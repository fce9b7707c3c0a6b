"""How well a motion tells each coefficient: predicted deviation, partner, verdict."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.analysis.excitation import (
    LOST_CONDITION,
    WEAK_CONDITION,
    Excitation,
    excitation_of_gram,
)
from flexid.analysis.information import Information
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.estimates import row_sizes
from flexid.identification.judgement import THRESHOLDS, Verdict, verdict
from flexid.identification.result import Status
from flexid.models.flexible_joint import COEFFICIENT_UNITS

_DEVIATIONS = 2.0  # half the width of a predicted interval

DETERMINED_DEVIATION = THRESHOLDS.determined_width / _DEVIATIONS
"""Relative standard deviation up to which a coefficient is determined."""

WEAK_DEVIATION = THRESHOLDS.weak_width / _DEVIATIONS
"""Relative standard deviation up to which a coefficient is weakly determined."""

_TAINTED = 0.1  # relative change along a lost direction from which on a coefficient is not known
_TINY = 1e-300

_RANK: tuple[Status, ...] = ("determined", "weak", "undetermined")


@dataclass(frozen=True)
class CoefficientAssessment:
    """How well one coefficient can be told.

    Parameters
    ----------
    name : str
        The coefficient.
    unit : str
        Its SI unit.
    value : float
        Its estimate, in the unit.
    relative_deviation : float
        Predicted standard deviation over the value.
    relative_deviation_alone : float
        The same if all other coefficients were known.
    inflation : float
        Ratio of the two: what the others cost.
    partner : str
        The coefficient whose estimate correlates the most with this one's; empty if it is alone.
    correlation : float
        That correlation, between -1 and 1.
    status : {"determined", "weak", "undetermined"}
        Whether deviation and excitation allow to tell it.
    reason : str
        Why not; empty if it is determined.
    """

    name: str
    unit: str
    value: float
    relative_deviation: float
    relative_deviation_alone: float
    inflation: float
    partner: str
    correlation: float
    status: Status
    reason: str


@dataclass(frozen=True)
class Assessment:
    """How well all coefficients can be told.

    Parameters
    ----------
    coefficients : mapping of str to CoefficientAssessment
        By name, in the model's order.
    excitation : mapping of str to Excitation
        Assumption (A4) of Huang (2003), measured, by row name.
    """

    coefficients: Mapping[str, CoefficientAssessment]
    excitation: Mapping[str, Excitation]

    @property
    def status(self) -> Status:
        """The worst of all verdicts."""
        return max((c.status for c in self.coefficients.values()), key=_RANK.index)

    @property
    def weakest(self) -> CoefficientAssessment:
        """The coefficient told worst: by verdict, then by relative deviation."""
        return max(
            self.coefficients.values(),
            key=lambda c: (_RANK.index(c.status), c.relative_deviation),
        )

    def without_lost(self) -> "Assessment":
        """The same, with no deviation claimed where even the values are a guess."""
        unknown = float("inf")
        coefficients = {
            name: replace(c, relative_deviation=unknown, inflation=unknown)
            if c.status == "undetermined"
            else c
            for name, c in self.coefficients.items()
        }
        return Assessment(coefficients, self.excitation)


def assess(information: Information, fit: LeastSquaresFit, input_unit: str) -> Assessment:
    """Join what positions could tell with what least squares saw of the rows.

    Parameters
    ----------
    information : Information
        Of a motion.
    fit : LeastSquaresFit
        Of the same motion and model: its Gram matrices measure the excitation.
    input_unit : str
        Unit of the input, which is part of some coefficients' units.
    """
    excitation = {
        row.name: excitation_of_gram(row.name, row.coefficients, row.gram / row.count)
        for row in fit.rows
    }
    verdicts = _verdicts(information, row_sizes(fit.rows), excitation.values())
    return Assessment(_coefficients(information, verdicts, input_unit), excitation)


def _verdicts(
    information: Information, sizes: Mapping[str, float], rows: Iterable[Excitation]
) -> dict[str, Verdict]:
    """The worse of what the interval and the excitation of its row say of each coefficient."""
    values = dict(zip(information.names, map(float, information.values), strict=True))
    found = {}
    for name, std in zip(information.names, information.standard_deviations, strict=True):
        half = _DEVIATIONS * float(std)
        ends = values[name] - half, values[name] + half
        found[name] = verdict(values[name], ends, half * sizes[name])
    for row in rows:
        for name in row.coefficients:
            judged = found[name], _by_excitation(name, values, row)
            found[name] = max(judged, key=lambda one: _RANK.index(one[0]))
    return found


def _by_excitation(name: str, values: Mapping[str, float], row: Excitation) -> Verdict:
    """What a nearly lost direction leaves: a prediction holds for a right model and white noise."""
    condition = row.condition_number
    if condition <= WEAK_CONDITION or not _tainted(name, values, row):
        return "determined", ""
    others = " and ".join(c for c in row.confounded if c != name) or "zero"
    reason = f"confounded with {others} (condition number {condition:.1e})"
    return ("weak" if condition <= LOST_CONDITION else "undetermined"), reason


def _tainted(name: str, values: Mapping[str, float], row: Excitation) -> bool:
    """Whether a step that doubles a confounded coefficient unseen changes this one too."""
    step = dict(zip(row.coefficients, row.direction.tolist(), strict=True))
    relative = {c: abs(step[c]) / max(abs(values[c]), _TINY) for c in row.coefficients}
    longest = max(relative[c] for c in row.confounded)
    return name in row.confounded or relative[name] >= _TAINTED * longest


def _coefficients(
    information: Information, verdicts: Mapping[str, Verdict], input_unit: str
) -> dict[str, CoefficientAssessment]:
    names = information.names
    shown_unit = f"({input_unit})" if " " in input_unit else input_unit
    with np.errstate(divide="ignore"):
        alone = information.deviations_alone / np.abs(information.values)
    found = {}
    for place, name in enumerate(names):
        partner, correlation = _partner(names, information.correlations, place)
        found[name] = CoefficientAssessment(
            name,
            COEFFICIENT_UNITS[name].format(input=shown_unit),
            float(information.values[place]),
            float(information.relative_deviations[place]),
            float(alone[place]),
            float(information.inflation[place]),
            partner,
            correlation,
            *verdicts[name],
        )
    return found


def _partner(names: Sequence[str], correlations: np.ndarray, place: int) -> tuple[str, float]:
    if len(names) == 1:
        return "", 0.0
    own = np.abs(correlations[place])
    own[place] = -1.0
    other = int(np.argmax(own))
    return names[other], float(correlations[place, other])
