"""The printed answer, and the numbers in it."""

from dataclasses import replace
from math import nan

import pytest
from made_result import made_result

from flexid.identification.vocabulary.evidence import ModelError
from flexid.report.digits import format_with_interval
from flexid.report.identification_table import print_identification
from flexid.report.terminal import USUAL


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


@pytest.fixture
def printed(capsys):
    """Return a function that prints a result and gives what stands on the page."""

    def of(result):
        print_identification(result, explain=True)
        return capsys.readouterr().out

    return of


def test_the_answer_fits_the_page(printed):
    """Assert that no line is wider than 80 columns and nothing is cut off."""
    page = printed(made_result())
    assert max(map(len, page.splitlines())) <= USUAL
    assert "…" not in page


@pytest.mark.parametrize(
    "line",
    [
        "Residual over the sensors' noise: link_position 1.02, motor_position 3.04",
        "Prediction over 0.05, 0.2, 1 s: link_position 99.9, 99.7, 99.5 %",
        "Prediction over 0.05, 0.2, 1 s: motor_position 99.8, 99.6, 99.4 %",
        "  alpha_coulomb: its interval is wide",
    ],
)
def test_the_evidence_is_printed(printed, line):
    """Assert that residuals by position, horizons and reasons have a line each."""
    assert line in [each.rstrip() for each in printed(made_result()).splitlines()]


@pytest.mark.parametrize(
    ("own", "line"),
    [
        (99.0, "The same, joint rigid: motor_position not followed by any fit"),
        (nan, "The same, joint rigid: motor_position not tested (at rest)"),
    ],
)
def test_a_rival_that_fails_is_no_motor_at_rest(printed, own, line):
    """Assert that a rigid joint without a fit is distinguished from a motor that rests."""
    result = made_result()
    result = replace(
        result,
        compliance=replace(result.compliance, rigid_fit_percent={"motor_position": nan}),
        validation=replace(result.validation, fit_percent={"motor_position": own}),
    )
    assert line in printed(result).splitlines()


def test_a_channel_at_rest_has_no_horizons(printed):
    """Assert that what is not tested is not predicted either."""
    assert "s: deflection" not in printed(made_result())


def test_what_the_model_does_without_is_bounded(printed):
    """Assert that a removed parameter shows the far end of its interval, or that none is known."""
    page = " ".join(printed(made_result()).split())
    assert "Without: joint_damping below 0.0005 N m s/rad, gravity_angle, on which" in page


def test_what_is_unexplained_is_told(printed):
    """Assert that a fit with disturbances gives the share of each balance instead."""
    page = printed(made_result())
    assert "Unexplained acceleration: link 2.1 %, motor 13 %" in page
    assert "Model error" not in page


def test_a_model_error_is_told(printed):
    """Assert that a model error says how large it is and how much of it repeats itself."""
    exact = replace(made_result(), disturbances=None)
    assert "Model error: none" in printed(exact)
    wrong = replace(exact, model_error=ModelError(16.0, 1.2, 0.72))
    page = " ".join(printed(wrong).split())
    assert "the residuals hold 4 times the sensors' noise beyond it, 72 % of that" in page
