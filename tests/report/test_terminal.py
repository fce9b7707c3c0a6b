"""How answers are laid out: within the width, and no number cut."""

import re
from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from made_result import made_result
from rich.text import Text

from flexid.report.excitation import format_percent
from flexid.report.identification import explanation, identification_parts
from flexid.report.terminal import (
    Cell,
    Column,
    Table,
    format_with_interval,
    laid_out,
    number,
    spelled,
    wrapped,
)

WIDTHS = st.integers(40, 200)
ANY = st.floats(allow_nan=False, allow_infinity=False)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|inf|nan)")


def page(parts, width):
    """Return the lines of a page."""
    return [line.plain for line in laid_out(parts, width)]


def numbers_on(lines):
    """Return every number of a page."""
    return NUMBER.findall(" ".join(lines))


@st.composite
def tables(draw):
    """Make a table of names, numbers and words, of which some may be left out."""
    spares = draw(st.lists(st.integers(0, 3), min_size=1, max_size=7))
    columns = [Column("name"), *(Column(f"head {i}", True, s) for i, s in enumerate(spares))]
    table = Table("A title", columns)
    rows = draw(st.lists(st.lists(ANY, min_size=len(spares), max_size=len(spares)), min_size=1))
    for i, row in enumerate(rows):
        table.add(f"row{i}", *(number(value, 8, "N m") for value in row))
    return table, spares, rows


@settings(max_examples=200, deadline=None, derandomize=True)
@given(made=tables(), width=WIDTHS)
def test_every_number_is_whole_at_every_width(made, width):
    """Assert that each number that is not left out is printed with three digits or more."""
    table, spares, rows = made
    lines = page([table], width)
    assert max(map(len, lines)) <= width
    assert all(line == line.rstrip() for line in lines)
    printed = {float(text) for text in numbers_on(lines)}
    for row in rows:
        for value, spare in zip(row, spares, strict=True):
            if not spare:
                assert {float(f"{value:.{d}g}") for d in range(3, 9)} & printed, value


@settings(max_examples=200, deadline=None, derandomize=True)
@given(value=ANY, ends=st.tuples(ANY, ANY), digits=st.sampled_from([1, 2]))
def test_digits_keep_the_value_within_its_width(value, ends, digits):
    """Assert that what is printed is off by less than the interval's width, and is short."""
    lower, upper = sorted(ends)
    shown = format_with_interval(value, lower, upper, digits)
    for text, number_ in zip(shown, (value, lower, upper), strict=True):
        assert len(text) <= 24
        if 0.0 < upper - lower < float("inf") and abs(float(text)) < float("inf"):
            allowed = max(upper - lower, 1e-13 * max(map(abs, (value, lower, upper))))
            assert abs(float(text) - number_) <= max(allowed, 0.6 * abs(number_))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(value=ANY, ends=st.tuples(ANY, ANY), width=WIDTHS)
def test_an_identification_fits_every_width(value, ends, width):
    """Assert that whatever a parameter comes to, its numbers stand whole in the table."""
    made = made_result()
    lower, upper = sorted(ends)
    assume(lower < upper)
    wild = replace(made.parameters["gravity_torque"], value=value, interval=(lower, upper))
    result = replace(made, parameters={"gravity_torque_per_motor_inertia": wild})
    lines = page([*identification_parts(result), *explanation(result)], width)
    assert max(map(len, lines)) <= width
    printed = numbers_on(lines)
    for place in range(3):
        options = {format_with_interval(value, lower, upper, d)[place] for d in (1, 2)}
        assert options & {*printed}
    assert "…" not in "".join(lines)


def test_digits_go_first_then_columns_then_the_table():
    """Assert in which order a table gives way."""
    columns = [Column("name"), Column("value", True), Column("also", True, 1)]
    table = Table("Title", columns)
    table.add("stiffness", number(123456.789, 9), Cell(("partner 0.25",)))

    def shown(width):
        return page([table], width)[-1]

    assert shown(60).split() == ["stiffness", "123456.789", "partner", "0.25"]
    assert shown(33).split() == ["stiffness", "123456.8", "partner", "0.25"]
    assert shown(22).split() == ["stiffness", "123456.789"]
    assert shown(18).split() == ["stiffness", "123457"]
    entry = ["stiffness: value", "  123456.789,", "  also partner", "  0.25"]
    assert page([table], 16)[1:] == entry


@pytest.mark.parametrize(
    ("numbers", "shown"),
    [
        ((99.98731, 99.93, 100.04), "99.99 99.93 100.04"),
        ((1.23456, 1.2, 1.27), "1.235 1.200 1.270"),
        ((4.1e6, 3.9e6, 4.3e6), "4100000 3900000 4300000"),
        ((0.3, 0.3, 0.3), "0.3 0.3 0.3"),
        ((31346198.4, -9e9, 9.1e9), "3e+07 -9e+09 9e+09"),
        ((31346198.4, -float("inf"), float("inf")), "3e+07 -inf inf"),
    ],
)
def test_digits_follow_the_interval(numbers, shown):
    """Assert that no more digits are printed than the width justifies, and one of what is free."""
    assert " ".join(format_with_interval(*numbers)) == shown


def test_shares_have_two_digits():
    """Assert that a share is in per cent, small ones and open ones in words."""
    shares = map(format_percent, (0.01234, 3.7, 1e-6, float("inf")))
    assert [*shares] == ["1.2 %", "370 %", "<0.01 %", "unknown"]


@pytest.mark.parametrize("width", [40, 57, 80, 100])
def test_a_number_stays_with_its_unit(width):
    """Assert that a sentence is broken beside a number with its unit, and not within."""
    said = "Without: " + ", ".join(f"friction below {i}.5e-05 N m s/rad" for i in range(9))
    lines = wrapped(said, width)
    assert max(map(len, lines)) <= width
    assert sum(len(re.findall(r"\d\.5e-05 N m s/rad", line)) for line in lines) == 9


def test_empty_lines_are_single():
    """Assert that no page has two empty lines together, or one at its end."""
    table = Table("Title", [Column("name")])
    table.add("a")
    lines = page([table, Text(), Text("b"), Text(), table], 80)
    assert lines == ["Title", "name", "────", "a", "", "b", "", "Title", "name", "────", "a"]


def test_greek_is_spelled_where_it_cannot_be_shown():
    """Assert that nothing that we print is lost where there is no Greek."""
    assert spelled("α₂ ± 3 ≤ θ₁ 1/s²") == "alpha2 +- 3 <= theta1 1/s2"
