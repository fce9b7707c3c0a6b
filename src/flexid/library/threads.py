"""One thread for linear algebra while flexid works, whoever calls it, and as before afterwards."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")

_LOCK = threading.Lock()
_active = 0
_limits: "threadpool_limits | None" = None


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra to one thread.

    Our matrices are small: threads that share them wait for each other longer than they compute.
    The limit holds for the process, so of several calls at once the first sets it and the last one
    takes it back; no call finds what another has set and takes it for the user's.
    """
    _enter()
    try:
        yield
    finally:
        _leave()


def in_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """A function that works with one thread for linear algebra."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_thread():
            return function(*args, **kwargs)

    return limited


def _enter() -> None:
    global _active, _limits
    with _LOCK:
        if not _active:
            import scipy.linalg  # noqa: F401 - a library that comes later would not be limited
            from threadpoolctl import threadpool_limits

            _limits = threadpool_limits(limits=1, user_api="blas")
        _active += 1


def _leave() -> None:
    global _active, _limits
    with _LOCK:
        _active -= 1
        if not _active and _limits is not None:
            _limits.restore_original_limits()
            _limits = None
