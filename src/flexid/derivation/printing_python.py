"""The observer's equations as plain Python that needs nothing but `math`."""

import re
from collections.abc import Sequence
from typing import cast

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from flexid.derivation.immersion import VARIABLE
from flexid.derivation.observer import SymbolicObserver
from flexid.derivation.observer_functions import upper_limit
from flexid.derivation.printing import (
    argument_groups,
    estimate_texts,
    fresh_names,
    printable_rows,
    rate_texts,
    without_integrals,
)
from flexid.derivation.quadrature import graded_rule
from flexid.derivation.special import LogCosh

_ARGUMENTS = ("states", "inputs", "input_rates", "observer_states", "gains", "constants")

_MATH = ("asinh", "atan", "copysign", "cos", "cosh", "erf", "exp", "log", "pi")
_MATH += ("sin", "sqrt", "tan", "tanh")

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
    def _print_LogCosh(self, expr: LogCosh) -> str:  # noqa: N802, SymPy's printer protocol
        return f"_log_cosh({self._print(expr.args[0])})"

    def _print_Exp1(self, expr: sp.NumberSymbol) -> str:  # noqa: ARG002, N802, the same
        return "exp(1)"  # a model may have its own e

    def _print_sign(self, e: sp.Function) -> str:
        argument = self._print(e.args[0])
        return f"(0.0 if {argument} == 0 else copysign(1.0, {argument}))"


_printer = _PythonPrinter({"fully_qualified_modules": False})


def _show(expression: sp.Expr) -> str:
    return str(_printer.doprint(expression))


def python_observer(observer: SymbolicObserver) -> str:
    """Print an observer as a Python module of two functions, ``estimates`` and ``rates``.

    Parameters
    ----------
    observer : SymbolicObserver
        The observer.

    Returns
    -------
    str
        Source. Both functions take sequences of states, inputs (their rates, if the observer
        needs them), the observer's own states, gains and constants (if there are any).
    """
    functions = _functions(observer)
    called = set(re.findall(r"[A-Za-z_]\w*(?=\()|\bpi\b", functions))
    helpers = _LOG_COSH + "\n\n" if "_log_cosh" in called else ""
    if "_integrate" in called:
        nodes, weights = graded_rule()
        helpers += _INTEGRATE.format(
            count=len(nodes), nodes=tuple(nodes.tolist()), weights=tuple(weights.tolist())
        )
    called |= set(re.findall(r"\w+(?=\()", helpers))
    used = ", ".join(name for name in _MATH if name in called)
    head = (
        f'"""Parametric observer, Huang (2003), of the model {observer.symbolic.system.name}."""\n'
    )
    return head + (f"\nfrom math import {used}\n\n\n" if used else "\n\n") + helpers + functions


def _functions(observer: SymbolicObserver) -> str:
    names = fresh_names(observer)
    integrals, rows = without_integrals(printable_rows(observer, names))
    groups = dict(zip(_ARGUMENTS, argument_groups(observer), strict=True))
    arguments = {str(names.take(name)): group for name, group in groups.items() if group}
    unpacking = [f"{_tuple(group)} = {name}" for name, group in arguments.items()]
    estimates = [f"{p} = {text}" for p, text in estimate_texts(rows, _show)]
    abbreviations, rates = rate_texts(rows, _show)
    hats = _tuple([p for row in observer.rows for p in row.estimates])
    blocks = (
        (
            f"def estimates({', '.join(arguments)}):",
            '"""Estimates of the coefficients."""  # Huang (2003), eq. (2)',
            [*unpacking, *_integrals(integrals, estimates), *estimates, f"return {hats}"],
        ),
        (
            f"def rates({', '.join(arguments)}):",
            '"""Rates of the observer\'s states."""  # Huang (2003), eq. (3)',
            [
                *unpacking,
                *_integrals(integrals, [*estimates, *rates]),
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


def _integrals(integrals: dict[sp.Symbol, sp.Integral], texts: Sequence[str]) -> list[str]:
    """Lines for those integrals that occur in the texts."""
    return [
        f"{name} = _integrate(lambda {VARIABLE}: {_show(cast(sp.Expr, i.function))}, "
        f"{_show(upper_limit(i))})"
        for name, i in integrals.items()
        if any(re.search(rf"\b{name}\b", text) for text in texts)
    ]


def _tuple(symbols: Sequence[sp.Symbol]) -> str:
    """The symbols as a Python tuple without parentheses."""
    return ", ".join(map(str, symbols)) + ("," if len(symbols) == 1 else "")
