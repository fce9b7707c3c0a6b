"""Signals of a closed loop that depend on time alone: the reference and what is made of it."""

from collections.abc import Collection, Mapping

import sympy as sp

from flexid.control.controller import REFERENCE_NAMES
from flexid.control.references import Reference
from flexid.derivation.source import assignments
from flexid.derivation.symbolic import symbol, to_sympy


def insert(values: Mapping[sp.Symbol, sp.Expr], expression: sp.Expr) -> sp.Expr:
    """Replace symbols by values, all at once; sums and products cancel what they can."""
    result = expression.xreplace(dict(values))
    assert isinstance(result, sp.Expr)
    return result


class Signals:
    """The reference, its derivatives, and named functions of them, each kept as one symbol.

    As symbols they cancel against each other before anything large is computed; for that, the
    derivative of one signal is recognised where it is another (w2N = w1N' in the paper).
    """

    def __init__(self, reference: Reference) -> None:
        names = {"t", *reference.parameters}
        self._reference = to_sympy(reference.expression, names, "reference")
        self._values: dict[sp.Symbol, sp.Expr] = {}
        self._rates: dict[sp.Symbol, sp.Expr] = {}

    @staticmethod
    def reference(order: int) -> sp.Symbol:
        """The symbol of a derivative of the reference."""
        # Orders beyond those a controller may name still occur in the time derivatives.
        return symbol(REFERENCE_NAMES[order] if order < len(REFERENCE_NAMES) else f"_qd_{order}")

    def add(self, name: sp.Symbol, value: sp.Expr) -> None:
        """Name a function of the reference, its derivatives, parameters and earlier signals."""
        self._values[name] = insert(self._values, value)

    def derivative(self, expression: sp.Expr) -> sp.Expr:
        """Time derivative; what is no signal is constant."""
        return sp.Add(*(sp.diff(expression, s) * self._rate(s) for s in self._in(expression)))

    def assignments(self, used: Collection[sp.Basic]) -> tuple[str, set[sp.Basic]]:
        """Lines that compute those signals that occur among the given symbols."""
        values = {s: v for s, v in self._values.items() if s in used}
        needed = set(used).union(*(v.free_symbols for v in values.values()))
        orders = [order for order in range(20) if self.reference(order) in needed]
        time = symbol("t")
        references = [sp.diff(self._reference, time, order) for order in orders]
        needed |= set().union(*(r.free_symbols for r in references))
        blocks = [
            assignments([str(self.reference(order)) for order in orders], references),
            assignments([str(s) for s in values], list(values.values())),
        ]
        return "\n".join(
            b for b, some in zip(blocks, (orders, values), strict=True) if some
        ), needed

    def _in(self, expression: sp.Expr) -> list[sp.Symbol]:
        found = (s for s in expression.free_symbols if isinstance(s, sp.Symbol))
        return sorted((s for s in found if s in self._values or self._order(s) >= 0), key=str)

    def _order(self, name: sp.Basic) -> int:
        orders = (order for order in range(20) if name == self.reference(order))
        return next(orders, -1)

    def _rate(self, signal: sp.Symbol) -> sp.Expr:
        if signal not in self._values:
            return self.reference(self._order(signal) + 1)
        if signal not in self._rates:
            value = self.derivative(self._values[signal])
            self._rates[signal] = self._named(value, symbol(f"_d_{signal}"))
        return self._rates[signal]

    def _named(self, value: sp.Expr, name: sp.Symbol) -> sp.Expr:
        """The signal that has this value, a new one if there is none."""
        if sp.expand(value) == 0:
            return sp.S.Zero
        for signal, known in self._values.items():
            if sp.expand(known - value) == 0:
                return signal
        self.add(name, value)
        return name
