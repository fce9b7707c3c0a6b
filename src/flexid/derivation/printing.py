"""The observer's equations grouped as in the paper, for all printers, and printed in LaTeX.

Each row has one abbreviation for the predicted acceleration, as s and r in Huang (2003), eq. (6);
where every term of it is negative, the abbreviation is its opposite, as s is there.
"""

import re
from dataclasses import dataclass

import sympy as sp
from sympy.core.alphabets import greeks
from sympy.printing.latex import LatexPrinter

from flexid.derivation.immersion import VARIABLE
from flexid.derivation.observer import ObserverRow, SymbolicObserver
from flexid.derivation.symbolic import FreshNames


@dataclass(frozen=True)
class PrintableRow:
    """The equations of one row."""

    gain: sp.Symbol  # c
    estimates: tuple[tuple[sp.Symbol, sp.Symbol, sp.Expr], ...]  # p̂, y and c b of ``p̂ = y + c b``
    abbreviation: sp.Symbol  # s
    meaning: sp.Expr  # what s stands for
    # y, the product of regressor and prediction, and C, of ``y' = -c [product + C]``
    updates: tuple[tuple[sp.Symbol, sp.Expr, sp.Expr], ...]


def fresh_names(observer: SymbolicObserver) -> FreshNames:
    """Names that neither the model nor its observer uses."""
    system = observer.symbolic.system
    used = [*system.variables, *system.coefficients, *map(str, observer.rates)]
    for row in observer.rows:
        used += [str(s) for s in (row.gain, *row.intermediate, *row.estimates)]
    return FreshNames(used)


def argument_groups(observer: SymbolicObserver) -> tuple[tuple[sp.Symbol, ...], ...]:
    """What a printed function takes: states, inputs, their rates, own states, gains, constants."""
    return (
        observer.symbolic.states,
        observer.symbolic.inputs,
        observer.rates if observer.input_rates else (),
        tuple(y for row in observer.rows for y in row.intermediate),
        observer.gains,
        observer.symbolic.constants,
    )


def printable_rows(observer: SymbolicObserver, names: FreshNames) -> tuple[PrintableRow, ...]:
    """Group the equations of every row, taking the abbreviations from the free names."""
    letters = ["s", "r", *(f"s{number}" for number in range(3, len(observer.rows) + 1))]
    return tuple(
        _printable(row, names.take(letter))
        for row, letter in zip(observer.rows, letters, strict=False)
    )


def _printable(row: ObserverRow, abbreviation: sp.Symbol) -> PrintableRow:
    terms = [_tidy(p * r) for p, r in zip(row.estimates, row.row.regressor, strict=True)]
    negative = row.row.known == 0 and all(t.could_extract_minus_sign() for t in terms)
    side = -1 if negative else 1
    estimates = zip(row.estimates, row.intermediate, row.immersion, strict=True)
    updates = zip(row.intermediate, row.row.regressor, row.cancelling, strict=True)
    return PrintableRow(
        row.gain,
        tuple((p, y, _tidy(row.gain * b)) for p, y, b in estimates),
        abbreviation,
        sp.Add(*(side * t for t in terms), row.row.known),
        tuple((y, _tidy(side * r * abbreviation), _tidy(C)) for y, r, C in updates),
    )


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
    """Two printed terms as a sum."""
    if second == "0":
        return first
    if second.startswith("-"):
        return f"{first} - {second[1:].lstrip()}"
    return f"{first} + {second}"


def latex_observer(observer: SymbolicObserver) -> str:
    """Print an observer as one ``align*`` block, Huang (2003), eqs. (2)-(3)."""
    rows = printable_rows(observer, fresh_names(observer))
    printer = LatexPrinter({"symbol_names": _symbol_names(observer)})
    lines = [line for row in rows for line in _row_lines(row, printer)]
    body = " \\\\\n".join(f"  {line}" for line in lines)
    return f"\\begin{{align*}}\n{body}\n\\end{{align*}}\n"


def _row_lines(row: PrintableRow, printer: LatexPrinter) -> list[str]:
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
