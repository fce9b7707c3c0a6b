"""The observer's equations as plain Python that needs nothing but `math`."""

from collections.abc import Callable, Sequence
from typing import cast

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

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
from flexid.derivation.symbolic import LogCosh

_ARGUMENTS = ("states", "inputs", "input_rates", "observer_states", "gains", "constants")

_LOG_COSH = '''def _log_cosh(z):
    """ln cosh z, without overflow."""
    return abs(z) + log(1.0 + exp(-2.0 * abs(z))) - log(2.0)
'''

_INTEGRATE = '''def _integrate(function, upper):
    """Integral from 0 to upper: {count} nodes of Gauss and Legendre, dense towards 0."""
    return upper * sum(w * function(upper * t) for t, w in zip(_NODES, _WEIGHTS))


_NODES = {nodes!r}
_WEIGHTS = {weights!r}


'''


class _PythonPrinter(PythonCodePrinter):
    """Notes what it has used: names of `math` in ``module_imports``, and ln cosh."""

    def __init__(self) -> None:
        super().__init__({"fully_qualified_modules": False})
        self.log_cosh = False

    def _print_LogCosh(self, expr: LogCosh) -> str:  # noqa: N802, SymPy's printer protocol
        self.log_cosh = True
        return f"_log_cosh({self._print(expr.args[0])})"

    def _print_Exp1(self, expr: sp.NumberSymbol) -> str:  # noqa: ARG002, N802, the same
        return f"{self._module_format('math.exp')}(1)"  # a model may have its own e

    def _print_sign(self, e: sp.Function) -> str:
        argument = self._print(e.args[0])
        copysign = self._module_format("math.copysign")
        return f"(0.0 if {argument} == 0 else {copysign}(1.0, {argument}))"

    @property
    def math(self) -> set[str]:
        """What it has used of `math`."""
        used = {name.removeprefix("math.") for name in self.module_imports.get("math", ())}
        return used | ({"exp", "log"} if self.log_cosh else set())


def python_observer(observer: SymbolicObserver) -> str:
    """Print an observer as a Python module of two functions, ``estimates`` and ``rates``."""
    printer = _PythonPrinter()
    functions = _functions(observer, lambda expression: str(printer.doprint(expression)))
    helpers = _LOG_COSH + "\n\n" if printer.log_cosh else ""
    if observer.quadratures:
        nodes, weights = graded_rule()
        helpers += _INTEGRATE.format(
            count=len(nodes), nodes=tuple(nodes.tolist()), weights=tuple(weights.tolist())
        )
    used = ", ".join(sorted(printer.math))
    head = (
        f'"""Parametric observer, Huang (2003), of the model {observer.symbolic.system.name}."""\n'
    )
    return head + (f"\nfrom math import {used}\n\n\n" if used else "\n\n") + helpers + functions


def _functions(observer: SymbolicObserver, show: Callable[[sp.Expr], str]) -> str:
    names = fresh_names(observer)
    integrals, rows = without_integrals(printable_rows(observer, names))
    groups = dict(zip(_ARGUMENTS, argument_groups(observer), strict=True))
    arguments = {str(names.take(name)): group for name, group in groups.items() if group}
    unpacking = [f"{_tuple(group)} = {name}" for name, group in arguments.items()]
    estimates = [f"{p} = {text}" for p, text in estimate_texts(rows, show)]
    abbreviations, rates = rate_texts(rows, show)
    hats = _tuple([p for row in observer.rows for p in row.estimates])
    of_eq_2 = _integrals(integrals_among(symbols_in_eq_2(rows), integrals)[0], show)
    of_eq_3 = _integrals(integrals_among(symbols_in_eq_3(rows), integrals)[0], show)
    blocks = (
        (
            f"def estimates({', '.join(arguments)}):",
            '"""Estimates of the coefficients."""  # Huang (2003), eq. (2)',
            [*unpacking, *of_eq_2, *estimates, f"return {hats}"],
        ),
        (
            f"def rates({', '.join(arguments)}):",
            '"""Rates of the observer\'s states."""  # Huang (2003), eq. (3)',
            [
                *unpacking,
                *of_eq_3,
                *estimates,
                *(f"{name} = {meaning}" for name, meaning in abbreviations),
                "return (",
                *(f"    {rate}," for rate in rates),
                ")",
            ],
        ),
    )
    return "\n\n".join(
        "\n".join([head, *(f"    {line}" for line in (doc, *body))]) + "\n"
        for head, doc, body in blocks
    )


def _integrals(
    integrals: dict[sp.Symbol, sp.Integral], show: Callable[[sp.Expr], str]
) -> list[str]:
    """Lines that integrate."""
    return [
        f"{name} = _integrate(lambda {VARIABLE}: {show(cast(sp.Expr, i.function))}, "
        f"{show(upper_limit(i))})"
        for name, i in integrals.items()
    ]


def _tuple(symbols: Sequence[sp.Symbol]) -> str:
    """The symbols as a Python tuple without parentheses."""
    return ", ".join(map(str, symbols)) + ("," if len(symbols) == 1 else "")
