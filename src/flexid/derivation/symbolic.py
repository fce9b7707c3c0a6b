"""Conversion of declarations and text expressions to SymPy objects."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import cast

import sympy as sp

from flexid.errors import ExpressionError
from flexid.models.expression import OPERATIONS, Algebra, fold
from flexid.models.parametric_system import ParametricSystem


def symbol(name: str) -> sp.Symbol:
    """Return the real symbol of a declared name; equal names give equal symbols."""
    return sp.Symbol(name, real=True)


_SYMPY = Algebra[sp.Expr](
    sp.Rational,  # exact, so that equal terms cancel
    lambda name: sp.pi if name == "pi" else symbol(name),
    OPERATIONS
    | {
        name: getattr(sp, name)
        for name in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "sign")
    }
    | {"abs": sp.Abs},
)


def to_sympy(expression: str, names: Collection[str], place: str = "expression") -> sp.Expr:
    """Convert a text expression to SymPy without evaluating it; `place` is for messages."""
    folded = fold(expression, names, _SYMPY, place)
    roots = folded.atoms(sp.Pow)
    if folded.has(sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I) or any(r.is_real is False for r in roots):
        raise ExpressionError(
            expression,
            "has no finite real value: correct the division, root, logarithm or power",
            place,
        )
    return folded


@dataclass(frozen=True)
class SymbolicRow:
    """Row ``v' = rᵀ p + k`` in symbols."""

    name: str
    coordinate: sp.Symbol
    velocity: sp.Symbol
    coefficients: tuple[sp.Symbol, ...]
    regressor: tuple[sp.Expr, ...]
    known: sp.Expr

    @property
    def acceleration(self) -> sp.Expr:
        """Right-hand side rᵀ p + k."""
        products = (p * r for p, r in zip(self.coefficients, self.regressor, strict=True))
        return sp.Add(*products) + self.known


@dataclass(frozen=True)
class SymbolicMemory:
    """Memory in symbols: its state, path, rate of the path, and grip."""

    state: sp.Symbol
    path: sp.Expr
    path_rate: sp.Expr
    grip: sp.Symbol

    @property
    def rate(self) -> sp.Expr:
        """Right-hand side s (w - |w| h)."""
        return self.grip * (self.path_rate - sp.Abs(self.path_rate) * self.state)


@dataclass(frozen=True)
class SymbolicSystem:
    """`ParametricSystem` in symbols."""

    system: ParametricSystem
    rows: tuple[SymbolicRow, ...]
    memories: tuple[SymbolicMemory, ...]
    # of each kind in order; coefficients are the unknown ones, constants are known
    states: tuple[sp.Symbol, ...]
    inputs: tuple[sp.Symbol, ...]
    constants: tuple[sp.Symbol, ...]
    coefficients: tuple[sp.Symbol, ...]

    @property
    def linear(self) -> tuple[sp.Symbol, ...]:
        """Symbols of the coefficients that multiply a regressor, first among `coefficients`."""
        return tuple(p for row in self.rows for p in row.coefficients)

    @property
    def right_hand_side(self) -> tuple[sp.Expr, ...]:
        """Rates x' of the states, in order."""
        of_rows = (e for row in self.rows for e in (row.velocity, row.acceleration))
        return (*of_rows, *(memory.rate for memory in self.memories))


def symbolic_system(system: ParametricSystem) -> SymbolicSystem:
    """Convert a declaration to symbols."""
    names = system.variables
    rows = tuple(
        SymbolicRow(
            row.name,
            symbol(row.coordinate),
            symbol(row.velocity),
            tuple(symbol(c) for c in row.coefficients),
            tuple(
                to_sympy(text, names, f"{system.name}: {row.name}.{c}")
                for c, text in row.regressors.items()
            ),
            to_sympy(row.known, names, f"{system.name}: {row.name}.known"),
        )
        for row in system.rows
    )
    rates = {row.coordinate: row.velocity for row in rows}
    memories = []
    for memory in system.memories:
        path = to_sympy(memory.path, names, f"{system.name}: {memory.name}")
        rate = sp.Add(*(sp.diff(path, q) * v for q, v in rates.items()))
        memories.append(SymbolicMemory(symbol(memory.name), path, rate, symbol(memory.grip)))
    groups = (system.states, system.inputs, system.constants, system.coefficients)
    return SymbolicSystem(system, rows, tuple(memories), *(tuple(map(symbol, g)) for g in groups))


def derivative(expression: sp.Expr, state: sp.Symbol) -> sp.Expr:
    """Differentiate by a state; the derivative of a sign is zero, also at its jump."""
    derivative = sp.diff(expression, state).replace(sp.DiracDelta, lambda *_: sp.S.Zero)
    return cast(sp.Expr, derivative)


class FreshNames:
    """Source of unused names: underscores are appended to a name that is taken."""

    def __init__(self, taken: Collection[str]) -> None:
        self._taken = set(taken)

    def take(self, name: str) -> sp.Symbol:
        """Return the real symbol of a name, or of the next unused one, and mark it as taken."""
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return symbol(name)
