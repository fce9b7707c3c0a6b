"""Models in TOML: read rightly, and every fault one sentence with file, key and remedy."""

from pathlib import Path

import pytest

from flexid.errors import ExpressionError, ModelError
from flexid.models.model_file import read_model

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
