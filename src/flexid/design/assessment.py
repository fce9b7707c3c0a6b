"""How well a motion tells each coefficient: predicted deviation, partner, verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.analysis.excitation import Excitation, excitation_of_gram
from flexid.analysis.information import Information
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.result import Status
from flexid.identification.verdict import Evidence, verdict, worst
from flexid.models.flexible_joint import COEFFICIENT_UNITS

_CHANNELS = ("link_position", "motor_position", "deflection")


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
        return worst(c.status for c in self.coefficients.values())

    @property
    def weakest(self) -> CoefficientAssessment:
        """The coefficient told worst: by verdict, then by relative deviation."""
        rank = ("determined", "weak", "undetermined")
        return max(
            self.coefficients.values(),
            key=lambda c: (rank.index(c.status), c.relative_deviation),
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
    values = dict(zip(information.names, map(float, information.values), strict=True))
    deviations = dict(
        zip(information.names, map(float, information.standard_deviations), strict=True)
    )
    verdicts = {}
    for row in fit.rows:
        sizes = np.sqrt(np.diag(row.gram) / max(row.total_sum, np.finfo(float).tiny))
        evidence = Evidence(
            {name: values[name] for name in row.coefficients},
            {name: deviations[name] for name in row.coefficients},
            dict.fromkeys(row.coefficients, 0.0),
            dict(zip(row.coefficients, map(float, sizes), strict=True)),
            1.0,
            excitation[row.name],
            dict.fromkeys(_CHANNELS, float("nan")),  # nothing was validated: no evidence
            0.0,
        )
        verdicts |= {name: verdict(name, evidence) for name in row.coefficients}
    return Assessment(_coefficients(information, verdicts, input_unit), excitation)


def _coefficients(
    information: Information, verdicts: Mapping[str, tuple[Status, str]], input_unit: str
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
