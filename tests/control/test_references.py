"""References and their derivatives."""

import numpy as np
import pytest
import sympy as sp

from flexid.control.references import Multisine, constant, sinusoid
from flexid.derivation.symbolic import symbol, to_sympy
from flexid.errors import ModelError

TIMES = np.linspace(0.0, 2.0, 41)
TWO_TONES = Multisine([3.0, 0.5], [5.0, 13.2], [0.3, -1.1], 0.7)


@pytest.mark.parametrize("reference", [sinusoid(3.0, 5.0), TWO_TONES, constant(1.2)])
@pytest.mark.parametrize("order", range(6))
def test_evaluation_is_derivative_of_text(reference: Multisine, order: int) -> None:
    """Assert that NumPy's value of every derivative is that of the text, differentiated."""
    text = to_sympy(reference.expression, {"t", *reference.parameters})
    values = [(symbol(name), value) for name, value in reference.parameters.items()]
    derivative = sp.diff(text, symbol("t"), order).subs(values)
    expected = sp.lambdify(symbol("t"), derivative)(TIMES)
    scale = 1.0 + np.max(np.abs(expected))
    assert np.max(np.abs(reference.evaluate(TIMES, order) - expected)) < 1e-13 * scale


def test_uneven_lists_are_refused() -> None:
    """Assert that lists of different length are an error that counts them."""
    with pytest.raises(ModelError, match="2 amplitudes, 1 angular"):
        Multisine([1.0, 2.0], [3.0])
