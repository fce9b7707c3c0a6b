"""What `flexid.identify` returns: an estimate to look at, to compute with, to keep, to test."""

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
    """Parameters of a joint, with intervals and verdicts, and the model that they make.

    `flexid.identify` returns one, `flexid.load` reads one that was saved.
    """

    _report = "identification"

    result: Identification
    model: str
    """``"flexible"``; ``"link"`` where there is no input, ``"rigid"`` with one encoder."""
    joint: str
    """``"revolute"``; ``"prismatic"`` where it slides, and values are in m, N and kg."""
    parameters: Mapping[str, ValueEstimate]
    """Physical parameters by name: value, unit, interval, verdict and reason of each."""
    coefficients: Mapping[str, ValueEstimate]
    """Lumped coefficients of the model by name, likewise."""
    removed: Mapping[str, ValueEstimate]
    """Parameters that the model does without: how large they could be."""
    disturbances: Disturbances | None
    """What the drive does that no term describes; None where the model explains the log."""
    verdict: Verdict
    """The worst of all verdicts."""
    provenance: Mapping[str, Any]
    """Version, settings, and the logs with their hashes."""

    def __getitem__(self, name: str) -> ValueEstimate:
        """A parameter or coefficient by name."""
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
        """By channel, how much of the held-out data a free run repeats, in per cent."""
        return MappingProxyType(self.result.validation.fit_percent)

    @property
    def residuals(self) -> Mapping[str, NDArray[np.float64]]:
        """Measured minus simulated held-out data in rad or m by channel; none of a loaded one."""
        found = self.result.validation
        off = [run.measured - run.simulated for run in found.runs]
        return dict(zip(found.fit_percent, np.concatenate(off).T, strict=True)) if off else {}

    @property
    def chi_square(self) -> float:
        """Squared residuals of the fit over the variances of the sensors' noise, summed.

        NaN of an estimate that was loaded, or not made by prediction errors.
        """
        excess = self.result.residual_excess.values()
        return sum(self._samples * ratio**2 for ratio in excess) if self._samples else np.nan

    @property
    def aic(self) -> float:
        """Akaike's criterion for known noise, up to a constant: chi-square + 2 k, of k unknowns."""
        return self.chi_square + 2.0 * len(self.result.fit.names)

    @property
    def bic(self) -> float:
        """Schwarz' criterion, likewise: chi-square + k log(n), of n measured positions."""
        measured = self._samples * len(self.result.residual_excess)
        return self.chi_square + len(self.result.fit.names) * (
            np.log(measured) if measured else np.nan
        )

    @property
    def _samples(self) -> int:
        """Samples of each position whose residuals are known; zero if they are not."""
        known = self.result.choices.estimator == "prediction-error"
        return sum(map(len, self.result.recordings)) if known else 0

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms of the model besides the joint spring."""
        return self.result.choices.terms

    @property
    def settings(self) -> Mapping[str, Any]:
        """What was asked for, by option; what was ``"auto"`` is chosen from the log."""
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

        Shape (k, k), in SI units, by the delta method. The variance of what the log leaves free is
        infinite; of what was given it is zero.
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
        """Intervals of all parameters and coefficients by name.

        Parameters
        ----------
        level : float, optional
            Nominal coverage, a probability between 0 and 1.
        """
        checked_level(level)
        return {name: value.interval_at(level) for name, value in self._every.items()}

    def to_dataframe(self, *, level: float = CONFIDENCE) -> pl.DataFrame:
        """Parameters and coefficients as a data frame of Polars, with a row each.

        Its columns are name, kind, value, unit, std, lower, upper, verdict and reason.

        Parameters
        ----------
        level : float, optional
            Nominal coverage of the intervals.
        """
        import polars as pl

        every = self._every
        ends = self.intervals(level)
        columns = {
            "name": list(every),
            "kind": ["parameter"] * len(self.parameters) + ["coefficient"] * len(self.coefficients),
            "value": [e.value for e in every.values()],
            "unit": [e.unit for e in every.values()],
            "std": [e.std for e in every.values()],
            "lower": [ends[name][0] for name in every],
            "upper": [ends[name][1] for name in every],
            "verdict": [e.verdict for e in every.values()],
            "reason": [e.reason for e in every.values()],
        }
        return pl.DataFrame(columns)

    def summary(self, *, explain: bool = False) -> str:
        """The answer as text: what ``flexid identify`` prints.

        Parameters
        ----------
        explain : bool, optional
            Add the evidence for every choice.
        """
        from flexid.report.terminal import as_text

        return as_text([*self._parts(), *(self._evidence() if explain else ())])

    def validate(self, logs: Logs, *, columns: Columns | None = None) -> EstimateValidation:
        """Hold the estimate against other logs, as `flexid.validate` does.

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
        """Frequency responses of the joint for small motions: what ``plot("bode")`` draws.

        Parameters
        ----------
        frequency : array_like, shape (n,), optional
            In Hz; chosen if not given, dense where a peak may be.
        position : float, optional
            In rad or m, about which link and motor move; where gravity has no torque, if not given.
        level : float, optional
            Nominal coverage of the intervals, at each frequency for itself.
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
