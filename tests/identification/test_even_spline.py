"""Splines through samples at even times."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from flexid.identification.even_spline import EvenSpline


@pytest.mark.parametrize("count", [4, 5, 50])
@pytest.mark.parametrize("shift", [-0.7, 0.0, 0.3, 1.0])
@pytest.mark.parametrize("derivative", [0, 1])
def test_it_is_scipys_spline(count, shift, derivative):
    """Assert that values and slopes are those of the cubic spline without knots next to an end."""
    values = np.random.default_rng(count).standard_normal(count)
    places = np.arange(1, count - 2)
    expected = CubicSpline(np.arange(count), values)(places + shift, derivative)
    assert EvenSpline(values).at(places, shift, derivative) == pytest.approx(expected, abs=1e-13)
