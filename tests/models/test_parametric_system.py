"""Declarations in Python and in TOML: names, order, digest, and what is refused in one sentence."""

from pathlib import Path

import pytest
import sympy as sp

from flexid.errors import ExpressionError, ModelError
from flexid.models.model_file import read_model
from flexid.models.parametric_system import ParametricSystem, Row

ARM = Row("arm", "q", "v", {"a": "-sin(q)", "b": "-v"}, known="u")


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


GOOD = """
name = "pendulum"
inputs = ["u"]
[constants]
inertia = 2
[[rows]]
name = "arm"
coordinate = "q"
velocity = "v"
known = "u/inertia"
[rows.coefficients]
gravity = "-sin(q)"
friction = "-v"
"""


def write(folder: Path, text: str) -> Path:
    """Write a model file."""
    file = folder / "model.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_good_file(tmp_path: Path):
    """Assert that a file declares what it says."""
    system = read_model(write(tmp_path, GOOD))
    assert system.name == "pendulum"
    assert system.states == ("q", "v")
    assert system.coefficients == ("gravity", "friction")
    assert system.constants == {"inertia": 2.0}
    assert system.rows[0].known == "u/inertia"


def test_input_and_known_part_may_be_left_out(tmp_path: Path):
    """Assert that the input is u and the known part 0 where the file is silent."""
    text = GOOD.replace('inputs = ["u"]', "").replace('known = "u/inertia"', "")
    system = read_model(write(tmp_path, text))
    assert (system.inputs, system.rows[0].known) == (("u",), "0")


@pytest.mark.parametrize("name", ["pendulum", "three_inertias", "stribeck"])
def test_examples_are_models(name: str, examples: Path):
    """Assert that the example models are read."""
    assert read_model(examples / "models" / f"{name}.toml").coefficients


FAULTS = {
    "empty": ("", "'name' is missing"),
    "no rows": ('name = "m"', "'rows' is missing"),
    "empty rows": ('name = "m"\nrows = []', "'rows'"),
    "unknown key": (GOOD.replace("inputs", "imputs"), "'imputs' is unknown"),
    "key of a row": (GOOD.replace("velocity", "speed"), "'rows.1."),
    "type of a name": (GOOD.replace('"pendulum"', "7"), "'name'"),
    "type of a regressor": (GOOD.replace('"-v"', "-1"), "'rows.1.coefficients.friction'"),
    "type of a constant": (GOOD.replace("= 2", '= "2"'), "'constants.inertia'"),
    "constant not a number": (GOOD.replace("= 2", "= nan"), "'constants.inertia'"),
    "table for a list": (GOOD.replace('["u"]', "{u = 1}"), "'inputs'"),
    "name twice": (GOOD.replace('"v"\n', '"q"\n'), "declared twice"),
    "reserved name": (GOOD.replace("friction =", "sin ="), "reserved"),
    "hostile": (GOOD.replace('"-v"', '"q.__class__"'), ": pendulum: arm.friction: "),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_one_sentence(fault: str, tmp_path: Path):
    """Assert that a faulty file is refused in one line with the file, the key and a remedy."""
    text, words = FAULTS[fault]
    file = write(tmp_path, text)
    with pytest.raises((ModelError, ExpressionError)) as caught:
        read_model(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert words in message
    assert "\n" not in message
    assert isinstance(caught.value, ExpressionError) == (fault == "hostile")
