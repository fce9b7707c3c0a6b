"""The printed answers: the numbers in them, and whole texts, which stand in ``texts/``.

``pytest --update-golden`` writes these files again.
"""

from dataclasses import replace
from math import nan
from pathlib import Path

import pytest
from made_result import made_result

from flexid.comparisons.comparison import compare_estimates
from flexid.identification.vocabulary.evidence import ModelError
from flexid.report.comparison import parts
from flexid.report.identification import explanation, identification_parts, prediction_lines
from flexid.report.terminal import USUAL, format_with_interval, laid_out
from made_estimates import TRUE, exact


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


TEXTS = Path(__file__).parent / "texts"


def identification():
    """An answer in which each number occurs once, with the evidence for its choices."""
    result = made_result()
    return [*identification_parts(result), *explanation(result)]


def exact_fit():
    """One without disturbances and with a model error, held against no rigid joint that follows."""
    result = made_result(ModelError(16.0, 1.2, 0.72))
    validation = replace(result.validation, fit_percent={"motor_position": 99.0})
    rigid = replace(result.compliance, rigid_fit_percent={"motor_position": nan})
    result = replace(result, disturbances=None, compliance=rigid, validation=validation)
    return [*identification_parts(result), *explanation(result)]


def comparison():
    """A drive before, and after, stiffer and with an offset that A does without."""
    stiffer = {**TRUE, "theta2": 1.1 * TRUE["theta2"], "alpha1": 1.1 * TRUE["alpha1"]}
    a, b = exact(TRUE, "one"), exact({**stiffer, "alpha_offset": 3.0}, "two")
    offset = replace(b.parameters["motor_offset_torque"], value=0.001, interval=(-0.1, 0.1))
    a = replace(a, removed={offset.name: offset})
    return parts(compare_estimates(a, b, ("before.json", "after.json")))


@pytest.mark.parametrize("answer", [identification, exact_fit, comparison])
def test_the_text_is_as_it_was(answer, request):
    """Assert that every line is printed as before, within 80 columns, with nothing cut off."""
    lines = [line.plain for line in laid_out(answer(), USUAL)]
    assert max(map(len, lines)) <= USUAL
    assert "…" not in "".join(lines)
    path = TEXTS / f"{answer.__name__}.txt"
    if request.config.getoption("--update-golden"):
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert lines == path.read_text(encoding="utf-8").splitlines()
