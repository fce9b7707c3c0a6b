"""Layout of answers, documents for JSON, and complete output or none."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from made_result import made_result

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.files import output_directory
from flexid.report.excitation import format_percent
from flexid.report.identification import evidence, parts
from flexid.report.terminal import Column, Table, as_text, format_with_interval, number, numbers

USUAL = st.integers(-(10**9), 10**9).map(lambda number: number / 1000)
ANY = st.floats(allow_nan=False, allow_infinity=False)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|inf|nan)")


@settings(max_examples=200)
@given(
    rows=st.lists(st.lists(ANY, min_size=6, max_size=6), min_size=1, max_size=5),
    width=st.integers(40, 200),
)
def test_every_number_is_whole_at_every_width(rows, width):
    """Assert that a table too narrow for its numbers is printed wider instead of cut."""
    table = Table("A title", [Column("name"), *numbers(*"abcdef")])
    for i, row in enumerate(rows):
        table.add(f"row{i}", *(number(value, 8, "N m") for value in row))
    printed = {*NUMBER.findall(as_text([table], width))}
    for row in rows:
        assert {number(value, 8) for value in row} <= printed


@settings(max_examples=200)
@given(value=ANY, ends=st.tuples(ANY, ANY))
def test_digits_keep_the_value_within_its_width(value, ends):
    """Assert a rounding error below the interval's width, and a short text."""
    lower, upper = sorted(ends)
    shown = format_with_interval(value, lower, upper)
    for text, number_ in zip(shown, (value, lower, upper), strict=True):
        assert len(text) <= 24
        if 0.0 < upper - lower < float("inf") and abs(float(text)) < float("inf"):
            allowed = max(upper - lower, 1e-13 * max(map(abs, (value, lower, upper))))
            assert abs(float(text) - number_) <= max(allowed, 0.6 * abs(number_))


@settings(max_examples=60)
@given(value=USUAL, ends=st.tuples(USUAL, USUAL))
def test_an_identification_fits_80_columns(value, ends):
    """Assert that usual values of a parameter fit the table of 80 columns uncut."""
    made = made_result()
    lower, upper = sorted(ends)
    assume(upper - lower > 1e-3 * max(abs(lower), abs(upper), abs(value)))
    wild = replace(made.parameters["gravity_torque"], value=value, interval=(lower, upper))
    result = replace(made, parameters={"gravity_torque_per_motor_inertia": wild})
    text = as_text([*parts(result), *evidence(result)], 80)
    assert max(map(len, text.splitlines())) <= 80
    assert {*format_with_interval(value, lower, upper)} <= {*NUMBER.findall(text)}
    assert "…" not in text


@pytest.mark.parametrize(
    ("numbers", "shown"),
    [
        ((99.98731, 99.93, 100.04), "99.99 99.93 100.04"),
        ((1.23456, 1.2, 1.27), "1.235 1.200 1.270"),
        ((4.1e6, 3.9e6, 4.3e6), "4100000 3900000 4300000"),
        ((0.3, 0.3, 0.3), "0.3 0.3 0.3"),
        ((31346198.4, -9e9, 9.1e9), "0 -9e+09 9e+09"),
        ((31346198.4, -float("inf"), float("inf")), "3e+07 -inf inf"),
        ((-1e-14, -5.7, 5.7), "0 -6 6"),
        ((2e-5, -0.0057, 0.0057), "0.000 -0.006 0.006"),
        ((50.0, -0.4, 110.0), "50 -0.4 110"),
        ((0.02, 0.002, 0.2), "0.02 0.002 0.20"),
    ],
)
def test_digits_follow_the_interval(numbers, shown):
    """Assert digits in accordance with the width, and one digit for an undetermined value."""
    assert " ".join(format_with_interval(*numbers)) == shown


def test_shares_and_empty_lines():
    """Assert shares in per cent or words, and no two successive empty lines."""
    shares = map(format_percent, (0.01234, 3.7, 1e-6, float("inf")))
    assert [*shares] == ["1.2 %", "370 %", "<0.01 %", "unknown"]
    table = Table("Title", [Column("name")])
    table.add("a")
    lines = as_text([table, "", "b", "", "  c", table], 80).splitlines()
    assert lines == [*("Title", "name", "────", "a", "", "b", "", "  c"), *lines[:4]]


def test_json_has_no_infinities():
    """Assert that infinities and NaN become null at any depth, for strict parsers."""
    text = to_json({"a": [float("inf"), {"b": float("nan")}], "c": (1.5, "x")})
    assert json.loads(text) == {"a": [None, {"b": None}], "c": [1.5, "x"]}


def test_output_appears_whole_or_not_at_all(tmp_path):
    """Assert that files appear at the end, and that a failure leaves earlier results alone."""
    out = tmp_path / "deep" / "out"
    with output_directory(out) as directory:
        (directory / "a.txt").write_text("1")
        assert not (out / "a.txt").exists()
    assert [file.name for file in out.iterdir()] == ["a.txt"]
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.txt").write_text("old")

    def write_and_fail():
        with output_directory(out) as directory:
            (directory / "a.txt").write_text("new")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_and_fail()
    assert [(file.name, file.read_text()) for file in out.iterdir()] == [("a.txt", "old")]

    with pytest.raises(RuntimeError), output_directory(tmp_path / "new"):
        raise RuntimeError
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(os.name != "posix", reason="processes that can be asked whether they live")
def test_what_a_killed_process_has_left_is_removed(tmp_path):
    """Assert that the folder of an ended process is removed, and that of a running one is not."""
    code = (
        "import os, sys; from pathlib import Path; from flexid.files import *\n"
        "with output_directory(Path(sys.argv[1])): os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    (left,) = tmp_path.iterdir()
    with output_directory(tmp_path) as staging, output_directory(tmp_path):
        assert not left.exists()
        assert staging.exists()
    assert list(tmp_path.iterdir()) == []


def test_directories_that_cannot_be_written(tmp_path):
    """Assert that a directory with a file's name, or with a name not in UTF-8, is refused."""
    (tmp_path / "b.txt").mkdir()

    def write():
        with output_directory(tmp_path) as staging:
            (staging / "a.txt").write_text("1")
            (staging / "b.txt").write_text("1")

    with pytest.raises(SettingError, match="is a directory"):
        write()
    assert [file.name for file in tmp_path.iterdir()] == ["b.txt"]
    out = tmp_path / "run\udcff"
    with pytest.raises(SettingError, match="not UTF-8"), output_directory(out):
        pass
    assert not out.exists()
