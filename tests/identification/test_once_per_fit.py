"""What is kept of a fit, and for how long."""

import gc
import weakref

from flexid.identification.full_model.model import once_per_fit


class _Fit:
    """Stands for a fit."""


def test_what_follows_from_a_fit_is_computed_once_and_goes_with_it():
    """Assert that each fit has its own for each argument, until nothing else holds the fit."""
    calls = []

    @once_per_fit
    def power(fitted, exponent):
        calls.append((fitted.name, exponent))
        return _Fit()

    first, second = _Fit(), _Fit()
    first.name, second.name = "first", "second"  # type: ignore[attr-defined]
    for fit, exponent in ((first, 1), (first, 2), (first, 1), (second, 1), (first, 2)):
        assert power(fit, exponent) is power(fit, exponent)  # type: ignore[arg-type]
    assert calls == [("first", 1), ("first", 2), ("second", 1)]
    found, gone = weakref.ref(power(first, 1)), weakref.ref(first)  # type: ignore[arg-type]
    del first, fit
    gc.collect()
    assert gone() is found() is None
