"""Two estimates side by side: what differs, and whether chance explains it.

Each difference has its own interval at 95 %. What is *changed* has to be so beside all others that
are compared (Holm): where nothing has changed, one comparison in twenty names anything at all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import flexid
from flexid.arms.result import ArmIdentification
from flexid.errors import SettingError
from flexid.identification.result import Identification
from flexid.identification.vocabulary.estimate import CONFIDENCE
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.stored_estimates.differences import (
    COMPARED,
    Difference,
    JointTest,
    Outcome,
    joint_test,
    with_numbers,
)
from flexid.stored_estimates.estimate_origins import (
    Sharing,
    doubts,
    reason_of,
    shared_logs,
    unlike_width,
)

Values = Mapping[str, ValueEstimate]


@dataclass(frozen=True)
class Comparison:
    """Two estimates side by side."""

    labels: tuple[str, str]  # what A and B are called: their files, if they have any
    models: tuple[str, str]  # which joint was identified in each
    parameters: Mapping[str, Difference]  # by name, in the order of A, then what B has beside that
    coefficients: Mapping[str, Difference]
    together: JointTest | None  # all coefficients of both at once; None where that cannot be tested
    logs: Sharing  # whether both were made from the same logs
    warnings: tuple[str, ...] = ()  # what limits the comparison
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def decisive(self) -> Mapping[str, Difference]:
        """What the answer rests on: the parameters, or where none is compared the coefficients."""
        if any(d.compared for d in self.parameters.values()):
            return self.parameters
        return self.coefficients

    def having(self, *outcomes: Outcome) -> tuple[Difference, ...]:
        """Decisive differences with one of some outcomes."""
        return tuple(d for d in self.decisive.values() if d.outcome in outcomes)

    @property
    def differ(self) -> bool:
        """Whether a change is established, or a contradiction: of one number or of all together."""
        together = self.together is not None and self.together.significant
        return together or bool(self.having("changed", "contradictory"))

    @property
    def lacking(self) -> tuple[Difference, ...]:
        """What one of the logs leaves open, so that nobody knows whether it has changed."""
        alike = self.models[0] == self.models[1]
        return tuple(
            d
            for d in self.decisive.values()
            if d.outcome == "not determined" or (alike and (d.a is None or d.b is None))
        )

    @property
    def agree(self) -> bool:
        """Whether all that is in both drives was compared, and no change is established."""
        some = any(d.compared for d in self.decisive.values())
        return some and not self.differ and not self.lacking


def compare_estimates(
    a: Identification | ArmIdentification,
    b: Identification | ArmIdentification,
    labels: tuple[str, str] = ("A", "B"),
) -> Comparison:
    """Compare two estimates number by number, and as a whole."""
    if _same(a, b):
        raise SettingError(
            "compare",
            f"{labels[0]} and {labels[1]} hold the same estimate: give two that differ in their "
            f"logs or settings",
        )
    logs = shared_logs(a.provenance, b.provenance)
    if a.model == "arm" and b.model == "arm" and a.arm.joints == b.arm.joints:
        both = (a.parameters, b.parameters)
        parameters, coefficients = _differences(both, both, logs, {}), {}
        fitted = {name: d for name, d in parameters.items() if name in a.sought}
    elif a.model != "arm" and b.model != "arm":
        parameters, coefficients = _of_joints(a, b, logs)
        fitted = coefficients
    else:
        raise SettingError(
            "compare",
            f"{labels[0]} and {labels[1]} are not of the same number of joints: give two estimates "
            f"of one joint, or two of arms with as many joints",
        )
    sound = [name for name, d in fitted.items() if d.compared]
    together = joint_test(a.fit, b.fit, sound) if logs == "different" else None
    chances = [] if together is None else [together.probability]
    decided = any(d.outcome in COMPARED for d in parameters.values())
    parameters, first = _judged(parameters, chances if decided else [], logs)
    coefficients, second = _judged(coefficients, [] if decided else chances, logs)
    if together is not None:
        together = replace(together, significant=(*first, *second)[0])
    return Comparison(
        labels,
        (a.model, b.model),
        parameters,
        coefficients,
        together,
        logs,
        tuple(doubts(a, b, logs)),
        {"flexid_version": flexid.__version__, "a": dict(a.provenance), "b": dict(b.provenance)},
    )


def _of_joints(
    a: Identification, b: Identification, logs: Sharing
) -> tuple[dict[str, Difference], dict[str, Difference]]:
    """Differences of parameters and coefficients of two joints."""
    unlike = unlike_width(a, b)
    whole = ({**a.removed, **a.parameters}, {**b.removed, **b.parameters})
    parameters = _differences(whole, (a.parameters, b.parameters), logs, unlike)
    if a.model != b.model and "rigid" in (a.model, b.model):  # names mean something else
        return parameters, {}
    both = (a.coefficients, b.coefficients)
    return parameters, _differences(both, both, logs, unlike)


def _same(a: Identification | ArmIdentification, b: Identification | ArmIdentification) -> bool:
    return (
        a.provenance == b.provenance
        and a.fit.names == b.fit.names
        and np.array_equal(a.fit.values, b.fit.values, equal_nan=True)
        and np.array_equal(a.fit.covariance, b.fit.covariance, equal_nan=True)
    )


def _differences(
    known: tuple[Values, Values],
    reported: tuple[Values, Values],
    logs: Sharing,
    unlike: Mapping[tuple[str, str], str],
) -> dict[str, Difference]:
    """Differences of all that either model has, by name."""
    names = dict.fromkeys([*reported[0], *reported[1]])
    found = {}
    for name in names:
        a, b = (values.get(name) for values in known)
        pairs = zip("AB", reported, strict=True)
        without = tuple(side for side, values in pairs if name not in values)
        unit = next(value.unit for value in (a, b) if value is not None)
        blank = Difference(name, unit, a, b, without)
        found[name] = with_numbers(blank, logs, reason_of(unlike, a, b))
    return found


def _judged(
    differences: Mapping[str, Difference], beside: Sequence[float], logs: Sharing
) -> tuple[dict[str, Difference], list[bool]]:
    """Outcomes that hold for all together, and the same for probabilities beside them (Holm)."""
    compared = [d for d in differences.values() if d.outcome in COMPARED]
    chances = [*(d.probability for d in compared), *beside]
    significant = holm(chances, 1.0 - CONFIDENCE)
    judged = dict(differences)
    for d, certain in zip(compared, significant, strict=False):
        outcome: Outcome = "compatible" if logs == "same" else "no change"
        if certain:
            outcome = "contradictory" if logs == "same" else "changed"
        elif logs != "same" and d.probability < 1.0 - CONFIDENCE:
            outcome = "perhaps changed"
        judged[d.name] = replace(d, outcome=outcome)
    return judged, significant[len(compared) :]


def holm(probabilities: Sequence[float], chance: float) -> list[bool]:
    """Which of several differences are significant, if any may be so by chance only this rarely."""
    found = [False] * len(probabilities)
    for rank, place in enumerate(np.argsort(probabilities)):
        if not probabilities[place] <= chance / (len(probabilities) - rank):
            break
        found[place] = True
    return found
