"""Names that a model does not use itself."""

from collections.abc import Collection

import sympy as sp

from flexid.derivation.symbolic import symbol


class FreshNames:
    """Hands out names, each once, with underscores appended until they are free."""

    def __init__(self, taken: Collection[str]) -> None:
        self._taken = set(taken)

    def take(self, name: str) -> sp.Symbol:
        """Real symbol of the wanted name, or of the next free one."""
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return symbol(name)
