"""What is known beforehand, with its uncertainty, joined to what a fit says.

A coefficient or physical parameter g(p) known as v with standard deviation s is one more
measurement. With p̂ and C the fit's values and covariance, and h the gradient of g,

    K = C h / (hᵀC h + s²),    p = p̂ + K (v - g(p̂)),    C - K hᵀC

are the values and covariance of both together, exactly so if g is linear and the noise normal;
where g is not linear, the step is repeated from where it led until it stays there. The covariance
of the fit is taken as it is, right for correlated residuals, so that the log gets the weight that
it deserves. s = 0 fixes g(p) at v; a large s changes nothing.

Where the log leaves a coefficient entirely free there is no C to start from, and what is known of
it has to be given as exact.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.errors import ConvergenceError, SettingError
from flexid.identification.intervals import POSITIVE, Fitted, FloatArray
from flexid.models.physical import PhysicalParameter

CONTRADICTION = 3.0
"""Standard deviations between knowledge and log beyond which there is a warning."""

_STEPS = 100
_CONVERGED = 1e-10  # relative change of the values by a step
_LEAST_FREEDOM = 0.5
_LARGEST_STEP = 0.5  # of a positive coefficient's value, lest it jump across zero


@dataclass(frozen=True)
class Known:
    """A coefficient or physical parameter that is known beforehand.

    Parameters
    ----------
    name : str
        Of the coefficient or physical parameter.
    value, std : float
        What it is known as, and the standard deviation of that; 0 if it is known exactly.

    Raises
    ------
    SettingError
        If the value is not finite, or the standard deviation negative or not finite.
    """

    name: str
    value: float
    std: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.std) and self.std >= 0.0):
            raise SettingError(
                "known",
                f"{self.name} = {self.value:g} ± {self.std:g} is no value with an uncertainty: "
                f"give two finite numbers, the second not negative",
            )


@dataclass(frozen=True, eq=False)
class Informed:
    """A fit with what was known beforehand joined to it.

    Parameters
    ----------
    names : tuple of str
        Coefficients.
    values : array, shape (k,)
        Their values.
    covariance : array, shape (k, k)
        Their covariance.
    degrees_of_freedom : tuple of float
        Of each variance. What was known counts as known exactly in its uncertainty, so the more a
        value rests on it, the more degrees of freedom (Welch and Satterthwaite).
    warnings : tuple of str
        Where log and knowledge contradict each other.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    degrees_of_freedom: tuple[float, ...]
    warnings: tuple[str, ...]


def informed(
    fit: Fitted,
    known: Sequence[Known],
    parameters: Sequence[PhysicalParameter] = (),
    given: Mapping[str, float] | None = None,
) -> Informed:
    """Join knowledge to a fit.

    Parameters
    ----------
    fit : Fitted
        Of the log alone.
    known : sequence of Known
        Coefficients of the fit, or physical parameters; independent of the log and of one another.
    parameters : sequence of PhysicalParameter, optional
        Those that `known` may name.
    given : mapping of str to float, optional
        Coefficients that were not fitted, if a physical parameter needs them.

    Returns
    -------
    Informed

    Raises
    ------
    SettingError
        If a name is neither coefficient nor parameter, or the log leaves a coefficient free that
        it depends on.
    ConvergenceError
        If no values satisfy both.
    """
    wanted = [_parameter(item.name, fit, parameters) for item in known]
    finite = np.isfinite(np.diag(fit.covariance))
    alone = _Linearised(fit.names, np.asarray(fit.values, dtype=np.float64), given or {}, wanted)
    variances = np.array([item.std for item in known]) ** 2
    covariance = np.where(np.outer(finite, finite), fit.covariance, 0.0)
    both, gain = _joined(alone, covariance, np.array([item.value for item in known]), variances)
    involved = np.any(both.slopes != 0.0, axis=0)
    fewest = min(fit.degrees_of_freedom[i] for i in np.flatnonzero(involved))
    kept = np.eye(len(fit.names)) - gain @ both.slopes
    # A gain from an estimated covariance costs a degree of freedom, as a regression does, in the
    # variance that is left and in the gain's own error: as far as knowledge prevails over the log.
    left = max(fewest - float(np.trace(both.slopes @ gain)), _LEAST_FREEDOM)
    cost = 1.0 if np.isinf(fewest) else (fewest / left) ** 2
    from_log = cost * kept @ covariance @ kept.T
    total = from_log + (gain * variances) @ gain.T
    freedom = _welch_satterthwaite(
        np.minimum(fit.degrees_of_freedom, left), np.diag(from_log), np.diag(total)
    )
    freedom[~finite] = 0.0
    total[~finite, ~finite] = np.inf
    warnings = _contradictions(alone, covariance, known)
    return Informed(fit.names, both.point, total, tuple(freedom.tolist()), warnings)


@dataclass(frozen=True)
class _Itself:
    """A coefficient as a physical parameter."""

    name: str
    unit: str = ""

    @property
    def coefficients(self) -> tuple[str, ...]:
        return (self.name,)

    def value(self, coefficients: Mapping[str, float]) -> float:
        return coefficients[self.name]

    def gradient(self, coefficients: Mapping[str, float], names: Collection[str]) -> FloatArray:  # noqa: ARG002
        return np.array([float(name == self.name) for name in names])


def _parameter(
    name: str, fit: Fitted, parameters: Sequence[PhysicalParameter]
) -> PhysicalParameter:
    """What a name stands for; refused if the log leaves free what it depends on."""
    known = {p.name: p for p in parameters} | {c: _Itself(c) for c in fit.names}
    if name not in known:
        raise SettingError("known", f"{name!r} is unknown here; there are {', '.join(known)}")
    fitted = [c for c in known[name].coefficients if c in fit.names]
    if not fitted:
        raise SettingError("known", f"{name!r} follows from what was given: leave one of them out")
    for coefficient in fitted:
        place = fit.names.index(coefficient)
        if not np.isfinite(fit.covariance[place, place]):
            raise SettingError(
                "known",
                f"{name!r} cannot be joined to a log that leaves {coefficient!r} free: give it "
                f"without an uncertainty",
            )
    return known[name]


@dataclass(frozen=True, eq=False)
class _Linearised:
    """What is known, as functions of the coefficients, about a point."""

    names: tuple[str, ...]
    point: FloatArray
    given: Mapping[str, float]
    parameters: Sequence[PhysicalParameter]

    @property
    def _coefficients(self) -> dict[str, float]:
        return {**self.given, **dict(zip(self.names, self.point.tolist(), strict=True))}

    @property
    def values(self) -> FloatArray:
        """Values of the functions, shape (n_known,)."""
        return np.array([p.value(self._coefficients) for p in self.parameters])

    @property
    def slopes(self) -> FloatArray:
        """Their derivatives, shape (n_known, k)."""
        return np.array([p.gradient(self._coefficients, self.names) for p in self.parameters])


def _joined(
    alone: _Linearised, covariance: FloatArray, values: FloatArray, variances: FloatArray
) -> tuple[_Linearised, FloatArray]:
    """The most probable point, and the gain there: the step repeated until it ends."""
    here, shortest = alone, np.array([name in POSITIVE for name in alone.names])
    for _ in range(_STEPS):
        slopes = here.slopes
        spread = slopes @ covariance @ slopes.T + np.diag(variances)
        gain = covariance @ slopes.T @ np.linalg.pinv(spread, hermitian=True)
        surprise = values - here.values - slopes @ (alone.point - here.point)
        step = alone.point + gain @ surprise - here.point
        size = np.abs(step) / np.maximum(np.abs(here.point), np.finfo(float).tiny)
        if np.all(size < _CONVERGED):
            return here, gain
        longest = float(np.max(size, where=shortest, initial=0.0))
        step *= min(1.0, _LARGEST_STEP / longest) if longest > 0.0 else 1.0
        here = replace(here, point=here.point + step)
    names = " and ".join(p.name for p in alone.parameters)
    raise ConvergenceError(
        "joining what is known",
        f"the log and what is known of {names} do not go together: check value and unit",
    )


def _contradictions(
    alone: _Linearised, covariance: FloatArray, known: Sequence[Known]
) -> tuple[str, ...]:
    slopes = alone.slopes
    warnings = []
    for item, value, slope in zip(known, alone.values.tolist(), slopes, strict=True):
        variance = float(slope @ covariance @ slope)
        apart = abs(item.value - value)
        allowed = np.sqrt(variance + item.std**2)
        if apart > CONTRADICTION * allowed:
            warnings.append(
                f"{item.name} is known as {item.value:.4g} ± {item.std:.2g}, but the log alone "
                f"says {value:.4g} ± {np.sqrt(variance):.2g}: check the value and the log's units"
            )
    return tuple(warnings)


def _welch_satterthwaite(
    degrees_of_freedom: FloatArray, from_log: FloatArray, total: FloatArray
) -> FloatArray:
    """Degrees of freedom of variances of which only the log's part is estimated."""
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = degrees_of_freedom * (total / from_log) ** 2
    return np.where(from_log > 0.0, np.nan_to_num(freedom, nan=0.0, posinf=np.inf), np.inf)
