"""Source of a torque balance's motion with its exact derivatives."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import cast

import sympy as sp

from flexid.derivation.model_functions import module_header
from flexid.derivation.sensitivities import mode_of, variation, width_of
from flexid.derivation.source import assignments, function, unpack
from flexid.derivation.symbolic import symbol, to_sympy
from flexid.models.parametric_system import ParametricSystem
from flexid.models.planar_arm import STRIBECK_CONSTANTS
from flexid.models.torque_balance import BodyTerm, JointTerm, TorqueBalance

# Functions for blocks of terms, corners and memories, which a torque balance does not have.
_UNUSED = (
    "acting(_p, _at, _on)",
    "corners(_x, _p, _c, _k)",
    "remember(_x, _start, _p)",
    "memory_slopes(_x, _start, _p, _at, _b, _q)",
)
_INLINED = 2  # largest number of joints for which functions are inlined


# With Σ_k π_k φ_k(q, v, a, u) = 0 the mass matrix M = ∂/∂a is linear in π, and at its solution a
#     ∂a/∂π_k = -M⁻¹ φ_k,        ∂a/∂x = -M⁻¹ ∂(Σ_k π_k φ_k)/∂x at fixed a.
# Rows that stick are removed from M. It is inverted in place without its zeros, motors first: they
# are coupled to links alone. The functions have the same arguments as in `sensitivities`.
@dataclass(frozen=True)
class SymbolicBalance:
    """Torque balance in symbols."""

    balance: TorqueBalance

    @cached_property
    def columns(self) -> tuple[dict[int, sp.Expr], ...]:
        """Return φ of each parameter: its torque by index of the row, where there is one."""
        return tuple(
            _of_joint(term, joint) if isinstance(term, JointTerm) else _of_body(term, self.balance)
            for _, joint, term in self.balance.placed()
        )

    @property
    def parameters(self) -> tuple[sp.Symbol, ...]:
        """Symbols of the parameters π in the generated code."""
        return tuple(sp.Symbol(f"_p{k}", real=True) for k in range(len(self.columns)))

    @cached_property
    def sums(self) -> list[sp.Expr]:
        """Σ_k π_k φ_k of each row."""
        pairs = [*zip(self.parameters, self.columns, strict=True)]
        return [
            sp.Add(*(p * column[row] for p, column in pairs if row in column)) for row in self.rows
        ]

    @property
    def rows(self) -> range:
        """Indices of the rows."""
        return range(len(self.balance.rows))

    @cached_property
    def dry(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the parameters of dry friction in each row; a row without one never sticks."""
        return tuple(
            tuple(k for k, c in enumerate(self.columns) if row in c and c[row].has(mode_of(row)))
            for row in self.rows
        )

    @cached_property
    def mass(self) -> dict[tuple[int, int], sp.Expr]:
        """Nonzero entries of M by row and column, the lower half."""
        found = {
            (i, j): sp.diff(self.sums[i], _acceleration(j))
            for i, j in combinations_with_replacement(reversed(self.rows), 2)
        }
        return {place: entry for place, entry in found.items() if entry != 0}

    @cached_property
    def by_state(self) -> list[dict[int, sp.Expr]]:
        """Nonzero derivatives of the balances by each state at fixed accelerations."""
        found = []
        for state in self.balance.states:
            slopes = {row: sp.diff(total, symbol(state)) for row, total in enumerate(self.sums)}
            found.append({row: cast(sp.Expr, s) for row, s in slopes.items() if s != 0})
        return found

    def moved(self, column: Collection[int]) -> list[int]:
        """Return the rows whose accelerations depend on some rows' balances."""
        _, known = self.inverse
        return [i for i in self.rows if any(_entry(i, j) in known for j in column)]

    @cached_property
    def inverse(self) -> tuple[list[str], set[str]]:
        """Lines that replace M by -M⁻¹ with the sweep operator, and the names of its entries."""
        lines: list[str] = []
        known = {_entry(i, j) for i, j in self.mass}
        for k in (*self.rows[1::2], *self.rows[::2]):
            near = [i for i in self.rows if i != k and _entry(i, k) in known]
            lines.append(f"_I = 1.0 / {_entry(k, k)}")
            lines += [f"_C{i} = {_entry(i, k)} * _I" for i in near]
            for i, j in combinations_with_replacement(near, 2):
                entry = _entry(i, j)
                before = entry if entry in known else "0.0"
                lines.append(f"{entry} = {before} - _C{i} * {_entry(j, k)}")
                known.add(entry)
            lines += [f"{_entry(i, k)} = _C{i}" for i in near]
            lines.append(f"{_entry(k, k)} = -_I")
        return lines, known


def _entry(i: int, j: int) -> str:
    """Return the name of an entry of the symmetric matrix M, and later of -M⁻¹."""
    return f"_M{max(i, j)}_{min(i, j)}"


def _acceleration(row: int) -> sp.Symbol:
    return sp.Symbol(f"_a{row}", real=True)


def _of_joint(term: JointTerm, joint: int) -> dict[int, sp.Expr]:
    link, motor = 2 * joint - 2, 2 * joint - 1
    if term.place == "input":
        torque = to_sympy(term.expression, {"u"}, term.name).subs(symbol("u"), symbol(f"u{joint}"))
        return {motor: cast(sp.Expr, -torque)}
    found = to_sympy(term.expression, {"q", "v", "a", *STRIBECK_CONSTANTS}, term.name)
    found = found.subs({symbol(name): symbol(f"{name}_{joint}") for name in STRIBECK_CONSTANTS})
    local = tuple(symbol(name) for name in "qva")
    sides = {
        row: (symbol(f"{q}{joint}"), symbol(f"{v}{joint}"), _acceleration(row))
        for row, q, v in ((link, "q", "v"), (motor, "t", "w"))
    }
    if term.place == "spring":
        apart = [m - x for m, x in zip(sides[motor], sides[link], strict=True)]
        torque = cast(sp.Expr, found.subs(dict(zip(local, apart, strict=True))))
        return {motor: torque, link: -torque}
    row = link if term.place == "link" else motor
    placed = found.subs(sp.sign(local[1]), mode_of(row))
    return {row: cast(sp.Expr, placed.subs(dict(zip(local, sides[row], strict=True))))}


def _of_body(term: BodyTerm, balance: TorqueBalance) -> dict[int, sp.Expr]:
    """Torque of a body term in each row, by Lagrange's equations."""
    names = {*balance.states, *balance.constants}
    kinetic = to_sympy(term.kinetic, names, term.name)
    potential = to_sympy(term.potential, names, term.name)
    coordinates = [symbol(row.coordinate) for row in balance.rows]
    speeds = [symbol(row.velocity) for row in balance.rows]
    found = {}
    for row, (q, v) in enumerate(zip(coordinates, speeds, strict=True)):
        momentum = sp.diff(kinetic, v)
        rates = [sp.diff(momentum, other) * w for other, w in zip(coordinates, speeds, strict=True)]
        rates += [sp.diff(momentum, w) * _acceleration(i) for i, w in enumerate(speeds)]
        torque = sp.Add(*rates, -sp.diff(kinetic, q), sp.diff(potential, q))
        if torque != 0:
            found[row] = torque
    return found


def balance_functions(balance: TorqueBalance) -> str:
    """Return the functions of `sensitivity_functions`, and ``columns``: f[sample, row, k] = φ_k."""
    symbolic = SymbolicBalance(balance)
    moved = [symbolic.moved(column) for column in symbolic.by_state]  # rows, by state
    width = width_of(len(balance.states), len(balance.coefficients), len(balance.rows))
    parts = (
        module_header(cast(ParametricSystem, balance), "Segmented prediction error"),
        f"N_MEMORIES = 0\nN_BLOCKS = 0\nN_CORNERS = 0\nWIDTH = {width}\n",
        f"DRY = {symbolic.dry!r}\n",
        _rates(symbolic),
        *(function(head, "Do nothing.", "    pass", decorator="inlined") for head in _UNUSED),
        _slopes(symbolic),
        variation([[s for s, rows in enumerate(moved) if row in rows] for row in symbolic.rows]),
        _columns(symbolic),
    )
    return "\n\n".join(parts)


def _variables(balance: TorqueBalance) -> tuple[str, ...]:
    symbols = [symbol(name) for name in balance.states]
    return (
        unpack("_x", symbols),
        unpack("_m", [mode_of(row) for row in range(len(balance.rows))]),
        unpack("_u", [symbol(name) for name in balance.inputs]),
        unpack("_c", [symbol(name) for name in balance.constants]),
    )


def _solved(symbolic: SymbolicBalance) -> tuple[str, ...]:
    """Lines that compute M, M⁻¹ and accelerations ``_a{row}``, which are 0 in rows that stick."""
    rows, mass = symbolic.rows, symbolic.mass
    dry = [row for row in rows if symbolic.dry[row]]
    still = [(_acceleration(i), 0) for i in rows]
    rest = [cast(sp.Expr, total.subs(still)) for total in symbolic.sums]
    targets = [_entry(i, j) for i, j in mass] + [f"_h{i}" for i in rows]
    lines = [f"_free{i} = 0.0 if _m{i} == 0.0 else 1.0" for i in dry]
    lines += [f"{_entry(i, j)} *= _free{k}" for i, j in mass for k in {i, j} & {*dry} if i != j]
    inverted, known = symbolic.inverse
    lines += [*inverted, *(f"_h{i} *= _free{i}" for i in dry)]
    for i in rows:
        products = [f"{_entry(i, j)} * _h{j}" for j in rows if _entry(i, j) in known]
        lines.append(f"_a{i} = {' + '.join(products)}")
    return (
        unpack("_p", symbolic.parameters),
        assignments(targets, [*mass.values(), *rest]),
        "\n".join(f"    {line}" for line in lines),
    )


def _rates(symbolic: SymbolicBalance) -> str:
    balance = symbolic.balance
    ends = [
        f"    _dx[{2 * i}] = {row.velocity}\n    _dx[{2 * i + 1}] = _a{i}"
        for i, row in enumerate(balance.rows)
    ]
    return function(
        "state_rates(_x, _u, _m, _p, _c, _on, _dx)",
        "_dx = x' for modes _m, parameters _p and constants _c.",
        *_variables(balance),
        *_solved(symbolic),
        "\n".join(ends),
        decorator=_decorator(balance),
    )


def _decorator(balance: TorqueBalance) -> str:
    """Decorator of the large functions: with many joints, inlining would take minutes."""
    return "inlined" if balance.joints <= _INLINED else "uncounted"


def _slopes(symbolic: SymbolicBalance) -> str:
    balance = symbolic.balance
    _, known = symbolic.inverse
    targets: list[str] = []
    expressions: list[sp.Expr] = []
    lines: list[str] = []

    def solve(column: dict[int, sp.Expr], name: str, place: str) -> None:
        """Add lines that compute -M⁻¹ times a column; ``{}`` in `place` is the row."""
        for j, value in column.items():
            targets.append(f"_{name}_{j}")
            expressions.append(value)
        for i in symbolic.moved(column):
            near = [j for j in column if _entry(i, j) in known]
            products = [f"{_entry(i, j)} * _{name}_{j}" for j in near]
            lines.append(f"    {place.format(i)} = {' + '.join(products)}")

    for state, column in enumerate(symbolic.by_state):
        solve(column, f"s{state}", f"_a[{{}} * N_STATES + {state}]")
    for k, column in enumerate(symbolic.columns):
        solve(column, f"k{k}", f"_r[{{}} * WIDTH + _at[{k}]]")
    inputs = [(symbol(u), sp.Symbol(f"_du[{j}]")) for j, u in enumerate(balance.inputs)]
    delayed = (sp.Add(*(sp.diff(total, u) * du for u, du in inputs)) for total in symbolic.sums)
    column = {row: slope for row, slope in enumerate(delayed) if slope != 0}
    solve(column, "d", "_r[{} * WIDTH + _delay]")  # in column 0, which is unused, without a delay
    return function(
        "slopes(_x, _u, _du, _m, _p, _c, _on, _at, _delay, _a, _r)",
        "Derivatives of the accelerations: _a by the states, _r by the rest.",
        *_variables(balance),
        *_solved(symbolic),
        assignments(targets, expressions),
        "\n".join(lines),
        decorator=_decorator(balance),
    )


def _columns(symbolic: SymbolicBalance) -> str:
    balance = symbolic.balance
    places = [(row, k) for k, column in enumerate(symbolic.columns) for row in column]
    each = function(
        "columns_at(_x, _u, _m, _c, _a, _f)",
        "_f[row, k] = φ_k at the accelerations _a.",
        *_variables(balance),
        unpack("_a", [_acceleration(row) for row in range(len(balance.rows))]),
        assignments(
            [f"_f[{row}, {k}]" for row, k in places],
            [symbolic.columns[k][row] for row, k in places],
        ),
    )
    along = function(
        "columns(_x, _u, _m, _c, _a, _f)",
        "Call `columns_at` at every sample, for least squares and excitation.",
        "    for _n in range(len(_x)):\n"
        "        columns_at(_x[_n], _u[_n], _m[_n], _c, _a[_n], _f[_n])",
    )
    return f"{each}\n\n{along}"
