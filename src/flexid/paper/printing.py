"""Print the observer's equations, grouped as in the paper, in LaTeX, Python and C99."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import sympy as sp
from sympy.core.alphabets import greeks
from sympy.printing.c import C99CodePrinter
from sympy.printing.latex import LatexPrinter
from sympy.printing.pycode import PythonCodePrinter

from flexid.derivation.drive_source import RESERVED, names_in_c
from flexid.derivation.symbolic import FreshNames, symbol
from flexid.paper.observer import VARIABLE, SymbolicObserver, graded_rule

# Printed eqs. (2) and (3) of Huang (2003) for one row: each p̂, the sum s, and y' by y.
_Row = tuple[dict[str, str], tuple[str, str], dict[sp.Symbol, str]]


def fresh_names(observer: SymbolicObserver) -> FreshNames:
    """Return a source of names that neither the model nor its observer uses."""
    system = observer.symbolic.system
    used = [*system.variables, *system.coefficients, *map(str, observer.rates)]
    for row in observer.rows:
        used += [str(s) for s in (row.gain, *row.intermediate, *row.estimates)]
    return FreshNames(used)


def argument_groups(observer: SymbolicObserver) -> tuple[tuple[sp.Symbol, ...], ...]:
    """Return the arguments: states, inputs, their rates, observer states, gains, constants."""
    return (
        observer.symbolic.states,
        observer.symbolic.inputs,
        observer.rates if observer.input_rates else (),
        tuple(y for row in observer.rows for y in row.intermediate),
        observer.gains,
        observer.symbolic.constants,
    )


def _rows(
    observer: SymbolicObserver,
    names: FreshNames,  # from which the abbreviations are taken
    show: Callable[[sp.Expr], str],
    bracket: str,  # format of a gain times a sum
) -> Iterator[_Row]:
    letters = ["s", "r", *(f"s{number}" for number in range(3, len(observer.rows) + 1))]
    for row, letter in zip(observer.rows, letters, strict=False):
        s = names.take(letter)
        terms = [_tidy(p * r) for p, r in zip(row.estimates, row.row.regressor, strict=True)]
        negative = row.row.known == 0 and all(t.could_extract_minus_sign() for t in terms)
        side = -1 if negative else 1
        estimates = zip(row.estimates, row.intermediate, row.immersion, strict=True)
        rates = {}
        for y, r, C in zip(row.intermediate, row.row.regressor, row.cancelling, strict=True):
            product = _tidy(side * r * s)
            inside = joined(show(product), show(_tidy(C)))
            of_sum = bracket.format(show(row.gain), inside)
            rates[y] = of_sum if C != 0 else show(-row.gain * product)
        meaning = sp.Add(*(side * t for t in terms), row.row.known)
        printed = {show(p): joined(show(y), show(_tidy(row.gain * b))) for p, y, b in estimates}
        yield printed, (show(s), show(meaning)), rates


def _tidy(expression: sp.Expr) -> sp.Expr:
    """Pull minus signs out of sums: ``x2*(x3 - x1)`` becomes ``-x2*(x1 - x3)``."""
    if isinstance(expression, sp.Add):
        return sp.Add(*(_tidy(term) for term in expression.args))
    if not isinstance(expression, sp.Mul):
        return expression
    factors = [
        (-f, -1) if isinstance(f, sp.Add) and f.could_extract_minus_sign() else (f, 1)
        for f in expression.args
    ]
    return sp.prod([side for _, side in factors]) * sp.Mul(*(f for f, _ in factors))


def joined(first: str, second: str) -> str:
    """Join two printed terms to a sum."""
    if second == "0":
        return first
    if second.startswith("-"):
        return f"{first} - {second[1:].lstrip()}"
    return f"{first} + {second}"


def latex_observer(observer: SymbolicObserver) -> str:
    """Print an observer as one ``align*`` block, Huang (2003), eqs. (2)-(3)."""
    printer, lines = LatexPrinter({"symbol_names": _symbol_names(observer)}), []
    names = fresh_names(observer)
    for row in _rows(observer, names, printer.doprint, r"-{} \left[ {} \right]"):
        estimates, abbreviation, rates = row
        of_states = [(latex_name(str(y), r"\dot"), text) for y, text in rates.items()]
        sides = [*estimates.items(), abbreviation, *of_states]
        lines += [f"  {left} &= {right}" for left, right in sides]
    body = " \\\\\n".join(lines)
    return f"\\begin{{align*}}\n{body}\n\\end{{align*}}\n"


def _symbol_names(observer: SymbolicObserver) -> dict[sp.Symbol, str]:
    symbolic = observer.symbolic
    plain = [*symbolic.states, *symbolic.inputs, *symbolic.constants, *symbolic.coefficients]
    names = {s: latex_name(str(s)) for s in (*plain, *observer.gains)}
    for row in observer.rows:
        names |= {y: latex_name(str(y)) for y in row.intermediate}
        for estimate, p in zip(row.estimates, row.row.coefficients, strict=True):
            names[estimate] = latex_name(str(p), r"\hat")
    for rate, u in zip(observer.rates, symbolic.inputs, strict=True):
        names[rate] = latex_name(str(u), r"\dot")
    return names | {VARIABLE: r"\xi"}


def latex_name(name: str, accent: str = "") -> str:
    r"""Print a declared name: ``theta1`` as θ₁, ``link_offset`` upright with a subscript."""
    match = re.fullmatch(r"([A-Za-z]+)(\d*)(?:_(\w+?))?(_*)", name, re.ASCII)
    if match is None:
        escaped = name.replace("_", r"\_")
        return f"{accent}{{\\mathrm{{{escaped}}}}}" if accent else f"\\mathrm{{{escaped}}}"
    head, number, subscript, primes = match.groups()
    if head in greeks and head != "omicron":
        letter = "\\" + head
    else:
        letter = head if len(head) == 1 else f"\\mathrm{{{head}}}"
    if accent:
        accent = r"\widehat" if accent == r"\hat" and letter.startswith(r"\mathrm") else accent
        letter = f"{accent}{{{letter}}}"
    words = rf"\mathrm{{{subscript.replace('_', ' ')}}}" if subscript else ""
    below = ",".join(part for part in (number, words) if part)
    return letter + (f"_{{{below}}}" if below else "") + "'" * len(primes)


@dataclass(frozen=True)
class _Equations:
    """Printed eqs. (2) and (3) of Huang (2003) for all rows."""

    integrals: dict[str, tuple[str, str]]  # by name: upper limit and integrand
    estimates: dict[str, str]  # eq. (2)
    abbreviations: dict[str, str]
    rates: list[str]  # eq. (3)

    def needed(self, lines: Iterable[str]) -> tuple[dict[str, tuple[str, str]], set[str]]:
        """Return the integrals that some lines use, and all names in both."""
        names = _names(lines)
        found = {name: parts for name, parts in self.integrals.items() if name in names}
        return found, names.union(*map(_names, found.values()))


def _names(texts: Iterable[str]) -> set[str]:
    return set(re.findall(r"[^\W\d]\w*", " ".join(texts)))


def _equations(
    observer: SymbolicObserver, names: FreshNames, show: Callable[[sp.Basic], str]
) -> _Equations:
    shown = [e for row in observer.rows for e in (*row.immersion, *row.cancelling)]
    integrals = sorted({i for e in shown for i in e.atoms(sp.Integral)}, key=sp.default_sort_key)
    symbols = {i: sp.Symbol(f"_q{n}", real=True) for n, i in enumerate(integrals)}
    rows = _rows(observer, names, lambda e: show(e.xreplace(symbols)), "-{}*({})")
    estimates, abbreviations, rates = zip(*rows, strict=True)
    return _Equations(
        {show(symbols[i]): (show(i.limits[0].args[2]), show(i.function)) for i in integrals},
        {p: text for of_row in estimates for p, text in of_row.items()},
        dict(abbreviations),
        [rate for of_row in rates for rate in of_row.values()],
    )


class _PythonPrinter(PythonCodePrinter):
    """Printer that records the names used from `math` in ``module_imports``."""

    def _print_Exp1(self, expr: sp.NumberSymbol) -> str:  # noqa: ARG002, N802 - SymPy's
        return f"{self._module_format('math.exp')}(1)"  # a model may have its own e

    def _print_sign(self, e: sp.Function) -> str:
        argument = self._print(e.args[0])
        copysign = self._module_format("math.copysign")
        return f"(0.0 if {argument} == 0 else {copysign}(1.0, {argument}))"


_PYTHON_RULE = '''def _integrate(function, upper):
    """Integral from 0 to upper: {count} nodes of Gauss and Legendre, dense towards 0."""
    return upper * sum(w * function(upper * t) for t, w in zip(_NODES, _WEIGHTS))


_NODES = {nodes!r}
_WEIGHTS = {weights!r}


'''

_ARGUMENTS = ("states", "inputs", "input_rates", "observer_states", "gains", "constants")


def python_observer(observer: SymbolicObserver) -> str:
    """Print an observer as a Python module of two functions, ``estimates`` and ``rates``."""
    printer, names = _PythonPrinter({"fully_qualified_modules": False}), fresh_names(observer)
    found = _equations(observer, names, lambda expression: str(printer.doprint(expression)))
    groups = zip(_ARGUMENTS, argument_groups(observer), strict=True)
    arguments = {str(names.take(name)): group for name, group in groups if group}
    unpacking = [f"{_tuple(group)} = {name}" for name, group in arguments.items()]
    of_eq_2 = [f"{p} = {text}" for p, text in found.estimates.items()]
    of_eq_3 = [f"{s} = {text}" for s, text in found.abbreviations.items()]
    of_eq_3 += ["return (", *(f"    {rate}," for rate in found.rates), ")"]

    def function(name: str, docstring: str, *body: str) -> str:
        sums = [
            f"{q} = _integrate(lambda {VARIABLE}: {integrand}, {upper})"
            for q, (upper, integrand) in found.needed(body)[0].items()
        ]
        lines = "".join(f"    {line}\n" for line in (docstring, *unpacking, *sums, *body))
        return f"def {name}({', '.join(arguments)}):\n{lines}"

    functions = (
        function(
            "estimates",
            '"""Estimates of the coefficients."""  # Huang (2003), eq. (2)',
            *of_eq_2,
            f"return {_tuple([p for row in observer.rows for p in row.estimates])}",
        ),
        function(
            "rates",
            '"""Rates of the observer\'s states."""  # Huang (2003), eq. (3)',
            *of_eq_2,
            *of_eq_3,
        ),
    )
    helpers = ""
    if observer.quadratures:
        nodes, weights = (tuple(values.tolist()) for values in graded_rule())
        helpers = _PYTHON_RULE.format(count=len(nodes), nodes=nodes, weights=weights)
    used = {name.removeprefix("math.") for name in printer.module_imports.get("math", ())}
    imports = f"from math import {', '.join(sorted(used))}\n\n\n" if used else "\n"
    title = f"Parametric observer, Huang (2003), of the model {observer.symbolic.system.name}."
    return f'"""{title}"""\n\n{imports}{helpers}' + "\n\n".join(functions)


def _tuple(symbols: Sequence[sp.Symbol]) -> str:
    """Print the symbols as a Python tuple without parentheses."""
    return ", ".join(map(str, symbols)) + ("," if len(symbols) == 1 else "")


class _CPrinter(C99CodePrinter):
    """Printer of small powers as products, and of constants as numbers, not as macros."""

    def _print_NumberSymbol(self, expr: sp.NumberSymbol) -> str:  # noqa: N802 - SymPy's
        return repr(float(expr))

    def _print_Pow(self, expr: sp.Pow) -> str:  # noqa: N802 - SymPy's
        base, exponent = expr.args
        if isinstance(exponent, sp.Integer) and 2 <= int(exponent) <= 4:
            factor = self._print(base)
            factor = factor if base.is_Symbol else f"({factor})"
            return "(" + "*".join([factor] * int(exponent)) + ")"
        return super()._print_Pow(expr)


def c_observer(observer: SymbolicObserver) -> str:
    """Print an observer as two C99 functions that allocate no memory."""
    printer, names = _CPrinter({"math_macros": {}}), fresh_names(observer)
    symbols = [s for group in argument_groups(observer) for s in group]
    own = [str(s) for s in (*symbols, *(p for row in observer.rows for p in row.estimates))]
    renamed = {
        symbol(name): symbol(other)
        for name, other in names_in_c(own, FreshNames([*own, *RESERVED]), RESERVED).items()
    }

    def show(expression: sp.Basic) -> str:
        return str(printer.doprint(cast(sp.Expr, expression.xreplace(renamed))))

    found = _equations(observer, names, show)
    arrays = [name.removesuffix("s") for name in _ARGUMENTS]
    groups = dict(zip(arrays, argument_groups(observer), strict=True))
    reads = {show(s): f"{array}[{i}]" for array, g in groups.items() for i, s in enumerate(g)}
    steps = {**found.estimates, **found.abbreviations}

    def function(name: str, result: str, body: Sequence[str]) -> str:
        integrals, used = found.needed(body)
        unused = [array for array, group in groups.items() if used.isdisjoint(map(show, group))]
        arguments = [*(f"const double *{array}" for array in arrays), f"double *{result}"]
        lines = [f"(void){array};" for array in unused]
        lines += [f"const double {s} = {place};" for s, place in reads.items() if s in used]
        for q, (upper, integrand) in integrals.items():
            lines += [
                f"double {q} = 0.0;",
                f"for (int n_ = 0; n_ < {len(graded_rule()[0])}; ++n_) {{",
                f"    const double {VARIABLE} = {upper}*NODES[n_];",
                f"    {q} += {upper}*WEIGHTS[n_]*({integrand});",
                "}",
            ]
        takes, text = ",\n    ".join(arguments), "\n    ".join([*lines, *body])
        return f"\nvoid {name}(\n    {takes})\n{{\n    {text}\n}}\n"

    first = [f"estimate[{i}] = {text};" for i, text in enumerate(found.estimates.values())]
    second = [f"const double {name} = {text};" for name, text in steps.items()]
    second += [f"rate[{i}] = {text};" for i, text in enumerate(found.rates)]
    functions = function("observer_estimates", "estimate", first)
    functions += function("observer_rates", "rate", second)
    title = f"Parametric observer, Huang (2003), of the model {observer.symbolic.system.name}."
    listed = {**groups, "estimate": observer.symbolic.coefficients}
    contents = [f"{name:15} {', '.join(map(str, g)) or 'none'}" for name, g in listed.items()]
    head = "\n * ".join([f"/* {title}", *contents]) + "\n */\n#include <math.h>\n"
    tables = "".join(
        f"\nstatic const double {name}[{len(values)}] = {{\n    "
        + ",\n    ".join(map(repr, values.tolist()))
        + "\n};\n"
        for name, values in zip(("NODES", "WEIGHTS"), graded_rule(), strict=True)
        if observer.quadratures
    )
    return head + tables + functions
