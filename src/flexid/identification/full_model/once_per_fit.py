"""What follows from a fit and is asked for again and again: computed once, kept while it lives."""

from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

from flexid.identification.full_model.model import Fitted

Rest = ParamSpec("Rest")
Result = TypeVar("Result")


def once_per_fit(
    function: Callable[Concatenate[Fitted, Rest], Result],
) -> Callable[Concatenate[Fitted, Rest], Result]:
    """Keep what a function makes of a fit, and of hashable arguments beside it, with the fit.

    A fit holds the data of its log: what keeps it alive keeps them in memory.
    """
    kept: WeakKeyDictionary[Fitted, dict[object, Result]] = WeakKeyDictionary()

    @wraps(function)
    def wrapper(fitted: Fitted, *args: Rest.args, **kwargs: Rest.kwargs) -> Result:
        own = kept.setdefault(fitted, {})
        key = (args, *sorted(kwargs.items()))
        if key not in own:
            own[key] = function(fitted, *args, **kwargs)
        return own[key]

    return wrapper
