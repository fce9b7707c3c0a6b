"""The observer's equations as C99 functions on doubles."""

from collections.abc import Callable, Sequence
from typing import cast

import sympy as sp
from sympy.printing.c import C99CodePrinter

from flexid.derivation.immersion import VARIABLE, graded_rule
from flexid.derivation.observer import SymbolicObserver
from flexid.derivation.printing import (
    argument_groups,
    estimate_texts,
    fresh_names,
    integrals_among,
    printable_rows,
    rate_texts,
    symbols_in_eq_2,
    symbols_in_eq_3,
    upper_limit,
    without_integrals,
)
from flexid.derivation.symbolic import FreshNames, LogCosh

_ARGUMENTS = ("state", "input", "input_rate", "observer_state", "gain", "constant")

_RESERVED_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while _Bool _Complex _Imaginary asm
asinh atan cos cosh erf exp fabs log pow sin sqrt tan tanh INFINITY NAN main
state input input_rate observer_state gain constant estimate rate NODES WEIGHTS
"""
RESERVED = frozenset(_RESERVED_WORDS.split())
"""Names that mean something in printed C."""

_LOG_COSH = """
static double log_cosh_(double z)
{
    return fabs(z) + log(1.0 + exp(-2.0*fabs(z))) - log(2.0);
}
"""


class _CPrinter(C99CodePrinter):
    """Products for small powers, and no macro that C99 does not have; notes a use of ln cosh."""

    def __init__(self, renamed: dict[sp.Symbol, sp.Symbol]) -> None:
        super().__init__()
        self._renamed = renamed
        self.log_cosh = False

    def show(self, expression: sp.Expr) -> str:
        """The expression in C."""
        return str(self.doprint(expression.xreplace(self._renamed)))

    def _print_LogCosh(self, expr: LogCosh) -> str:  # noqa: N802, SymPy's printer protocol
        self.log_cosh = True
        return f"log_cosh_({self._print(expr.args[0])})"

    def _print_NumberSymbol(self, expr: sp.NumberSymbol) -> str:  # noqa: N802, the same
        return repr(float(expr))

    def _print_Pow(self, expr: sp.Pow) -> str:  # noqa: N802, the same
        base, exponent = expr.args
        if isinstance(exponent, sp.Integer) and 2 <= int(exponent) <= 4:
            factor = self._print(base)
            factor = factor if base.is_Symbol else f"({factor})"
            return "(" + "*".join([factor] * int(exponent)) + ")"
        return super()._print_Pow(expr)


def c_observer(observer: SymbolicObserver) -> str:
    """Print an observer as two C99 functions that allocate nothing."""
    names = fresh_names(observer)
    integrals, rows = without_integrals(printable_rows(observer, names))
    hats = [p for row in observer.rows for p in row.estimates]
    groups = dict(zip(_ARGUMENTS, argument_groups(observer), strict=True))
    abbreviations = [row.abbreviation for row in rows]
    printer = _printer([*hats, *abbreviations, *(s for group in groups.values() for s in group)])
    show = printer.show
    estimates = estimate_texts(rows, show)
    meanings, rates = rate_texts(rows, show)
    reads = {
        s: _constant(show(s), f"{a}[{i}]")
        for a, group in groups.items()
        for i, s in enumerate(group)
    }
    estimated = [_constant(name, text) for name, text in estimates]
    first = [f"    estimate[{i}] = {text};" for i, (_, text) in enumerate(estimates)]
    second = [
        *estimated,
        *(_constant(name, text) for name, text in meanings),
        *(f"    rate[{i}] = {text};" for i, text in enumerate(rates)),
    ]

    def function(name: str, target: str, used: set[sp.Basic], body: list[str]) -> str:
        found, used = integrals_among(used, integrals)
        loops = [line for q, integral in found.items() for line in _sum(q, integral, show)]
        values = [line for symbol, line in reads.items() if symbol in used]
        unused = [a for a, group in groups.items() if used.isdisjoint(group)]
        return _function(name, [*groups, target], unused, [*values, *loops, *body])

    functions = "\n".join(
        (
            function("observer_estimates", "estimate", symbols_in_eq_2(rows), first),
            function("observer_rates", "rate", symbols_in_eq_3(rows), second),
        )
    )
    return _front(observer, groups, printer.log_cosh) + functions


def _printer(symbols: Sequence[sp.Symbol]) -> _CPrinter:
    """A printer that renames what is no name in C."""
    names = FreshNames([str(s) for s in symbols] + list(RESERVED))
    renamed = {
        s: sp.Symbol(str(names.take(str(s) if str(s).isascii() else "symbol")))
        for s in symbols
        if str(s) in RESERVED or not str(s).isascii()
    }
    return _CPrinter(renamed)


def _front(observer: SymbolicObserver, groups: dict, log_cosh: bool) -> str:
    lines = [
        f"/* Parametric observer, Huang (2003), of the model {observer.symbolic.system.name}.",
        *(f" * {name:15} {', '.join(map(str, group)) or 'none'}" for name, group in groups.items()),
        f" * {'estimate':15} {', '.join(str(p) for p in observer.symbolic.coefficients)}",
        " */",
    ]
    text = "\n".join(lines) + "\n#include <math.h>\n"
    if log_cosh:
        text += _LOG_COSH
    if observer.quadratures:
        nodes, weights = graded_rule()
        for name, values in (("NODES", nodes), ("WEIGHTS", weights)):
            numbers = ",\n    ".join(map(repr, values.tolist()))
            text += f"\nstatic const double {name}[{len(values)}] = {{\n    {numbers}\n}};\n"
    return text + "\n"


def _function(name: str, arrays: list[str], unused: list[str], body: list[str]) -> str:
    *given, filled = arrays
    arguments = [*(f"const double *{array}" for array in given), f"double *{filled}"]
    head = f"void {name}(\n    " + ",\n    ".join(arguments) + ")\n{"
    return "\n".join([head, *(f"    (void){array};" for array in unused), *body, "}\n"])


def _constant(name: str, value: str) -> str:
    return f"    const double {name} = {value};"


def _sum(name: sp.Symbol, integral: sp.Integral, show: Callable[[sp.Expr], str]) -> list[str]:
    """Lines that integrate over the fixed nodes."""
    upper = show(upper_limit(integral))
    return [
        f"    double {name} = 0.0;",
        f"    for (int n_ = 0; n_ < {len(graded_rule()[0])}; ++n_) {{",
        f"        const double {VARIABLE} = {upper}*NODES[n_];",
        f"        {name} += {upper}*WEIGHTS[n_]*({show(cast(sp.Expr, integral.function))});",
        "    }",
    ]
