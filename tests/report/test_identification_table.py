"""Numbers in the printed table."""

import pytest

from flexid.report.identification_table import format_with_interval


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ((1.23456, 1.2, 1.27), ("1.235", "1.200", "1.270")),
        ((1234.5, 1200.0, 1270.0), ("1234", "1200", "1270")),
        ((0.3, 0.3, 0.3), ("0.3", "0.3", "0.3")),
        ((1.0, float("-inf"), float("inf")), ("1", "-inf", "inf")),
    ],
)
def test_digits_follow_the_interval(numbers, expected):
    """Assert that no more digits are printed than the interval's width justifies."""
    assert format_with_interval(*numbers) == expected
