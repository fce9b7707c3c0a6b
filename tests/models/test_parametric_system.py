"""Declarations in Python and in TOML: names, order, digest, and refusals."""

from functools import partial
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from flexid.models.model_file import read_model
from flexid.models.parametric_system import ParametricSystem, Row

ARM = Row("arm", "q", "v", {"a": "-sin(q)", "b": "-v"}, known="u")


def test_the_digest_is_of_all_expressions_and_names():
    """Assert that the digest covers signs of regressors and names of constants, not values.

    A SymPy expression and its text declare the same system.
    """

    def digest(row: Row = ARM, **constants: float) -> str:
        return ParametricSystem("m", (row,), constants=constants).digest

    assert digest(k=1.0) == digest(k=2.0) != digest(kk=1.0)
    assert digest() != digest(Row("arm", "q", "v", {"a": "sin(q)", "b": "-v"}, known="u"))
    q, v = sp.symbols("q v")
    symbolic: Any = {"a": -sp.sin(q), "b": -v}
    assert digest() == digest(Row("arm", "q", "v", symbolic, known=sp.Symbol("u")))  # type: ignore[arg-type]


NAMES = ("1a", "a b", "_a", "class", "", "sin", "pi", "np", "log", "a.b", "lambda")
ROWS: dict[str, tuple[Row, ...]] = {
    # Names of coefficients with another meaning, or that are invalid.
    **{f"a coefficient {name!r}": (Row("arm", "q", "v", {name: "q"}),) for name in NAMES},
    # Systems are linear in their coefficients.
    "a coefficient inside a regressor": (Row("arm", "q", "v", {"a": "b*q", "b": "v"}),),
    "no rows": (),
    "no coefficients": (Row("arm", "q", "v", {}),),
    "a velocity that is the coordinate": (Row("arm", "q", "q", {"a": "q"}),),
    "a coefficient that is the coordinate": (Row("arm", "q", "v", {"q": "v"}),),
    "a coefficient that is the input": (Row("arm", "q", "v", {"u": "v"}),),
    "a row twice": (ARM, Row("arm", "p", "w", {"d": "p"})),
    "a velocity twice": (ARM, Row("motor", "p", "v", {"d": "p"})),
    "a coefficient twice": (ARM, Row("motor", "p", "w", {"a": "p"})),
}


def test_rows_that_declare_no_system(refusals: Any):
    """Assert that invalid rows are refused, with a remedy for Python's keywords."""
    refusals({name: partial(ParametricSystem, "m", rows) for name, rows in ROWS.items()})


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
    """Assert that a file declares name, states, coefficients, constants and known part.

    By default the input is u and the known part 0.
    """
    system = read_model(write(tmp_path, GOOD))
    assert system.name == "pendulum"
    assert system.states == ("q", "v")
    assert system.coefficients == ("gravity", "friction")
    assert system.constants == {"inertia": 2.0}
    assert system.rows[0].known == "u/inertia"
    text = GOOD.replace('inputs = ["u"]', "").replace('known = "u/inertia"', "")
    system = read_model(write(tmp_path, text))
    assert (system.inputs, system.rows[0].known) == (("u",), "0")


@pytest.mark.parametrize("name", ["pendulum", "three_inertias", "stribeck"])
def test_examples_are_models(name: str, examples: Path):
    """Assert that the example models are read."""
    assert read_model(examples / "models" / f"{name}.toml").coefficients


FAULTS = {
    "empty": "",
    "no rows": 'name = "m"',
    "empty rows": 'name = "m"\nrows = []',
    "unknown key": GOOD.replace("inputs", "imputs"),
    "key of a row": GOOD.replace("velocity", "speed"),
    "type of a name": GOOD.replace('"pendulum"', "7"),
    "type of a regressor": GOOD.replace('"-v"', "-1"),
    "type of a constant": GOOD.replace("= 2", '= "2"'),
    "constant not a number": GOOD.replace("= 2", "= nan"),
    "table for a list": GOOD.replace('["u"]', "{u = 1}"),
    "name twice": GOOD.replace('"v"\n', '"q"\n'),
    "reserved name": GOOD.replace("friction =", "sin ="),
    "hostile": GOOD.replace('"-v"', '"q.__class__"'),
}


def test_faults_of_model_files(tmp_path: Path, refusals: Any, monkeypatch: pytest.MonkeyPatch):
    """Assert that a faulty file is refused in one line with the file, the key and a remedy."""
    monkeypatch.chdir(tmp_path)
    refusals({name: lambda t=text: read_model(write(Path(), t)) for name, text in FAULTS.items()})
