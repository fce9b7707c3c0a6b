"""What is kept of a fit, and for how long."""

import gc
import weakref
from typing import cast

from flexid.identification.full_model.model import Fitted, once_per_fit


class _Fit:
    """Stands for a fit."""


def test_what_follows_from_a_fit_is_computed_once():
    """Assert that each fit has its own, for each argument, and that none is computed again."""
    calls = []

    @once_per_fit
    def power(fitted: Fitted, exponent: int) -> tuple[int, int]:
        calls.append(exponent)
        return len(calls), exponent

    first, second = cast(Fitted, _Fit()), cast(Fitted, _Fit())
    assert [power(first, 1), power(first, 2), power(first, 1)] == [(1, 1), (2, 2), (1, 1)]
    assert power(second, 1) == (3, 1)
    assert calls == [1, 2, 1]


def test_a_fit_is_not_kept_alive():
    """Assert that a fit and what followed from it go when nothing else holds them."""

    @once_per_fit
    def data(_: Fitted) -> _Fit:
        return _Fit()

    fit = _Fit()
    found = weakref.ref(data(cast(Fitted, fit)))
    assert found() is not None
    fit = weakref.ref(fit)
    gc.collect()
    assert fit() is None
    assert found() is None
