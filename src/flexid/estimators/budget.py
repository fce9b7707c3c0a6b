"""Budget of a search: number of samples over which it may run a model, in all threads.

The work is counted and not timed, so a search ends at the same place on every machine.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from flexid.errors import FlexidError


@dataclass(eq=False, repr=False)
class BudgetError(FlexidError):
    """A search has spent its budget."""

    samples: float  # integration steps of a sample that the search was given
    _text = "the search ran the model over more than {samples:.3g} samples: identify a part of it"


@dataclass
class Budget:
    """Work that a search may still do, in integration steps of a sample."""

    given: float
    left: float

    def spend(self, samples: float) -> None:
        """Count work, and raise `BudgetError` if no more is left."""
        self.left -= samples
        if self.left < 0.0:
            raise BudgetError(self.given)


_UNLIMITED = Budget(float("inf"), float("inf"))
_budget: ContextVar[Budget] = ContextVar("budget", default=_UNLIMITED)


def spend(samples: float) -> None:
    """Count work within the current budget."""
    _budget.get().spend(samples)


@contextmanager
def within(samples: float) -> Iterator[None]:
    """Limit the work of the enclosed statements."""
    with _in_force(Budget(samples, samples)):
        yield


@contextmanager
def _in_force(budget: Budget) -> Iterator[None]:
    token = _budget.set(budget)
    try:
        yield
    finally:
        _budget.reset(token)


class Shares:
    """Copies of the current budget for concurrent tasks.

    Each task may spend the whole rest of the budget, so the result does not depend on their order.
    """

    def __init__(self, number: int) -> None:
        self._whole = _budget.get()
        self._parts = [Budget(self._whole.given, self._whole.left) for _ in range(number)]

    def of(self, place: int) -> AbstractContextManager[None]:
        """Return a context in which a task spends its copy."""
        return _in_force(self._parts[place])

    def settle(self) -> None:
        """Count what all tasks together have spent."""
        before = self._whole.left
        self._whole.spend(sum(before - part.left for part in self._parts))
