"""Result of `flexid.identify`: the estimate of a joint."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexid.errors import SettingError, did_you_mean
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import (
    CONFIDENCE,
    Disturbances,
    ValueEstimate,
    Verdict,
    checked_level,
    slopes_of,
)
from flexid.library.answer import EstimateAnswer
from flexid.library.arguments import entrance

if TYPE_CHECKING:
    import polars as pl
    from numpy.typing import ArrayLike

    from flexid.library.logs import Columns, Logs
    from flexid.library.validation import EstimateValidation
    from flexid.stored_estimates.frequency_response import FrequencyResponse


class JointEstimate(EstimateAnswer):
    """Estimate of a joint: parameters with intervals and verdicts, and the fitted model.

    `flexid.identify` returns an estimate, and `flexid.load` reads a saved one.
    """

    _report = "identification"

    result: Identification
    model: str
    """``"flexible"``, ``"link"`` (log without an input) or ``"rigid"`` (one encoder)."""
    joint: str
    """``"revolute"``, or ``"prismatic"`` for a linear axis with values in m, N and kg."""
    parameters: Mapping[str, ValueEstimate]
    """Physical parameters by name, each with value, unit, interval, verdict and reason."""
    coefficients: Mapping[str, ValueEstimate]
    """Lumped coefficients of the model by name, with the same fields as `parameters`."""
    removed: Mapping[str, ValueEstimate]
    """Parameters of excluded terms by name; the interval bounds their size."""
    disturbances: Disturbances | None
    """Acceleration that no term describes; None if the model explains the log."""
    verdict: Verdict
    """The worst of all verdicts."""
    provenance: Mapping[str, Any]
    """Version, settings, and the logs with their hashes."""

    def __getitem__(self, name: str) -> ValueEstimate:
        """Return a parameter or coefficient by name."""
        if name not in self._every:
            raise SettingError(
                name, f"the estimate has no such value{did_you_mean(name, self._every)}"
            )
        return self._every[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._every)

    def __contains__(self, name: object) -> bool:
        return name in self._every

    @property
    def fit_percent(self) -> Mapping[str, float]:
        """Fit in per cent of a free run to the held-out data, by channel."""
        return MappingProxyType(self.result.validation.fit_percent)

    @property
    def residuals(self) -> Mapping[str, NDArray[np.float64]]:
        """Measured minus simulated held-out data in rad or m, by channel; empty after `load`."""
        found = self.result.validation
        off = [run.measured - run.simulated for run in found.runs]
        return dict(zip(found.fit_percent, np.concatenate(off).T, strict=True)) if off else {}

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals of the fit, each divided by its sensor's noise variance.

        NaN for a loaded estimate, and for any estimator but the prediction error.
        """
        excess = self.result.residual_excess.values()
        return sum(self._samples * ratio**2 for ratio in excess) if self._samples else np.nan

    @property
    def aic(self) -> float:
        """Akaike's criterion for known noise, up to a constant: chi-square + 2 k for k unknowns."""
        return self.chi_square + 2.0 * len(self.result.fit.names)

    @property
    def bic(self) -> float:
        """Schwarz' criterion, up to a constant: chi-square + k log(n) for n measured positions."""
        measured = self._samples * len(self.result.residual_excess)
        return self.chi_square + len(self.result.fit.names) * (
            np.log(measured) if measured else np.nan
        )

    @property
    def _samples(self) -> int:
        """Number of samples with known residuals, per measured position; 0 if unknown."""
        known = self.result.choices.estimator == "prediction-error"
        return sum(map(len, self.result.recordings)) if known else 0

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms of the model besides the joint spring."""
        return self.result.choices.terms

    @property
    def settings(self) -> Mapping[str, Any]:
        """Settings of the identification by option, as given by the user."""
        return MappingProxyType(self.result.provenance.get("settings", {}))

    @cached_property
    def _every(self) -> dict[str, ValueEstimate]:
        return {**self.parameters, **self.coefficients}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, then of the coefficients: the order of `covariance`."""
        return tuple(self._every)

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of all parameters and coefficients, in the order of `names`.

        Shape (k, k), in SI units, by the delta method. A value that the log does not determine at
        all has infinite variance, and a given value has zero variance.
        """
        fit = self.result.fit
        slopes = slopes_of([*self._every.values()], fit.names)
        free = ~np.isfinite(np.diag(fit.covariance))
        known = np.where(free[:, None] | free, 0.0, fit.covariance)
        covariance = slopes @ known @ slopes.T
        lost = (slopes[:, free] != 0.0).any(axis=1)
        lost |= [not np.isfinite(value.std) for value in self._every.values()]
        covariance[lost, :] = covariance[:, lost] = 0.0
        covariance[lost, lost] = np.inf
        return covariance

    def intervals(self, level: float = CONFIDENCE) -> dict[str, tuple[float, float]]:
        """Return the intervals of all parameters and coefficients by name.

        Parameters
        ----------
        level : float, optional
            Nominal coverage, a probability between 0 and 1.
        """
        checked_level(level)
        return {name: value.interval_at(level) for name, value in self._every.items()}

    def to_dataframe(self, *, level: float = CONFIDENCE) -> pl.DataFrame:
        """Return a Polars data frame with one row per parameter and coefficient.

        Its columns are name, kind, value, unit, std, lower, upper, verdict and reason.

        Parameters
        ----------
        level : float, optional
            Nominal coverage of the intervals.
        """
        import polars as pl

        ends = self.intervals(level)
        rows = [
            (name, kind, e.value, e.unit, e.std, *ends[name], e.verdict, e.reason)
            for kind, values in (("parameter", self.parameters), ("coefficient", self.coefficients))
            for name, e in values.items()
        ]
        names = ("name", "kind", "value", "unit", "std", "lower", "upper", "verdict", "reason")
        return pl.DataFrame(rows, schema=names, orient="row")

    def summary(self, *, explain: bool = False) -> str:
        """Return the result as text, as ``flexid identify`` prints it.

        Parameters
        ----------
        explain : bool, optional
            Add the evidence for every choice.
        """
        from flexid.report.terminal import as_text

        return as_text(self._parts(explain=explain))

    def validate(self, logs: Logs, *, columns: Columns | None = None) -> EstimateValidation:
        """Predict other logs with the estimate, as `flexid.validate` does.

        Parameters
        ----------
        logs : log or list of logs
            As `flexid.read_log` takes them, with the same kind of input.
        columns : path or mapping, optional
            A column map for raw sensor columns, as `flexid.identify` takes it.
        """
        from flexid.library.validation import validate

        return validate(self, logs, columns=columns)

    @entrance
    def frequency_response(
        self,
        *,
        frequency: ArrayLike | None = None,
        position: float | None = None,
        level: float = CONFIDENCE,
    ) -> FrequencyResponse:
        """Return frequency responses of the joint for small motions, as in ``plot("bode")``.

        Parameters
        ----------
        frequency : array_like, shape (n,), optional
            Frequencies in Hz; by default a grid that is dense near possible peaks.
        position : float, optional
            Operating point in rad or m; by default where gravity has no torque.
        level : float, optional
            Nominal coverage of the pointwise intervals.
        """
        from flexid.stored_estimates.frequency_response import frequency_response

        return frequency_response(self.result, frequency=frequency, position=position, level=level)

    def __repr__(self) -> str:
        verdicts = Counter(p.verdict for p in self.parameters.values())
        determined = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        fits = [fit for fit in self.fit_percent.values() if not np.isnan(fit)]
        worst = f", free run {min(fits):.1f} %" if fits else ""
        slides = "" if self.joint == "revolute" else f"{self.joint} "
        return f"<JointEstimate: {slides}{self.model} joint, parameters: {determined}{worst}>"
