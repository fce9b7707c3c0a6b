"""What the three printers have in common: the observer's equations grouped as in the paper.

Each row has one abbreviation for the predicted acceleration, as s and r in Huang (2003), eq. (6);
where every term of it is negative, the abbreviation is its opposite, as s is there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import sympy as sp

from flexid.derivation.observer import ObserverRow, SymbolicObserver
from flexid.derivation.symbolic import FreshNames


@dataclass(frozen=True)
class PrintableRow:
    """The equations of one row."""

    name: str
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
    terms = [tidy(p * r) for p, r in zip(row.estimates, row.row.regressor, strict=True)]
    negative = row.row.known == 0 and all(t.could_extract_minus_sign() for t in terms)
    side = -1 if negative else 1
    estimates = zip(row.estimates, row.intermediate, row.immersion, strict=True)
    updates = zip(row.intermediate, row.row.regressor, row.cancelling, strict=True)
    return PrintableRow(
        row.row.name,
        row.gain,
        tuple((p, y, tidy(row.gain * b)) for p, y, b in estimates),
        abbreviation,
        sp.Add(*(side * t for t in terms), row.row.known),
        tuple((y, tidy(side * r * abbreviation), tidy(C)) for y, r, C in updates),
    )


def tidy(expression: sp.Expr) -> sp.Expr:
    """Pull minus signs out of sums: ``x2*(x3 - x1)`` becomes ``-x2*(x1 - x3)``."""
    if isinstance(expression, sp.Add):
        return sp.Add(*(tidy(term) for term in expression.args))
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


def without_integrals(
    rows: tuple[PrintableRow, ...],
) -> tuple[dict[sp.Symbol, sp.Integral], tuple[PrintableRow, ...]]:
    """Rows whose integrals are replaced by symbols, and what these stand for."""
    flat = [cb for row in rows for *_, cb in row.estimates]
    flat += [C for row in rows for *_, C in row.updates]
    integrals, _ = split_integrals(flat)
    symbols = {integral: name for name, integral in integrals.items()}
    plain = tuple(
        replace(
            row,
            estimates=tuple((p, y, cb.xreplace(symbols)) for p, y, cb in row.estimates),
            updates=tuple((y, product, C.xreplace(symbols)) for y, product, C in row.updates),
        )
        for row in rows
    )
    return integrals, plain


def symbols_in_eq_2(rows: tuple[PrintableRow, ...]) -> set[sp.Basic]:
    """Symbols on the right-hand sides of eq. (2)."""
    shown = [e for row in rows for _, y, cb in row.estimates for e in (y, cb)]
    return set().union(*(e.free_symbols for e in shown))


def symbols_in_eq_3(rows: tuple[PrintableRow, ...]) -> set[sp.Basic]:
    """Symbols on the right-hand sides of eq. (3), and of eq. (2), which goes before it."""
    shown = [e for row in rows for _, *parts in row.updates for e in parts]
    shown += [e for row in rows for e in (row.gain, row.meaning)]
    return symbols_in_eq_2(rows).union(*(e.free_symbols for e in shown))


def integrals_among(
    symbols: set[sp.Basic], integrals: dict[sp.Symbol, sp.Integral]
) -> tuple[dict[sp.Symbol, sp.Integral], set[sp.Basic]]:
    """The integrals that some of the symbols stand for, and all symbols that are needed then."""
    found = {name: integral for name, integral in integrals.items() if name in symbols}
    return found, symbols.union(*(integral.free_symbols for integral in found.values()))


def split_integrals(
    expressions: Sequence[sp.Expr],
) -> tuple[dict[sp.Symbol, sp.Integral], list[sp.Expr]]:
    """Replace the unevaluated integrals in expressions by symbols ``_q0``, ``_q1``, …."""
    found = sorted({i for e in expressions for i in e.atoms(sp.Integral)}, key=sp.default_sort_key)
    names = {i: sp.Symbol(f"_q{n}", real=True) for n, i in enumerate(found)}
    plain = [cast(sp.Expr, e.xreplace(names)) for e in expressions]
    return {name: i for i, name in names.items()}, plain


def upper_limit(integral: sp.Integral) -> sp.Expr:
    """The velocity up to which an immersion's integral runs."""
    _, _, upper = cast(tuple[sp.Expr, ...], integral.limits[0])
    return upper


def estimate_texts(
    rows: tuple[PrintableRow, ...], show: Callable[[sp.Expr], str]
) -> list[tuple[str, str]]:
    """Names and right-hand sides of eq. (2), for a programming language."""
    return [(show(p), joined(show(y), show(cb))) for row in rows for p, y, cb in row.estimates]


def rate_texts(
    rows: tuple[PrintableRow, ...], show: Callable[[sp.Expr], str]
) -> tuple[list[tuple[str, str]], list[str]]:
    """Names and meanings of the abbreviations, and the right-hand sides of eq. (3)."""
    abbreviations = [(show(row.abbreviation), show(row.meaning)) for row in rows]
    rates = [
        show(-row.gain * product)
        if C == 0
        else f"-{show(row.gain)}*({joined(show(product), show(C))})"
        for row in rows
        for _, product, C in row.updates
    ]
    return abbreviations, rates
