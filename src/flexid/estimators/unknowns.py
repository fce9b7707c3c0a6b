"""What is sought and what is not: coefficients fixed, shared, one for each group, within bounds."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.normal_equations import NULL
from flexid.models.parametric_system import ParametricSystem, Row

FIXED = -1  # column of a coefficient that is not sought


@dataclass(frozen=True)
class Unknowns:
    """Which coefficients of a system are sought, from which recordings: p_j = b_j + S_j θ."""

    system: ParametricSystem
    # coefficients that keep a value; "offset[2]" is that of the second group alone
    fixed: Mapping[str, float] = field(default_factory=dict)
    per_group: tuple[str, ...] = ()  # coefficients that are sought for each group
    groups: tuple[int, ...] = ()  # group of each recording, counted from 0; empty: all are of one
    # "c": ("a", "b", "d") means c = a b / d, which only the prediction error heeds
    tied: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", {c: float(v) for c, v in self.fixed.items()})
        object.__setattr__(self, "per_group", tuple(self.per_group))
        object.__setattr__(self, "groups", tuple(int(group) for group in self.groups))
        if min(self.groups, default=0) < 0:
            raise SettingError("groups", "they are counted from 0: give no negative ones")
        coefficients = self.system.coefficients
        labels = {label for own in self._labels.values() for label in own}
        _check_known("per-group", self.per_group, coefficients)
        _check_known("fixed", self.fixed, (*coefficients, *sorted(labels - {*coefficients})))
        named = (c for source in self.tied.values() for c in source)
        _check_known("tied", (*self.tied, *named), coefficients)
        for name, value in self.fixed.items():
            if not np.isfinite(value):
                raise SettingError("fixed", f"the value of {name!r} is not finite: correct it")
        if not self.names:
            raise SettingError("fixed", "every coefficient is: leave at least one to be sought")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What is sought, row by row; those of group g carry ``[g + 1]`` if there are several."""
        return self._sought(self.system.coefficients)

    @cached_property
    def coefficient_of(self) -> dict[str, str]:
        """The system's coefficient behind each name that is sought."""
        labels = {name: c for c, own in self._labels.items() for name in own}
        return {name: labels[name] for name in self.names}

    def names_of(self, row: Row) -> tuple[str, ...]:
        """What is sought in one row; it may be nothing."""
        return self._sought(row.coefficients)

    def columns(self, recording_index: int) -> NDArray[np.int64]:
        """Place in `names` of each of the system's coefficients, `FIXED` where it is not sought."""
        return self._placed(recording_index)[0]

    def coefficients(
        self, values: FloatArray | Sequence[float], recording_index: int
    ) -> FloatArray:
        """Coefficients of a recording, shape (n_coefficients,), from what is sought, (n_names,)."""
        columns, fixed = self._placed(recording_index)
        sought = np.asarray(values, dtype=np.float64)[columns]
        found = np.where(columns == FIXED, fixed, sought)
        for target, sources in self._ties:
            a, b, d = (float(found[source]) for source in sources)
            found[target] = a * b / d if a else 0.0
        return found

    def derivatives(self, values: FloatArray | Sequence[float], recording_index: int) -> FloatArray:
        """Derivatives, shape (n_coefficients, n_names), of a recording's coefficients."""
        columns = self.columns(recording_index)
        found = self.coefficients(values, recording_index)
        slopes = np.zeros((len(columns), len(self.names)))
        sought = np.flatnonzero(columns != FIXED)
        slopes[sought, columns[sought]] = 1.0
        for target, (a, b, d) in self._ties:
            by_source = (found[b] / found[d], found[a] / found[d], -found[target] / found[d])
            slopes[target] = by_source @ slopes[[a, b, d]]
        return slopes

    def depends(self, recording_index: int) -> NDArray[np.bool_]:
        """Which coefficients of a recording depend on what is sought, (n_coefficients, n_names)."""
        columns, fixed = self._placed(recording_index)
        pattern = np.zeros((len(columns), len(self.names)), dtype=np.bool_)
        sought = np.flatnonzero(columns != FIXED)
        pattern[sought, columns[sought]] = True
        for target, (a, b, d) in self._ties:
            if columns[a] != FIXED or fixed[a] != 0.0:  # a term that is off stays off
                pattern[target] = pattern[a] | pattern[b] | pattern[d]
        return pattern

    @cached_property
    def _ties(self) -> tuple[tuple[int, tuple[int, ...]], ...]:
        place = {name: i for i, name in enumerate(self.system.coefficients)}
        return tuple(
            (place[target], tuple(place[c] for c in sources))
            for target, sources in self.tied.items()
        )

    def absent(self, recording_index: int) -> frozenset[str]:
        """Coefficients of the system that are fixed at 0 in a recording: their terms are off."""
        columns, fixed = self._placed(recording_index)
        off = (columns == FIXED) & (fixed == 0.0)
        return frozenset(c for c, o in zip(self.system.coefficients, off, strict=True) if o)

    def fixing(self, more: Mapping[str, float]) -> "Unknowns":
        """The same with more coefficients fixed."""
        return replace(self, fixed={**self.fixed, **more})

    def _sought(self, coefficients: Iterable[str]) -> tuple[str, ...]:
        return tuple(
            label
            for c in coefficients
            if c not in self.fixed and c not in self.tied
            for label in self._labels[c]
            if label not in self.fixed
        )

    @cached_property
    def _labels(self) -> dict[str, tuple[str, ...]]:
        """The names under which each coefficient may be sought."""
        groups = sorted({*self.groups})
        several = {*self.per_group} if len(groups) > 1 else set()
        return {
            c: tuple(_of_group(c, group) for group in groups) if c in several else (c,)
            for c in self.system.coefficients
        }

    def _placed(self, recording_index: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Columns and fixed values of a recording; every step of every fit asks for them."""
        if recording_index not in self._found:
            place = {name: i for i, name in enumerate(self.names)}
            labels = {
                c: _of_group(c, self.groups[recording_index]) if len(own) > 1 else c
                for c, own in self._labels.items()
            }
            columns = np.array([place.get(label, FIXED) for label in labels.values()], np.int64)
            fixed = np.array(
                [self.fixed.get(label, self.fixed.get(c, 0.0)) for c, label in labels.items()],
                np.float64,
            )
            for values in (columns, fixed):
                values.setflags(write=False)
            self._found[recording_index] = columns, fixed
        return self._found[recording_index]

    @cached_property
    def _found(self) -> dict[int, tuple[NDArray[np.int64], FloatArray]]:
        return {}


def _of_group(coefficient: str, group: int) -> str:
    return f"{coefficient}[{group + 1}]"


def _check_known(setting: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise SettingError(
                setting, f"{name!r} is no coefficient of this model; it has {', '.join(known)}"
            )


def unknowns_of(
    system: ParametricSystem, n_recordings: int, unknowns: Unknowns | None = None
) -> Unknowns:
    """The unknowns that an estimator's arguments mean, with this system's constants."""
    if unknowns is None:
        return Unknowns(system)
    if unknowns.system.digest != system.digest:
        raise SettingError("unknowns", "they are of another model: declare this one's")
    if unknowns.groups and len(unknowns.groups) != n_recordings:
        raise SettingError(
            "groups",
            f"there are {len(unknowns.groups)} for {n_recordings} recordings: give one for each",
        )
    return replace(unknowns, system=system)


Bounds = Mapping[str, tuple[float, float]]


class Fit(Protocol):
    """What a fit has to have: values of what is sought, and the information on it."""

    @property
    def names(self) -> tuple[str, ...]:
        """What is sought, k of them."""
        ...

    @property
    def values(self) -> FloatArray:
        """Their values, shape (k,)."""
        ...

    @property
    def information(self) -> FloatArray:
        """The sum of squares' quadratic form about them, up to a factor, shape (k, k)."""
        ...


AnyFit = TypeVar("AnyFit", bound=Fit)


# About its minimum a sum of squares is (p - p̂)ᵀ M (p - p̂) with the information M, a quadratic
# programme within bounds. What ends at its bound there is fixed, and the estimator runs again.
def bounded_fit(
    fit_with: Callable[[Unknowns], AnyFit], unknowns: Unknowns, bounds: Bounds
) -> tuple[AnyFit, dict[str, float]]:
    """Fit within bounds, and the bound at which each other coefficient was fixed."""
    _check(unknowns, bounds)
    at_bound: dict[str, float] = {}
    fit = fit_with(unknowns)
    # The rest may leave its bounds in its turn; each round fixes one coefficient at least.
    while ends := _ends(fit, unknowns, bounds):
        at_bound |= ends
        if len(ends) == len(fit.names):
            raise SettingError(
                "bounds", "every coefficient ends at its bound: widen them, or check the units"
            )
        unknowns = unknowns.fixing(ends)
        fit = fit_with(unknowns)
    return fit, at_bound


def _check(unknowns: Unknowns, bounds: Bounds) -> None:
    coefficients = unknowns.system.coefficients
    _check_known("bounds", bounds, tuple(dict.fromkeys((*coefficients, *unknowns.names))))
    for name, (lower, upper) in bounds.items():
        if not lower < upper:
            raise SettingError(
                "bounds", f"those of {name!r}, {lower:g} and {upper:g}, leave no room: correct them"
            )


def _ends(fit: Fit, unknowns: Unknowns, bounds: Bounds) -> dict[str, float]:
    """Coefficients that end at a bound in the quadratic programme, with the bound."""
    coefficient_of = unknowns.coefficient_of  # what else a fit seeks has no bounds
    own = {name: bounds.get(name, bounds.get(coefficient_of.get(name, name))) for name in fit.names}
    unbounded = (-np.inf, np.inf)
    lower, upper = np.array([own[name] or unbounded for name in fit.names], dtype=np.float64).T
    if np.all((fit.values >= lower) & (fit.values <= upper)):
        return {}
    from scipy.optimize import lsq_linear  # late: it takes a third of a second to import

    scale = np.sqrt(np.diag(fit.information))
    scale = np.where(scale > 0.0, scale, 1.0)
    # Along directions that the data leave open the least departure from the fit decides.
    normalised = fit.information / np.outer(scale, scale) + NULL * np.eye(len(scale))
    root = np.linalg.cholesky(normalised).T
    found = lsq_linear(
        root, root @ (scale * fit.values), (scale * lower, scale * upper), method="bvls"
    )
    return {
        name: float(low if side < 0 else high)
        for name, low, high, side in zip(fit.names, lower, upper, found.active_mask, strict=True)
        if side
    }
