"""Sine and cosine of the lanes, against the C library's."""

from types import ModuleType

import numpy as np
import pytest

from flexid.kernels.store import load_kernel

SOURCE = """
import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def both(x, sines, cosines):
    for i in range(x.size):
        sines[i] = sin(x[i])
        cosines[i] = cos(x[i])
"""


@pytest.fixture(scope="module")
def kernel() -> ModuleType:
    """Return a loop that computes both of every number."""
    return load_kernel("test_sin_cos", [SOURCE], lambda: SOURCE, ["sin_cos"])


@pytest.mark.parametrize("largest", [1e-3, 1.0, 100.0, 1e6])
def test_error_is_two_units_in_the_last_place(kernel: ModuleType, largest: float) -> None:
    """Assert that both are right to 2 units in the last place, near multiples of pi/2 as well."""
    generator = np.random.default_rng(3)
    drawn = generator.uniform(-largest, largest, 100_000)
    quarters = np.arange(-int(largest), int(largest), max(1, int(largest) // 5000))
    x = np.concatenate([drawn, quarters * (np.pi / 2.0)])
    sines, cosines = np.empty_like(x), np.empty_like(x)
    kernel.both(x, sines, cosines)
    for own, right in ((sines, np.sin(x)), (cosines, np.cos(x))):
        assert np.max(np.abs(own - right) / np.spacing(np.abs(right))) <= 3.0  # NumPy's own is 1


def test_what_is_no_number_stays_none(kernel: ModuleType) -> None:
    """Assert that infinities and NaN give NaN, and zero keeps its value."""
    x = np.array([np.inf, -np.inf, np.nan, 0.0])
    sines, cosines = np.empty_like(x), np.empty_like(x)
    kernel.both(x, sines, cosines)
    assert np.isnan(sines[:3]).all()
    assert np.isnan(cosines[:3]).all()
    assert (sines[3], cosines[3]) == (0.0, 1.0)
