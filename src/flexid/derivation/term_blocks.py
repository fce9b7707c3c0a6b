"""Blocks of terms, which generated source computes only if one of them acts."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import sympy as sp

from flexid.derivation.source import assignments, function
from flexid.derivation.symbolic import SymbolicSystem

# A model has many terms, and a log needs few. Functions, like a sine, would take time even if their
# coefficients are zero. So terms that share a function, or a coefficient within one, form a block.
# A block acts if one of its coefficients is not zero; its derivatives are also computed if one is
# sought. All other terms are always computed; so are terms with one cheap function, which costs no
# more than a branch.
_CHEAP = (sp.sin, sp.cos, sp.Abs, sp.sign)  # functions compiled without a call

Entries = dict[str, sp.Expr]
"""Expressions by the entry of an array to which each is assigned."""

SOUGHT, ACTING = 1.0, 2.0  # marks of a block: with a coefficient that is sought, or is not zero


@dataclass(frozen=True, eq=False)
class Block:
    """Terms that are computed together, or not at all."""

    coefficients: tuple[int, ...]  # indices of the terms' coefficients, then of those in functions
    system: SymbolicSystem  # with these terms alone


@dataclass(frozen=True, eq=False)
class Blocks:
    """Terms of a system, divided."""

    whole: SymbolicSystem
    always: SymbolicSystem  # with the terms that are always computed
    optional: Sequence[Block]

    def acting(self) -> str:
        """Return the source of ``acting``, which marks the blocks."""
        lines = []
        for k, block in enumerate(self.optional):
            used = [f"_p[{i}] != 0.0" for i in block.coefficients if i < len(self.whole.linear)]
            sought = " or ".join(f"_at[{i}] > 0" for i in block.coefficients)
            lines.append(f"    _on[{k}] = {SOUGHT} if {sought} else 0.0")
            lines.append(f"    if {' or '.join(used)}:\n        _on[{k}] = {ACTING}")
        return function(
            "acting(_p, _at, _on)",
            "_on of each block of terms: 2 if a coefficient is not zero, else 1 if one is sought.",
            "\n".join(lines) or "    pass",
            decorator="inlined",
        )

    def lines(
        self, mark: float, entries: Callable[[SymbolicSystem], tuple[Entries, Entries]]
    ) -> str:
        """Return lines that compute entries of all terms, of blocks with a mark or a higher one.

        `entries` returns those to which several terms add, and those of one coefficient each.
        """
        sums, own = entries(self.always)
        every, _ = entries(self.whole)
        sums = {target: sums.get(target, sp.S.Zero) for target in every}
        found = [assignments([*sums, *own], [*sums.values(), *own.values()])]
        for k, block in enumerate(self.optional):
            sums, own = entries(block.system)
            sums = {target: sp.Symbol(target) + value for target, value in sums.items() if value}
            found.append(f"    if _on[{k}] >= {mark}:")
            found.append(assignments([*sums, *own], [*sums.values(), *own.values()], 8 * " "))
        return "\n".join(found)


def divided(symbolic: SymbolicSystem) -> Blocks:
    """Divide the terms of a system into blocks."""
    linear, places = {*symbolic.linear}, {p: i for i, p in enumerate(symbolic.coefficients)}
    groups: list[set[sp.Basic]] = []  # of functions and coefficients
    for row in symbolic.rows:
        for coefficient, regressor in zip(row.coefficients, row.regressor, strict=True):
            shared = regressor.atoms(sp.Function) | (regressor.free_symbols & {*places})
            near = [group for group in groups if group & shared]
            groups = [group for group in groups if group not in near]
            groups.append({coefficient}.union(shared, *near))
    others = [row.known for row in symbolic.rows] + [memory.rate for memory in symbolic.memories]
    elsewhere = {name for other in others for name in other.free_symbols}
    groups = [group for group in groups if _is_costly(group) and not group & elsewhere]
    of_rows = tuple(replace(row, known=sp.S.Zero) for row in symbolic.rows)
    alone = replace(symbolic, rows=of_rows, memories=())
    blocks = []
    for group in groups:
        own = tuple(place for coefficient, place in places.items() if coefficient in group)
        blocks.append(Block(own, _with_terms(alone, group)))
    return Blocks(symbolic, _with_terms(symbolic, linear.difference(*groups)), blocks)


def _is_costly(group: Collection[sp.Basic]) -> bool:
    calls = [f for f in group if isinstance(f, sp.Function)]
    return len(calls) > 1 or not all(isinstance(call, _CHEAP) for call in calls)


def _with_terms(symbolic: SymbolicSystem, coefficients: Collection[sp.Basic]) -> SymbolicSystem:
    """Return a system with the terms of some coefficients only."""
    rows = []
    for row in symbolic.rows:
        terms = zip(row.coefficients, row.regressor, strict=True)
        kept = tuple(r if p in coefficients else sp.S.Zero for p, r in terms)
        rows.append(replace(row, regressor=kept))
    return replace(symbolic, rows=tuple(rows))
