"""Budget of a search: number of integration steps that it may take, in all threads.

The work is counted and not timed, so a search ends at the same place on every machine.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from math import inf

from flexid.errors import FlexidError


@dataclass(eq=False, repr=False)
class BudgetError(FlexidError):
    """A search has spent its budget."""

    steps: float  # integration steps that the search was given
    _text = "the search took more than {steps:.3g} integration steps: identify a part of the log"


@dataclass
class Budget:
    """Work of a search and its limit, in integration steps."""

    limit: float = inf
    spent: float = 0.0

    def spend(self, steps: float) -> None:
        """Count work, and raise `BudgetError` if it is more than the limit."""
        self.spent += steps
        if self.spent > self.limit:
            raise BudgetError(self.limit)


_UNLIMITED = Budget()
_budget: ContextVar[Budget] = ContextVar("budget", default=_UNLIMITED)


def spend(steps: float) -> None:
    """Count work within the current budget."""
    _budget.get().spend(steps)


@contextmanager
def within(steps: float) -> Iterator[None]:
    """Limit the work of the enclosed statements."""
    with _in_force(Budget(steps)):
        yield


@contextmanager
def renewed() -> Iterator[None]:
    """Give the enclosed statements the whole current budget once more."""
    with _in_force(replace(_budget.get(), spent=0.0)):
        yield


@contextmanager
def _in_force(budget: Budget) -> Iterator[None]:
    token = _budget.set(budget)
    try:
        yield
    finally:
        _budget.reset(token)


@contextmanager
def shared(number: int) -> Iterator[Callable[[int], AbstractContextManager[None]]]:
    """Share the current budget among concurrent tasks: yield the context of a task by its index.

    Each task may spend the whole rest of the budget, so the result does not depend on their order.
    """
    whole = _budget.get()
    parts, before = [replace(whole) for _ in range(number)], whole.spent
    yield lambda place: _in_force(parts[place])
    whole.spend(sum(part.spent - before for part in parts))
