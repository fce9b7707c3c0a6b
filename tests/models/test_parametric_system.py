"""Declarations in Python: names, order, digest, and what is refused."""

import pytest
import sympy as sp

from flexid.errors import ExpressionError, ModelError
from flexid.models.parametric_system import ParametricSystem, Row

ARM = Row("arm", "q", "v", {"a": "-sin(q)", "b": "-v"}, known="u")


def test_order_of_names():
    """Assert that states and coefficients keep the order of declaration, row by row."""
    system = ParametricSystem("two", (ARM, Row("motor", "p", "w", {"d": "p - q"})))
    assert system.states == ("q", "v", "p", "w")
    assert system.coefficients == ("a", "b", "d")
    assert [part for _, part in system.row_slices()] == [slice(0, 2), slice(2, 3)]


def test_sympy_expressions_are_stored_as_text():
    """Assert that a SymPy expression and its text declare the same system."""
    q, v = sp.symbols("q v")
    row = Row("arm", "q", "v", {"a": -sp.sin(q), "b": -v}, known=sp.Symbol("u"))  # type: ignore[arg-type]
    assert ParametricSystem("m", (row,)).digest == ParametricSystem("m", (ARM,)).digest


def test_the_digest_is_of_all_expressions_and_names():
    """Assert that it sees a sign in a regressor and a constant's name, but no constant's value."""

    def system(**constants: float) -> ParametricSystem:
        return ParametricSystem("m", (ARM,), constants=constants)

    assert system(k=1.0).digest == system(k=2.0).digest
    assert system(k=1.0).digest != system(kk=1.0).digest

    other = Row("arm", "q", "v", {"a": "sin(q)", "b": "-v"}, known="u")
    assert ParametricSystem("m", (ARM,)).digest != ParametricSystem("m", (other,)).digest


NONE = ("1a", "a b", "_a", "class", "", "sin", "pi", "np", "log", "a.b")
WORD = r"'lambda' is a word of Python.*: write lambda_$"
REFUSED: list[tuple[tuple[Row, ...], str | None]] = [
    # A coefficient's name that means something else or nothing.
    *(((Row("arm", "q", "v", {name: "q"}),), "m: ") for name in NONE),
    ((Row("arm", "q", "v", {"lambda": "q"}),), WORD),
    # Missing rows, missing coefficients and names used twice.
    ((), None),
    ((Row("arm", "q", "v", {}),), None),
    ((Row("arm", "q", "q", {"a": "q"}),), None),
    ((Row("arm", "q", "v", {"q": "v"}),), None),
    ((Row("arm", "q", "v", {"u": "v"}),), None),
    ((ARM, Row("arm", "p", "w", {"d": "p"})), None),
    ((ARM, Row("motor", "p", "v", {"d": "p"})), None),
    ((ARM, Row("motor", "p", "w", {"a": "p"})), None),
]


@pytest.mark.parametrize(("rows", "words"), REFUSED)
def test_rows_that_declare_no_system(rows: tuple[Row, ...], words: str | None):
    """Assert that each is refused, with a remedy for a name that Python's grammar keeps."""
    with pytest.raises(ModelError, match=words):
        ParametricSystem("m", rows)


def test_expressions_use_declared_names_only():
    """Assert that a coefficient inside a regressor is refused: the class is linear in them."""
    with pytest.raises(ExpressionError, match=r"m: arm\.a: .* 'b' is not declared"):
        ParametricSystem("m", (Row("arm", "q", "v", {"a": "b*q", "b": "v"}),))
