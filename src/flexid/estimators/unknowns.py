"""Unknowns of a fit: which coefficients are fixed, tied, estimated per group or within bounds."""

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

FIXED = -1  # column of a coefficient that is not estimated


@dataclass(frozen=True)
class Unknowns:
    """Unknowns θ of a system and the coefficients of recording j: p_j = b_j + S_j θ."""

    system: ParametricSystem
    # values of fixed coefficients; "offset[2]" is fixed in the second group only
    fixed: Mapping[str, float] = field(default_factory=dict)
    per_group: tuple[str, ...] = ()  # coefficients with one unknown for each group
    groups: tuple[int, ...] = ()  # group of each recording, counted from 0; empty: one group
    # "c": ("a", "b", "d") means c = a b / d; least squares ignores it
    tied: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", {c: float(v) for c, v in self.fixed.items()})
        object.__setattr__(self, "per_group", tuple(self.per_group))
        object.__setattr__(self, "groups", tuple(int(group) for group in self.groups))
        if min(self.groups, default=0) < 0:
            raise SettingError("groups", f"{min(self.groups)} is negative: count groups from 0")
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
            raise SettingError("fixed", "no coefficient is left to estimate: fix fewer")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, row by row, with the suffix ``[g + 1]`` if for group g alone."""
        return self._labels_among(self.system.coefficients)

    @cached_property
    def coefficient_of(self) -> dict[str, str]:
        """Coefficient of the system for the name of each unknown."""
        labels = {name: c for c, own in self._labels.items() for name in own}
        return {name: labels[name] for name in self.names}

    def names_of(self, row: Row) -> tuple[str, ...]:
        """Return the names of the unknowns in one row, possibly none."""
        return self._labels_among(row.coefficients)

    def columns(self, recording_index: int) -> NDArray[np.int64]:
        """Return the index in `names` of each coefficient of the system, or `FIXED`."""
        return self._columns_and_fixed(recording_index)[0]

    def coefficients(
        self, values: FloatArray | Sequence[float], recording_index: int
    ) -> FloatArray:
        """Return a recording's coefficients, (n_coefficients,), from the unknowns, (n_names,)."""
        columns, fixed = self._columns_and_fixed(recording_index)
        sought = np.asarray(values, dtype=np.float64)[columns]
        found = np.where(columns == FIXED, fixed, sought)
        for target, sources in self._ties:
            a, b, d = (float(found[source]) for source in sources)
            found[target] = a * b / d if a else 0.0
        return found

    def derivatives(self, values: FloatArray | Sequence[float], recording_index: int) -> FloatArray:
        """Return derivatives of a recording's coefficients, shape (n_coefficients, n_names)."""
        columns = self.columns(recording_index)
        found = self.coefficients(values, recording_index)
        slopes = np.zeros((len(columns), len(self.names)))
        sought = np.flatnonzero(columns != FIXED)
        slopes[sought, columns[sought]] = 1.0
        for target, (a, b, d) in self._ties:
            by_source = (found[b] / found[d], found[a] / found[d], -found[target] / found[d])
            slopes[target] = by_source @ slopes[[a, b, d]]
        return slopes

    @cached_property
    def _ties(self) -> tuple[tuple[int, tuple[int, ...]], ...]:
        place = {name: i for i, name in enumerate(self.system.coefficients)}
        return tuple(
            (place[target], tuple(place[c] for c in sources))
            for target, sources in self.tied.items()
        )

    def absent(self, recording_index: int) -> frozenset[str]:
        """Return the coefficients that are fixed at 0 in a recording: their terms are off."""
        columns, fixed = self._columns_and_fixed(recording_index)
        off = (columns == FIXED) & (fixed == 0.0)
        return frozenset(c for c, o in zip(self.system.coefficients, off, strict=True) if o)

    def fixing(self, more: Mapping[str, float]) -> "Unknowns":
        """Return these unknowns with more coefficients fixed."""
        return replace(self, fixed={**self.fixed, **more})

    def _labels_among(self, coefficients: Iterable[str]) -> tuple[str, ...]:
        return tuple(
            label
            for c in coefficients
            if c not in self.fixed and c not in self.tied
            for label in self._labels[c]
            if label not in self.fixed
        )

    @cached_property
    def _labels(self) -> dict[str, tuple[str, ...]]:
        """Names of the possible unknowns of each coefficient: one, or one per group."""
        groups = sorted({*self.groups})
        several = {*self.per_group} if len(groups) > 1 else set()
        return {
            c: tuple(_of_group(c, group) for group in groups) if c in several else (c,)
            for c in self.system.coefficients
        }

    def _columns_and_fixed(self, recording_index: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Columns and fixed values of a recording."""
        return self._by_group[self.groups[recording_index] if self.groups else 0]

    @cached_property
    def _by_group(self) -> dict[int, tuple[NDArray[np.int64], FloatArray]]:
        """Columns and fixed values by group; cached, as every step of a fit needs them."""
        place = {name: i for i, name in enumerate(self.names)}
        found = {}
        for group in {*self.groups} or {0}:
            labels = {
                c: _of_group(c, group) if len(own) > 1 else c for c, own in self._labels.items()
            }
            fixed = [self.fixed.get(label, self.fixed.get(c, 0.0)) for c, label in labels.items()]
            columns = [place.get(label, FIXED) for label in labels.values()]
            found[group] = np.array(columns, np.int64), np.array(fixed, np.float64)
            for values in found[group]:
                values.setflags(write=False)  # they are shared by all callers
        return found


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
    """Check an estimator's unknowns, by default all coefficients, against its other arguments."""
    if unknowns is None:
        return Unknowns(system)
    if unknowns.system.digest != system.digest:
        raise SettingError("unknowns", "they belong to another model: declare them for this model")
    if unknowns.groups and len(unknowns.groups) != n_recordings:
        raise SettingError(
            "groups",
            f"there are {len(unknowns.groups)} for {n_recordings} recordings: give one for each",
        )
    return replace(unknowns, system=system)


Bounds = Mapping[str, tuple[float, float]]


class _Fit(Protocol):
    """Fit of k unknowns, with the matrix, (k, k), of its sum of squares up to a factor."""

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def values(self) -> FloatArray: ...
    @property
    def information(self) -> FloatArray: ...


AnyFit = TypeVar("AnyFit", bound=_Fit)


# Near its minimum a sum of squares is (p - p̂)ᵀ M (p - p̂) with the information M. Within bounds this
# is a quadratic programme. It fixes some coefficients at bounds; then the estimator runs again.
def bounded_fit(
    fit_with: Callable[[Unknowns], AnyFit], unknowns: Unknowns, bounds: Bounds
) -> tuple[AnyFit, dict[str, float]]:
    """Fit within bounds; return the fit and the values of coefficients fixed at a bound."""
    coefficients = unknowns.system.coefficients
    _check_known("bounds", bounds, tuple(dict.fromkeys((*coefficients, *unknowns.names))))
    for name, (lower, upper) in bounds.items():
        if not lower < upper:
            raise SettingError(
                "bounds", f"{name!r} has no room between {lower:g} and {upper:g}: correct them"
            )
    at_bound: dict[str, float] = {}
    fit = fit_with(unknowns)
    # Other coefficients may then leave their bounds; each round fixes at least one.
    while ends := _active_bounds(fit, unknowns, bounds):
        at_bound |= ends
        if len(ends) == len(fit.names):
            raise SettingError(
                "bounds", "every coefficient ends at its bound: widen them, or check the units"
            )
        unknowns = unknowns.fixing(ends)
        fit = fit_with(unknowns)
    return fit, at_bound


def _active_bounds(fit: _Fit, unknowns: Unknowns, bounds: Bounds) -> dict[str, float]:
    """Active bounds in the solution of the quadratic programme, by coefficient."""
    coefficient_of = unknowns.coefficient_of  # other unknowns, the delays, have no bounds
    own = {name: bounds.get(name, bounds.get(coefficient_of.get(name, name))) for name in fit.names}
    ends = [own[name] or (-np.inf, np.inf) for name in fit.names]
    lower, upper = np.array(ends, dtype=np.float64).T
    if np.all((fit.values >= lower) & (fit.values <= upper)):
        return {}
    from scipy.optimize import lsq_linear  # imported here: it takes a third of a second

    scale = np.sqrt(np.diag(fit.information))
    scale = np.where(scale > 0.0, scale, 1.0)
    # In undetermined directions the solution is the one closest to the fit.
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
