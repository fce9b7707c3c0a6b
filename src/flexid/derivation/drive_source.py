"""C99 source of a model: its signals for an estimator on a drive, and its rates as a plant."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from flexid.derivation.model_functions import signal_parts
from flexid.derivation.source import ScalarPrinter
from flexid.derivation.symbolic import FreshNames, SymbolicSystem, symbolic_system
from flexid.models.parametric_system import ParametricSystem

MACROS = ("SIN", "COS", "TAN", "TANH", "EXP", "LOG", "SQRT", "FABS", "POW")
"""Macros that the printed source may call, to be defined for the number type in use."""


@dataclass(frozen=True)
class CFunctions:
    """Source of a model in C99."""

    source: str
    calls: frozenset[str]  # names out of MACROS, and sign_of, that the source calls
    names: dict[str, str]  # identifiers in C of states, inputs and coefficients
    held: tuple[bool, ...] = ()  # of each signal (regressors, then known parts): uses an input


def drive_functions(system: ParametricSystem) -> CFunctions:
    """Print the signals of a model for an estimator from positions."""
    symbolic = symbolic_system(system)
    printer = _Printer(symbolic)
    labels = [*system.coefficients, *(f"known part of {row.name}" for row in system.rows)]
    texts = [text for row in system.rows for text in row.regressors.values()]
    texts += [row.known for row in system.rows]
    comments = [comment(f"{label}: {text}") for label, text in zip(labels, texts, strict=True)]
    parts = signal_parts(symbolic)
    sampled = [
        (f"signal[{i}] =", part.memoryless + part.remainder, comment)
        for i, (part, comment) in enumerate(zip(parts, comments, strict=True))
    ]
    velocities = [row.velocity for row in symbolic.rows]
    linear = [
        (f"signal[{i}] +=", factor * v, comment)
        for i, (part, comment) in enumerate(zip(parts, comments, strict=True))
        for factor, v in zip(part.velocity_factors, velocities, strict=True)
        if factor != 0
    ]
    arrays = {"states": symbolic.states, "inputs": symbolic.inputs}
    moving = {"velocities": velocities}
    constants = system.constants
    functions = (
        printer.function("sampled_parts", arrays, "signal", sampled, constants),
        printer.function("add_velocity_parts", moving, "signal", linear, constants),
    )
    names = (*system.states, *system.inputs, *system.coefficients)
    return CFunctions(
        "\n".join(functions),
        frozenset(printer.calls),
        {name: printer.name(name) for name in names},
        tuple(part.depends_on_input for part in parts),
    )


def plant_functions(system: ParametricSystem) -> CFunctions:
    """Print ``rates`` for simulators; its argument `constant` has coefficients, then constants."""
    symbolic = symbolic_system(system)
    printer = _Printer(symbolic)
    arrays = {
        "state": symbolic.states,
        "input": symbolic.inputs,
        "constant": (*symbolic.coefficients, *symbolic.constants),
    }
    rates = zip(symbolic.states, symbolic.right_hand_side, strict=True)
    lines = [(f"rate[{place}] =", rate, f"{x}'") for place, (x, rate) in enumerate(rates)]
    source = printer.function("rates", arrays, "rate", lines)
    return CFunctions(source, frozenset(printer.calls), {})


# Literals are REAL(...) and functions are macros such as SIN, so that one definition selects float
# or double. Operations and their order are the same as in the compiled Python.
class _Printer(ScalarPrinter):
    """Printer of C with the arithmetic of the compiled Python, in one number type."""

    def __init__(self, symbolic: SymbolicSystem) -> None:
        super().__init__({"fully_qualified_modules": False})
        system = symbolic.system
        self._own = (*system.states, *system.inputs, *system.coefficients, *system.constants)
        self._renamed = _renamed(self._own)
        self.calls: set[str] = set()

    def name(self, name: str) -> str:
        """Return the identifier in C of a declared name."""
        return self._renamed.get(name, name)

    def function(
        self,
        name: str,
        arrays: Mapping[str, Sequence[sp.Symbol]],
        result: str,
        lines: Sequence[tuple[str, sp.Expr, str]],  # target, value and comment
        constants: Mapping[str, float] | None = None,
    ) -> str:
        """Return the source of a function that reads symbols from arrays and fills `result`."""
        fresh = FreshNames([self.name(own) for own in self._own])
        names = (fresh.take(f"e{number}") for number in range(10**6))
        expressions = [expression for _, expression, _ in lines]
        temporaries, reduced = sp.cse(expressions, symbols=names, optimizations="basic")
        used = {str(s) for expression in expressions for s in expression.free_symbols}
        unused = [array for array, group in arrays.items() if used.isdisjoint(map(str, group))]
        values = {
            str(s): f"{array}[{i}]" for array, g in arrays.items() for i, s in enumerate(g)
        } | {c: literal(value) for c, value in (constants or {}).items()}
        known = {self.name(s): value for s, value in values.items() if s in used}
        known |= {str(s): self.doprint(value) for s, value in temporaries}
        body = [f"(void){array};" for array in [*unused, *([] if lines else [result])]]
        body += [f"const flexid_real {s} = {value};" for s, value in known.items()]
        for (target, _, comment), value in zip(lines, reduced, strict=True):
            body.append(f"{target} {self.doprint(sp.sympify(value))}; /* {comment} */")
        arguments = [*(f"const flexid_real {array}[]" for array in arrays)]
        arguments.append(f"flexid_real {result}[]")
        text = "\n    ".join(body)
        return f"static void {name}({', '.join(arguments)})\n{{\n    {text}\n}}\n"

    def call(self, function: str, *arguments: sp.Basic) -> str:
        """Return a call of a macro, and record it in `calls`."""
        self.calls.add(function)
        return f"{function}({', '.join(self._print(a) for a in arguments)})"

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return self.name(expr.name)

    def _print_Integer(self, expr: sp.Integer) -> str:
        return literal(float(expr))

    _print_Rational = _print_Float = _print_NumberSymbol = _print_Integer  # pyright: ignore
    _print_Pi = _print_Exp1 = _print_Integer  # pyright: ignore

    def _print_Function(self, expr: sp.Function) -> str:
        name = "FABS" if isinstance(expr, sp.Abs) else type(expr).__name__.upper()
        return self.call(name, *expr.args)

    _print_sin = _print_cos = _print_tan = _print_tanh = _print_Function
    _print_exp = _print_log = _print_Abs = _print_Function

    def _print_sign(self, e: sp.Function) -> str:
        return self.call("sign_of", e.args[0])

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:  # noqa: ARG002 - SymPy's
        base, exponent = expr.args
        if isinstance(exponent, sp.Integer) and abs(int(exponent)) <= 4:
            product = " * ".join([f"({self._print(base)})"] * abs(int(exponent)))
            return f"({product})" if exponent.is_positive else f"({literal(1.0)} / ({product}))"
        if exponent == sp.S.Half:
            return self.call("SQRT", base)
        return self.call("POW", base, exponent)


_RESERVED_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while _Bool _Complex _Imaginary asm
asinh atan cos cosh erf exp fabs log pow sin sqrt tan tanh INFINITY NAN main
state input input_rate observer_state gain constant estimate rate NODES WEIGHTS
"""
RESERVED = frozenset(_RESERVED_WORDS.split())  # names with a meaning in printed C

_TAKEN = re.compile(r"[A-Z][A-Z0-9_]+|flexid_\w+|\w+_t")
"""Macros of the estimator and of the C library, and types."""

_OWN_NAMES = {"states", "inputs", "signal", "velocities", "sign_of", "bool", "true", "false"}


def _renamed(names: Sequence[str]) -> dict[str, str]:
    """New names for declared ones that are no identifiers in C or are used in the source."""
    fresh = FreshNames([*names, *RESERVED, *_OWN_NAMES, *MACROS])
    renamed = names_in_c(names, fresh, RESERVED | _OWN_NAMES)
    return renamed | {
        name: str(fresh.take(f"{name.lower()}_"))
        for name in names
        if name not in renamed and _TAKEN.fullmatch(name)
    }


def names_in_c(names: Sequence[str], fresh: FreshNames, taken: Collection[str]) -> dict[str, str]:
    """Return new names for declared ones that are no identifiers in C or are taken."""
    return {
        name: str(fresh.take(name if name.isascii() else "symbol"))
        for name in names
        if name in taken or not name.isascii()
    }


def literal(value: float) -> str:
    """Return a literal in C that is float or double."""
    value = float(value)
    return f"REAL({value!r})" if value >= 0.0 else f"(-REAL({-value!r}))"


def comment(text: str) -> str:
    """Return a text on one line that is safe in a comment of C."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").split())
