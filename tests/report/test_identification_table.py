"""The printed answer, and the numbers in it."""

from dataclasses import replace
from math import nan

import pytest
from made_result import made_result

from flexid.report.identification import identification_parts, prediction_lines
from flexid.report.terminal import format_with_interval


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


def test_a_motor_at_rest_is_no_rival_that_fails():
    """Assert that a rigid joint without a fit is distinguished from a motor that rests."""
    result = made_result()
    result = replace(
        result,
        compliance=replace(result.compliance, rigid_fit_percent={"motor_position": nan}),
        validation=replace(result.validation, fit_percent={"motor_position": nan}),
    )
    line = "Rigid-joint model, free run: motor_position not tested (at rest)"
    assert line in prediction_lines(result)


def test_what_is_negligible_is_named():
    """Assert that a determined value whose interval holds zero is said to be negligible."""
    result = made_result()
    small = replace(result.parameters["gravity_torque"], interval=(-1e-4, 1e-4))
    said = map(str, identification_parts(replace(result, parameters={"x": small})))
    assert "  Negligible, and zero within the interval: gravity_torque" in said
