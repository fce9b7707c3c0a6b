"""Two estimates side by side."""

from collections.abc import Mapping
from os import PathLike
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexid.library.answer import PlottedAnswer, ReportedAnswer, TabularAnswer
from flexid.library.entrance import entrance
from flexid.library.estimates import estimated

if TYPE_CHECKING:
    from flexid.comparisons.comparison import Comparison
    from flexid.comparisons.number_difference import Difference
    from flexid.library.joint_estimate import JointEstimate


class EstimateComparison(ReportedAnswer, TabularAnswer, PlottedAnswer):
    """What differs between two estimates, and whether chance explains it.

    `flexid.compare` returns one. As a data frame it has a row for each number, with the columns
    name, kind, unit, a, b, difference, lower, upper, percent, percent_lower, percent_upper,
    probability, outcome and reason.

    Parameters
    ----------
    result : Comparison
        What was found.
    """

    _report = "comparison"
    _file = "comparison.json"

    def __init__(self, result: "Comparison") -> None:
        self.result = result

    @property
    def parameters(self) -> "Mapping[str, Difference]":
        """By name, each parameter of either estimate: difference, interval and outcome."""
        return MappingProxyType(self.result.parameters)

    @property
    def coefficients(self) -> "Mapping[str, Difference]":
        """Lumped coefficients of the model by name, likewise; none if their meaning differs."""
        return MappingProxyType(self.result.coefficients)

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of what has changed, however much is compared."""
        return tuple(d.name for d in self.result.having("changed", "contradictory"))

    @property
    def agree(self) -> bool:
        """Whether all that is in both drives was compared, and no change is established."""
        return self.result.agree

    @property
    def probability(self) -> float | None:
        """Of differences as large by chance, of all coefficients at once; None if not tested."""
        together = self.result.together
        return None if together is None else together.probability

    @property
    def settings(self) -> Mapping[str, tuple[str, str]]:
        """What was asked for, chosen or used otherwise: in A and in B, by name."""
        return self.result.settings

    @property
    def warnings(self) -> tuple[str, ...]:
        """What limits the comparison."""
        return self.result.warnings

    def _columns(self) -> Mapping[str, Any]:
        rows = [*self.parameters.values(), *self.coefficients.values()]
        kinds = ["parameter"] * len(self.parameters) + ["coefficient"] * len(self.coefficients)
        nothing = float("nan")
        return {
            "name": [d.name for d in rows],
            "kind": kinds,
            "unit": [d.unit for d in rows],
            "a": [nothing if d.a is None else d.a.value for d in rows],
            "b": [nothing if d.b is None else d.b.value for d in rows],
            "difference": [d.value for d in rows],
            "lower": [d.interval[0] for d in rows],
            "upper": [d.interval[1] for d in rows],
            "percent": [d.percent for d in rows],
            "percent_lower": [d.percent_interval[0] for d in rows],
            "percent_upper": [d.percent_interval[1] for d in rows],
            "probability": [d.probability for d in rows],
            "outcome": [d.outcome for d in rows],
            "reason": [d.reason for d in rows],
        }

    def __repr__(self) -> str:
        compared = sum(d.compared for d in self.result.decisive.values())
        changed = ", ".join(self.changed) or "none"
        return f"<EstimateComparison: {compared} compared, changed: {changed}>"


@entrance
def compare(
    a: "JointEstimate | str | PathLike[str] | Mapping[str, Any]",
    b: "JointEstimate | str | PathLike[str] | Mapping[str, Any]",
) -> EstimateComparison:
    """Compare two estimates: what has changed, and how surely.

    Before and after a repair, two drives of a batch, two settings on one log. Each difference is
    B's value minus A's, with a 95 % interval; what is called changed is so beyond chance, however
    many numbers are compared.

    Parameters
    ----------
    a, b : JointEstimate, path or mapping
        An estimate.json of flexid identify, or the folder that holds it. Or what `flexid.identify`
        returned, or the content of a file.

    Returns
    -------
    EstimateComparison
        Differences with intervals and outcomes, and what was done otherwise.

    Raises
    ------
    SettingError
        If an estimate cannot be read, or both are the same.
    ArgumentError
        If an argument is of a wrong type.
    """
    from flexid.comparisons.comparison import compare_estimates

    first, file_a = estimated("compare", "a", a)
    second, file_b = estimated("compare", "b", b)
    return EstimateComparison(compare_estimates(first, second, (file_a or "A", file_b or "B")))
