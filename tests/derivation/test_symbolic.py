"""Text expressions as SymPy objects."""

import pytest

from flexid.derivation.symbolic import to_sympy
from flexid.errors import ExpressionError


@pytest.mark.parametrize(
    "text", ["1/0", "q/0", "0/0*q", "q**(1/0)", "sqrt(-1)*q", "(-8)**(1/3)", "tan(pi/2) + q"]
)
def test_no_finite_real_value(text: str):
    """Assert that what is nowhere a finite real number is refused with the place."""
    with pytest.raises(ExpressionError, match=r"here: .*no finite real value"):
        to_sympy(text, {"q"}, "here")


@pytest.mark.parametrize("text", ["1/q", "sqrt(q)", "q**(1/3)", "exp(1)*q"])
def test_finite_somewhere(text: str):
    """Assert that an expression that is real and finite for some values is kept."""
    assert to_sympy(text, {"q"}).free_symbols
