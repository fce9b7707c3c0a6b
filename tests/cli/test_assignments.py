"""Options that hold several values, or a value with something about it."""

from math import inf

import pytest

from flexid.cli.options import parse_bounds, parse_known, parse_number, parse_values
from flexid.errors import SettingError


@pytest.mark.parametrize(
    "text", ["theta2=100+-5", "theta2 = 100 ± 5", "theta2 = 100 +/- 5", "theta2=1e2+-5e+0"]
)
def test_uncertainty_follows_the_value(text):
    """Assert that a value and its standard deviation are told apart in either notation."""
    assert parse_known("--known", [text]) == {"theta2": (100.0, 5.0)}


def test_exponent_is_no_uncertainty():
    """Assert that the sign of an exponent does not begin a standard deviation."""
    found = parse_known("--known", ["beta1=1e+3", "alpha1=1e-3"])
    assert found == {"beta1": 1000.0, "alpha1": 0.001}


@pytest.mark.parametrize(
    ("parse", "option", "texts"),
    [
        (parse_known, "--known", ("theta2", "theta2=", "theta2=a", "theta2=1+-", "theta2=+-1")),
        (parse_bounds, "--bounds", ("alpha2", "alpha2=1", "alpha2=a:b", "alpha2=1:2:3")),
    ],
)
def test_bad_assignments_are_shown(parse, option, texts):
    """Assert that what is no assignment is refused in the words of the user."""
    for text in texts:
        with pytest.raises(SettingError, match=option) as refused:
            parse(option, [text])
        assert repr(text) in str(refused.value)


@pytest.mark.parametrize(
    ("text", "ends"), [("0:", (0.0, inf)), (":2", (-inf, 2.0)), (" -1e3 : 2 ", (-1000.0, 2.0))]
)
def test_end_left_out_is_infinite(text, ends):
    """Assert that bounds may be open at either end."""
    assert parse_bounds("--bounds", [f"alpha2={text}"]) == {"alpha2": ends}


@pytest.mark.parametrize("parse", [parse_known, parse_bounds])
def test_second_value_does_not_replace_the_first(parse):
    """Assert that a name that stands twice is refused rather than one of them dropped."""
    texts = ["beta1=3", "beta1=4"] if parse is parse_known else ["beta1=3:", "beta1 = :4"]
    with pytest.raises(SettingError, match="beta1 is given twice"):
        parse("--option", texts)


def test_number_or_auto():
    """Assert that a number becomes one and auto stays."""
    assert parse_number("--input-delay", "2e-3") == 0.002
    assert parse_number("--input-delay", "auto") == "auto"
    with pytest.raises(SettingError, match="--input-delay: 'soon'"):
        parse_number("--input-delay", "soon")


def test_values_of_a_path():
    """Assert that a seed of 63 bits is not rounded, and exponents and infinities are numbers."""
    seed = 2**62 + 1
    assert parse_values("--set", [f"sampling.seed={seed}"]) == {"sampling.seed": seed}
    assert float(seed) != seed
    parsed = parse_values("--set", ["a.b=1e3", "a.c = -2", "a.d=inf"])
    assert parsed == {"a.b": 1000.0, "a.c": -2, "a.d": inf}
