"""The observer's equations in LaTeX."""

import re

import sympy as sp
from sympy.core.alphabets import greeks
from sympy.printing.latex import LatexPrinter

from flexid.derivation.immersion import VARIABLE
from flexid.derivation.observer import SymbolicObserver
from flexid.derivation.printing import PrintableRow, fresh_names, joined, printable_rows
from flexid.derivation.symbolic import LogCosh


class _LatexPrinter(LatexPrinter):
    def _print_LogCosh(self, expr: LogCosh) -> str:  # noqa: N802, SymPy's printer protocol
        return rf"\ln\cosh{{\left({self._print(expr.args[0])} \right)}}"


def latex_observer(observer: SymbolicObserver) -> str:
    """Print an observer as one ``align*`` block, Huang (2003), eqs. (2)-(3)."""
    rows = printable_rows(observer, fresh_names(observer))
    printer = _LatexPrinter({"symbol_names": _symbol_names(observer)})
    lines = [line for row in rows for line in _row_lines(row, printer)]
    body = " \\\\\n".join(f"  {line}" for line in lines)
    return f"\\begin{{align*}}\n{body}\n\\end{{align*}}\n"


def _row_lines(row: PrintableRow, printer: _LatexPrinter) -> list[str]:
    show = printer.doprint
    lines = [f"{show(p)} &= {joined(show(y), show(cb))}" for p, y, cb in row.estimates]
    lines.append(f"{show(row.abbreviation)} &= {show(row.meaning)}")
    for y, product, C in row.updates:
        dot = latex_name(str(y), r"\dot")
        if C == 0:
            lines.append(f"{dot} &= {show(-row.gain * product)}")
        else:
            inside = joined(show(product), show(C))
            lines.append(rf"{dot} &= -{show(row.gain)} \left[ {inside} \right]")
    return lines


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
    r"""A declared name in LaTeX: ``theta1`` as θ₁, ``link_offset`` upright with a subscript."""
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
