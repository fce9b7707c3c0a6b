"""Class of systems of Huang (2003), eq. (1): rows q' = v, v' = r(x, u)ᵀ p + k(x, u)."""

import hashlib
import json
import keyword
from collections.abc import Collection, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

from flexid.errors import ModelError
from flexid.models.expression import CONSTANTS, FUNCTIONS, check_expression

RESERVED = frozenset(
    {*FUNCTIONS, *CONSTANTS, "t", "Abs", "copysign", "log"} | {"len", "np", "njit", "range"}
)
"""Names with a meaning in expressions or in generated code."""


@dataclass(frozen=True)
class Row:
    """One second-order equation.

    Parameters
    ----------
    name : str
        Name of the row, for example ``"link"``.
    coordinate, velocity : str
        Names of q and v.
    regressors : mapping of str to expression
        Coefficient name to the basis function that multiplies it. Expressions are text or SymPy.
    known : expression, optional
        The known part k, which may use the system's constants.
    """

    name: str
    coordinate: str
    velocity: str
    regressors: Mapping[str, str]
    known: str = "0"

    def __post_init__(self) -> None:
        # A SymPy expression prints as text of the same grammar, so only text is stored.
        object.__setattr__(self, "regressors", {c: str(r) for c, r in self.regressors.items()})
        object.__setattr__(self, "known", str(self.known))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the unknown coefficients, in order."""
        return tuple(self.regressors)


@dataclass(frozen=True)
class Memory:
    """Hysteresis state h in [-1, 1], h' = s (w - |w| h), of a path of rate w (Dahl, 1968)."""

    name: str  # name of h in expressions
    path: str  # coordinates of rows, or a difference of two
    grip: str  # name of the coefficient s in 1/rad: one over the path within which h follows


def check_name(model: str, name: str) -> None:
    """Raise `ModelError` if expressions cannot use a name."""
    if keyword.iskeyword(name):
        raise ModelError(
            model, f"{name!r} is a keyword of Python, so no expression can use it: write {name}_"
        )
    if not name.isidentifier() or name.startswith("_"):
        raise ModelError(
            model,
            f"{name!r} is no valid name: use letters, digits and _, and begin with a letter",
        )


@dataclass(frozen=True)
class ParametricSystem:
    """System of rows ``v' = r(x, u)ᵀ p + k(x, u)`` with measured state x and input u.

    Parameters
    ----------
    name : str
        Name of the model.
    rows : tuple of Row
        At least one.
    inputs : tuple of str, optional
        Names of the inputs.
    constants : mapping of str to float, optional
        Known numbers that expressions may use, with their default values; values can be replaced
        at run time without another derivation.
    memories : tuple of Memory, optional
        Hysteresis states that expressions may use in addition to the rows' states. Only the
        prediction error supports them.
    nonlinear : tuple of str, optional
        Further coefficients, in which expressions may be nonlinear. Only the prediction error
        estimates them.

    Raises
    ------
    ModelError
        If a name is invalid or declared twice.
    ExpressionError
        If an expression leaves the whitelist or uses an undeclared name.

    Examples
    --------
    >>> pendulum = ParametricSystem(
    ...     "pendulum",
    ...     (Row("arm", "q", "v", {"gravity": "-sin(q)", "friction": "-v"}, known="u"),),
    ... )
    >>> pendulum.coefficients
    ('gravity', 'friction')
    """

    name: str
    rows: tuple[Row, ...]
    inputs: tuple[str, ...] = ("u",)
    constants: Mapping[str, float] = field(default_factory=dict)
    memories: tuple[Memory, ...] = ()
    nonlinear: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("rows", "inputs", "memories", "nonlinear"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "constants", {c: float(v) for c, v in self.constants.items()})
        if not self.rows:
            raise ModelError(self.name, "has no rows: declare at least one")
        self._check_names()
        self._check_expressions()

    def _check_names(self) -> None:
        names = [*self.states, *self.inputs, *self.constants, *self.coefficients]
        for name in names:
            check_name(self.name, name)
            if name in RESERVED:
                raise ModelError(self.name, f"{name!r} is reserved: choose another name")
            if names.count(name) > 1:
                raise ModelError(self.name, f"{name!r} is declared twice: rename one")
        if len({row.name for row in self.rows}) != len(self.rows):
            raise ModelError(self.name, "two rows have the same name: rename one")
        for row in self.rows:
            if not row.regressors:
                raise ModelError(self.name, f"row {row.name!r} has no unknown coefficient: add one")

    def _check_expressions(self) -> None:
        names = self.variables
        for row in self.rows:
            for coefficient, regressor in row.regressors.items():
                check_expression(regressor, names, f"{self.name}: {row.name}.{coefficient}")
            check_expression(row.known, names, f"{self.name}: {row.name}.known")
        coordinates = frozenset(row.coordinate for row in self.rows)
        for memory in self.memories:
            check_expression(memory.path, coordinates, f"{self.name}: {memory.name}")

    @cached_property
    def states(self) -> tuple[str, ...]:
        """State names in order: coordinate and velocity, row by row, then memories."""
        of_rows = (name for row in self.rows for name in (row.coordinate, row.velocity))
        return (*of_rows, *(memory.name for memory in self.memories))

    @cached_property
    def coefficients(self) -> tuple[str, ...]:
        """Names of all unknown coefficients: row by row, then nonlinear ones, grips last."""
        of_rows = (name for row in self.rows for name in row.coefficients)
        return (*of_rows, *self.nonlinear, *(memory.grip for memory in self.memories))

    @cached_property
    def variables(self) -> frozenset[str]:
        """Names that an expression of this system may use."""
        return frozenset({*self.states, *self.inputs, *self.constants, *self.nonlinear})

    @cached_property
    def digest(self) -> str:
        """Hash of everything that a derivation depends on, thus without the constants' values."""
        content = {
            "name": self.name,
            "rows": [
                [row.name, row.coordinate, row.velocity, list(row.regressors.items()), row.known]
                for row in self.rows
            ],
            "inputs": self.inputs,
            "constants": list(self.constants),
        }
        if self.memories:
            content["memories"] = [[m.name, m.path, m.grip] for m in self.memories]
        if self.nonlinear:
            content["nonlinear"] = self.nonlinear
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]

    def with_constants(self, values: Mapping[str, float]) -> "ParametricSystem":
        """Return the same system with other values of some constants.

        The system is not checked again, because only values change.

        Parameters
        ----------
        values : mapping of str to float
            New values by name; other constants keep their values.

        Raises
        ------
        ModelError
            If the system has no constant of a given name.
        """
        for name in values:
            if name not in self.constants:
                raise ModelError(
                    self.name,
                    f"has no constant {name!r}; it has {', '.join(self.constants) or 'none'}",
                )
        changed = copy(self)
        constants = {name: float(values.get(name, old)) for name, old in self.constants.items()}
        object.__setattr__(changed, "constants", constants)
        return changed

    def seeking(self, names: Collection[str]) -> "ParametricSystem":
        """Return the same system with some constants turned into unknown nonlinear coefficients.

        Parameters
        ----------
        names : collection of str
            Names of constants; other names are ignored.
        """
        constants = {name: v for name, v in self.constants.items() if name not in names}
        sought = tuple(name for name in self.constants if name in names)
        return replace(self, constants=constants, nonlinear=(*self.nonlinear, *sought))

    def knowing(self, values: Mapping[str, float]) -> "ParametricSystem":
        """Return the same system with some nonlinear coefficients turned into known constants.

        Parameters
        ----------
        values : mapping of str to float
            Values by name; other names are ignored.
        """
        known = {name: values[name] for name in self.nonlinear if name in values}
        sought = tuple(name for name in self.nonlinear if name not in known)
        return replace(self, constants={**self.constants, **known}, nonlinear=sought)

    def row_slices(self) -> Iterator[tuple[Row, slice]]:
        """Yield each row with the slice of its coefficients in `coefficients`."""
        start = 0
        for row in self.rows:
            stop = start + len(row.regressors)
            yield row, slice(start, stop)
            start = stop
