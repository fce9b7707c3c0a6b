"""The whitelist of expressions: what is accepted, and refusal of the rest."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexid.errors import ExpressionError
from flexid.models.expression import FUNCTIONS, check_expression, evaluate

NAMES = frozenset({"x1", "x2", "u"})
VALUES = {"x1": 0.5, "x2": 3.0, "u": 0.25}


@pytest.mark.parametrize(
    "text",
    [
        "-sin(x1) + 2*x2**2",
        "1.5e-3*u/x1",
        "x1**-2",
        "x2**(1/2)",
        "abs(x1)*Abs(x2)",
        "pi*x1",
        " x1 ",
        "+".join(["x1"] * 1300),
        "(" + "*".join(["x1"] * 1300) + ")**2",
        *(f"{function}(x1)" for function in FUNCTIONS),
    ],
)
def test_accepted(text: str):
    """Assert that formulas of the whitelist are accepted."""
    check_expression(text, NAMES, "here")


NONE = (
    *("__import__('os').system('true')", "x1.__class__", "x1[0]", "(lambda: 1)()", "eval(x1)"),
    *("[x for x in x1]", "x1 if x2 else u", "x1 and x2", "x1 < x2", "f'{x1}'", "'text'", "True"),
    *("None", "...", "1j", "x1 % 2", "x1 // 2", "x1 @ x2", "x1 ^ 2", "~x1", "not x1", "(x1, x2)"),
    *("(x1 := 2)", "x1 = 2", "import os", "x1; x2", "x3", "_x1", "", "x1 +", "# x1", "x1\0"),
    *("sin(x1, x2)", "sin()", "sin(x=x1)", "sin(*x1)", "sin.real(x1)", "sin", "x1\nx2"),
    *("1e999", "9" * 22, "x1**x2", "x1**99", "2**(3**9)", "9**9**9**9", "((9e300**12)**12)**12"),
    *("sin(" * 100 + "x1" + ")" * 100, "-" * 3000 + "x1", "x1" * 5000),
)


@pytest.mark.parametrize("text", NONE)
def test_refused(text: str):
    """Assert that everything else is refused in one line that names the place."""
    with pytest.raises(ExpressionError) as caught:
        check_expression(text, NAMES, "here")
    assert str(caught.value).startswith("here: ")
    assert "\n" not in str(caught.value)


@given(st.text(max_size=60))
def test_any_text_is_accepted_or_refused(text: str):
    """Assert that any text is accepted, or refused by an `ExpressionError` of one line."""
    said = ""
    try:
        check_expression(text, NAMES, "here")
    except ExpressionError as error:
        said = str(error)
    assert len(said.splitlines()) <= 1


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-sin(x1) + 2*x2**2", -math.sin(0.5) + 18.0),
        ("pi*x1/u - sign(-x2)*abs(-4)", math.pi * 0.5 / 0.25 + 4.0),
        ("x2**-2", 1 / 9),
        ("x2 - x1 - u - 2**3/4/2*x1", 1.75),
    ],
)
def test_evaluate(text: str, value: float):
    """Assert the value of an expression."""
    assert evaluate(text, VALUES, "here") == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("text", ["1/(x1 - 0.5)", "sqrt(-x1)", "(-x1)**0.5", "exp(x2*1e6)"])
def test_no_finite_value(text: str):
    """Assert that an expression without a finite value is refused with its arguments."""
    with pytest.raises(ExpressionError, match=r"no finite value for x1 = 0\.5, x2 = 3, u = 0\.25"):
        evaluate(text, VALUES, "here")
