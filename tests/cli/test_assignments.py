"""Options with several values, or with a value and its uncertainty or limits."""

from functools import partial
from math import inf
from typing import Any

import pytest

from flexid.cli.commands import command_line
from flexid.cli.options import parse_bounds, parse_known, parse_number, parse_values

SEED = 2**62 + 1
READ = [
    # A value and its standard deviation, in either notation; not confused with an exponent's sign.
    *(
        (parse_known, [text], {"theta2": (100.0, 5.0)})
        for text in ("theta2=100+-5", "theta2 = 100 ± 5", "theta2 = 100 +/- 5", "theta2=1e2+-5e+0")
    ),
    (parse_known, ["beta1=1e+3", "alpha1=1e-3"], {"beta1": 1000.0, "alpha1": 0.001}),
    # A missing end is infinite.
    (parse_bounds, ["alpha2=0:"], {"alpha2": (0.0, inf)}),
    (parse_bounds, ["alpha2=:2"], {"alpha2": (-inf, 2.0)}),
    (parse_bounds, ["alpha2= -1e3 : 2 "], {"alpha2": (-1000.0, 2.0)}),
    (parse_number, "2e-3", 0.002),
    (parse_number, "auto", "auto"),
    # A seed of 63 bits is not rounded.
    (parse_values, [f"sampling.seed={SEED}"], {"sampling.seed": SEED}),
    (parse_values, ["a.b=1e3", "a.c = -2", "a.d=inf"], {"a.b": 1000.0, "a.c": -2, "a.d": inf}),
]


@pytest.mark.parametrize(("parse", "given", "expected"), READ)
def test_what_is_read(parse, given, expected):
    """Assert that typed assignments become values by name."""
    assert parse("--option", given) == expected


REFUSED = [
    *((parse_known, [f"theta2{end}"]) for end in ("", "=", "=a", "=1+-", "=+-1")),
    *((parse_bounds, [text]) for text in ("alpha2", "alpha2=1", "alpha2=a:b", "alpha2=1:2:3")),
    # A second value does not replace the first.
    (parse_known, ["beta1=3", "beta1=4"]),
    (parse_bounds, ["beta1=3:", "beta1 = :4"]),
    (parse_number, "soon"),
]


def test_what_is_refused(refusals):
    """Assert that an invalid assignment is refused with the text that was typed."""
    refusals({str(given): partial(parse, "--option", given) for parse, given in REFUSED})


def test_what_is_typed_is_what_the_library_gets():
    """Assert that a typed value is used as it is, even if it equals the help's rounded default."""
    given = {}
    command: Any = command_line("identify").commands["identify"]
    command.run = lambda _command, options, _flags: given.update(options)
    command.main(["a.csv", "--validation-share", "0.333"], standalone_mode=False)
    assert given == {"logs": ("a.csv",), "validation_share": 0.333}
