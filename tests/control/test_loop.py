"""Declarations of closed loops that do not fit together."""

import pytest

from flexid.control.laws import Controller, robust_law
from flexid.control.loop import LoopDeclaration
from flexid.control.references import constant
from flexid.errors import ExpressionError, ModelError
from flexid.models.parametric_system import ParametricSystem, Row

ARM = ParametricSystem("arm", (Row("arm", "q", "v", {"gravity": "-sin(q)"}, known="u"),))


CLASHES = ("q", "gravity", "qd_2", "t", "sin", "qd_offset")

REFUSED = {
    "not in the whitelist": ({"u": "__import__('os')"}, {}, ExpressionError, "not allowed"),
    "undeclared name": ({"u": "gain*(qd - q)"}, {}, ExpressionError, "gain"),
    "missing input": ({"torque": "-v"}, {}, ModelError, "gives the inputs torque"),
    "word of Python": (
        {"u": "-v"},
        {"lambda": 1.0},
        ModelError,
        r"'lambda' is a word of Python.*: write lambda_$",
    ),
    "tracked": ({"u": "-v"}, {}, ModelError, "tracks 'x1'"),
    **{name: ({"u": "-v"}, {name: 1.0}, ModelError, "another meaning") for name in CLASHES},
}


@pytest.mark.parametrize("fault", REFUSED)
def test_laws_that_do_not_fit_are_refused(fault: str) -> None:
    """Assert that a law with a wrong expression, input or name is refused by what is wrong."""
    inputs, parameters, error, message = REFUSED[fault]
    tracked = "x1" if fault == "tracked" else "q"
    with pytest.raises(error, match=message):
        LoopDeclaration(ARM, Controller("law", tracked, inputs, parameters), constant(1.0))


def test_unknown_parameter_is_refused() -> None:
    """Assert that only existing parameters take new values."""
    with pytest.raises(ModelError, match="no parameter 'gain4'"):
        robust_law().with_parameters(gain4=1.0)


def test_values_do_not_change_the_digest() -> None:
    """Assert that a law with other values is the same derivation, another expression is not."""
    law = robust_law()
    assert law.with_parameters(k=10.0).digest == law.digest
    assert Controller("law", "q", {"u": "-v"}).digest != Controller("law", "q", {"u": "-q"}).digest
