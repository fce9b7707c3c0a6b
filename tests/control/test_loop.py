"""Declarations of closed loops that do not fit together."""

import pytest

from flexid.control.controller import Controller
from flexid.control.loop import LoopDeclaration
from flexid.control.references import constant
from flexid.control.robust import robust_law
from flexid.errors import ExpressionError, ModelError
from flexid.models.parametric_system import ParametricSystem, Row

ARM = ParametricSystem("arm", (Row("arm", "q", "v", {"gravity": "-sin(q)"}, known="u"),))


def declare(law: Controller) -> LoopDeclaration:
    """Put a law in the loop with the arm."""
    return LoopDeclaration(ARM, law, constant(1.0))


def test_expression_is_checked() -> None:
    """Assert that a law may not call what the whitelist does not have."""
    with pytest.raises(ExpressionError, match="not allowed"):
        declare(Controller("law", "q", {"u": "__import__('os')"}))


def test_unknown_name_is_refused() -> None:
    """Assert that a law may use declared names only."""
    with pytest.raises(ExpressionError, match="gain"):
        declare(Controller("law", "q", {"u": "gain*(qd - q)"}))


@pytest.mark.parametrize("name", ["q", "gravity", "qd_2", "t", "sin", "qd_offset"])
def test_clash_of_names_is_refused(name: str) -> None:
    """Assert that a parameter may not take a name that means something else."""
    with pytest.raises(ModelError, match="another meaning"):
        declare(Controller("law", "q", {"u": "-v"}, {name: 1.0}))


def test_word_of_python_is_no_parameter() -> None:
    """Assert that a parameter named after a word of Python is refused with a remedy."""
    with pytest.raises(ModelError, match=r"'lambda' is a word of Python.*: write lambda_$"):
        declare(Controller("law", "q", {"u": "-v"}, {"lambda": 1.0}))


def test_missing_input_is_refused() -> None:
    """Assert that a law must drive the inputs of the system."""
    with pytest.raises(ModelError, match="gives the inputs torque"):
        declare(Controller("law", "q", {"torque": "-v"}))


def test_unknown_tracked_state_is_refused() -> None:
    """Assert that the tracked state must exist."""
    with pytest.raises(ModelError, match="tracks 'x1'"):
        declare(Controller("law", "x1", {"u": "-v"}))


def test_unknown_parameter_is_refused() -> None:
    """Assert that only existing parameters take new values."""
    with pytest.raises(ModelError, match="no parameter 'gain4'"):
        robust_law().with_parameters(gain4=1.0)


def test_values_do_not_change_the_digest() -> None:
    """Assert that a law with other values is the same derivation, another expression is not."""
    law = robust_law()
    assert law.with_parameters(k=10.0).digest == law.digest
    assert Controller("law", "q", {"u": "-v"}).digest != Controller("law", "q", {"u": "-q"}).digest
