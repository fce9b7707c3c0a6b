"""A model's functions in C99: for an estimator on a drive, in one number type, and as a plant.

Every literal stands in ``REAL(...)`` and every function behind a macro (``SIN``), so that one
definition makes all of it float or double. The operations are those of the compiled Python, in the
same order, so that both agree to rounding.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import sympy as sp

from flexid.derivation.printing_code import RESERVED
from flexid.derivation.regressor_classes import RegressorParts, split_regressor
from flexid.derivation.source import ScalarPrinter
from flexid.derivation.symbolic import FreshNames, SymbolicSystem, symbolic_system
from flexid.models.parametric_system import ParametricSystem

MACROS = ("SIN", "COS", "TAN", "TANH", "EXP", "SQRT", "FABS", "POW")
"""Functions that the printed source may call; the estimator defines them for its number type."""


@dataclass(frozen=True)
class DriveFunctions:
    """A model in C99."""

    source: str
    calls: frozenset[str]  # of MACROS
    names: dict[str, str]  # identifiers in C of states, inputs and coefficients
    held: tuple[bool, ...]  # by signal (regressors, then known parts): an input occurs in it


def drive_functions(system: ParametricSystem, positions_only: bool) -> DriveFunctions:
    """Print what an estimator needs from a model."""
    symbolic = symbolic_system(system)
    labels = [*system.coefficients, *(f"known part of {row.name}" for row in system.rows)]
    texts = [text for row in system.rows for text in row.regressors.values()]
    texts += [row.known for row in system.rows]
    expressions = [r for row in symbolic.rows for r in row.regressor]
    expressions += [row.known for row in symbolic.rows]
    parts = [split_regressor(expression, symbolic) for expression in expressions]
    printer = _printer(symbolic)
    names = (*system.states, *system.inputs, *system.coefficients)
    comments = [comment(f"{label}: {text}") for label, text in zip(labels, texts, strict=True)]
    if positions_only:
        sampled = [part.memoryless + part.remainder for part in parts]
        functions = [
            _sampled_parts(printer, symbolic, system, sampled, comments),
            _velocity_parts(printer, system, parts, comments),
        ]
    else:
        functions = [_sampled_parts(printer, symbolic, system, expressions, comments)]
    return DriveFunctions(
        "\n".join(functions),
        frozenset(printer.calls),
        {name: printer.name(name) for name in names},
        tuple(part.depends_on_input for part in parts),
    )


class _DrivePrinter(ScalarPrinter):
    """The arithmetic of the compiled Python, in C and in one number type."""

    def __init__(self, renamed: dict[str, str]) -> None:
        super().__init__({"fully_qualified_modules": False})
        self._renamed = renamed
        self.calls: set[str] = set()

    def name(self, name: str) -> str:
        """Identifier in C."""
        return self._renamed.get(name, name)

    def real(self, value: float) -> str:
        """A literal."""
        return f"REAL({value!r})" if value >= 0.0 else f"(-REAL({-value!r}))"

    def call(self, function: str, *arguments: sp.Basic) -> str:
        """A call of a macro, which is noted."""
        self.calls.add(function)
        return f"{function}({', '.join(self._print(a) for a in arguments)})"

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return self.name(expr.name)

    def _print_Integer(self, expr: sp.Integer) -> str:
        return self.real(float(expr))

    _print_Rational = _print_Float = _print_NumberSymbol = _print_Integer  # pyright: ignore
    _print_Pi = _print_Exp1 = _print_Integer  # pyright: ignore

    def _print_Function(self, expr: sp.Function) -> str:
        name = "FABS" if isinstance(expr, sp.Abs) else type(expr).__name__.upper()
        return self.call(name, *expr.args)

    _print_sin = _print_cos = _print_tan = _print_tanh = _print_Function
    _print_exp = _print_Abs = _print_Function

    def _print_sign(self, e: sp.Function) -> str:
        return f"sign_of({self._print(e.args[0])})"

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:  # noqa: ARG002 - SymPy's
        base, exponent = expr.args
        if isinstance(exponent, sp.Integer) and abs(int(exponent)) <= 4:
            product = " * ".join([f"({self._print(base)})"] * abs(int(exponent)))
            return f"({product})" if exponent.is_positive else f"({self.real(1.0)} / ({product}))"
        if exponent == sp.S.Half:
            return self.call("SQRT", base)
        return self.call("POW", base, exponent)


class _PlantPrinter(_DrivePrinter):
    """The same on doubles."""

    def real(self, value: float) -> str:
        """A literal."""
        return repr(value) if value >= 0.0 else f"({value!r})"

    def call(self, function: str, *arguments: sp.Basic) -> str:
        """A call of the C library."""
        return super().call(function.lower(), *arguments)

    def _print_sign(self, e: sp.Function) -> str:
        argument = self._print(e.args[0])
        return f"(({argument} == 0.0) ? 0.0 : copysign(1.0, {argument}))"


def plant_rates(system: ParametricSystem) -> str:
    """Source of ``rates(x, u, p, dx)``, for simulators: p has coefficients, then constants."""
    symbolic = symbolic_system(system)
    groups = {
        "x": symbolic.states,
        "u": symbolic.inputs,
        "p": (*symbolic.coefficients, *symbolic.constants),
    }
    printer = _PlantPrinter(
        {s.name: f"{a}[{i}]" for a, g in groups.items() for i, s in enumerate(g)}
    )
    names = sp.numbered_symbols("e", real=True)
    expressions = list(symbolic.right_hand_side)
    temporaries, reduced = sp.cse(expressions, symbols=names, optimizations="basic")
    used = set().union(*(e.free_symbols for e in expressions))
    return _function(
        "rates",
        ("const double x[]", "const double u[]", "const double p[]", "double dx[]"),
        [
            *(f"const double {name} = {printer.doprint(value)};" for name, value in temporaries),
            *(f"(void){array};" for array, group in groups.items() if used.isdisjoint(group)),
        ],
        [
            f"dx[{place}] = {printer.doprint(value)}; /* {state}' */"
            for place, (state, value) in enumerate(zip(symbolic.states, reduced, strict=True))
        ],
    )


def _printer(symbolic: SymbolicSystem) -> _DrivePrinter:
    """A printer that renames what is no identifier in C, or means something in the source."""
    system = symbolic.system
    names = [*system.states, *system.inputs, *system.coefficients, *system.constants]
    fresh = FreshNames([*names, *RESERVED, *_OWN_NAMES])
    renamed = {
        name: str(fresh.take(name if name.isascii() else "symbol"))
        for name in names
        if name in RESERVED or name in _OWN_NAMES or not name.isascii()
    }
    renamed |= {
        name: str(fresh.take(f"{name.lower()}_"))
        for name in names
        if name not in renamed and _TAKEN.fullmatch(name)
    }
    return _DrivePrinter(renamed)


_TAKEN = re.compile(r"[A-Z][A-Z0-9_]+|flexid_\w+|\w+_t")
"""Macros of the estimator and of the C library, and types."""

_OWN_NAMES = frozenset(
    {
        "states",
        "inputs",
        "signal",
        "velocities",
        "REAL",
        "sign_of",
        "bool",
        "true",
        "false",
        *MACROS,
    }
)


def comment(text: str) -> str:
    """A text that may stand in a comment of C, on one line."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").split())


def _sampled_parts(
    printer: _DrivePrinter,
    symbolic: SymbolicSystem,
    system: ParametricSystem,
    expressions: Sequence[sp.Expr],
    comments: Sequence[str],
) -> str:
    fresh = FreshNames([printer.name(n) for n in (*system.variables, *system.coefficients)])
    names = (fresh.take(f"e{number}") for number in range(10**6))
    temporaries, reduced = sp.cse(list(expressions), symbols=names, optimizations="basic")
    used = set().union(*(cast(sp.Expr, sp.sympify(e)).free_symbols for e in expressions))
    lines = _reads(printer, symbolic.states, "states", used) + _reads(
        printer, symbolic.inputs, "inputs", used
    )
    lines += _constants(printer, system, used)
    lines += [f"const flexid_real {n} = {printer.doprint(value)};" for n, value in temporaries]
    ignored = [a for a, group in _groups(symbolic) if used.isdisjoint(group)]
    return _function(
        "sampled_parts",
        ("const flexid_real states[]", "const flexid_real inputs[]", "flexid_real signal[]"),
        [*(f"(void){array};" for array in ignored), *lines],
        [
            f"signal[{i}] = {printer.doprint(sp.sympify(value))}; /* {comment} */"
            for i, (value, comment) in enumerate(zip(reduced, comments, strict=True))
        ],
    )


def _velocity_parts(
    printer: _DrivePrinter,
    system: ParametricSystem,
    parts: Sequence[RegressorParts],
    comments: Sequence[str],
) -> str:
    factors = [factor for part in parts for factor in part.velocity_factors]
    used = set().union(*(factor.free_symbols for factor in factors))
    body = [
        f"signal[{i}] += {printer.doprint(factor)} * velocities[{j}]; /* {comment} */"
        for i, (part, comment) in enumerate(zip(parts, comments, strict=True))
        for j, factor in enumerate(part.velocity_factors)
        if factor != 0
    ]
    ignored = [] if body else ["(void)velocities;", "(void)signal;"]
    return _function(
        "add_velocity_parts",
        ("const flexid_real velocities[]", "flexid_real signal[]"),
        [*ignored, *_constants(printer, system, used)],
        body,
    )


def _groups(symbolic: SymbolicSystem) -> tuple[tuple[str, tuple[sp.Symbol, ...]], ...]:
    return (("states", symbolic.states), ("inputs", symbolic.inputs))


def _reads(
    printer: _DrivePrinter, symbols: Sequence[sp.Symbol], array: str, used: set[sp.Basic]
) -> list[str]:
    return [
        f"const flexid_real {printer.name(s.name)} = {array}[{i}];"
        for i, s in enumerate(symbols)
        if s in used
    ]


def _constants(printer: _DrivePrinter, system: ParametricSystem, used: set[sp.Basic]) -> list[str]:
    names = {str(s) for s in used}
    return [
        f"const flexid_real {printer.name(name)} = {printer.real(value)};"
        for name, value in system.constants.items()
        if name in names
    ]


def _function(
    name: str, arguments: Sequence[str], declarations: Sequence[str], body: Sequence[str]
) -> str:
    lines = "\n".join(f"    {line}" for line in (*declarations, *body))
    return f"static void {name}({', '.join(arguments)})\n{{\n{lines}\n}}\n"
