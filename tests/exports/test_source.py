"""What is exported of an estimate: the values that it has, and no others."""

import dataclasses
from math import nan

import pytest

from flexid.errors import SettingError
from flexid.exports.request import request_of_identification


@pytest.fixture(scope="module")
def result(example_estimate):
    """An identification of the example."""
    return example_estimate.result


def doubted(result, name="alpha2", **changes):
    """The same, but for one coefficient."""
    coefficient = dataclasses.replace(result.coefficients[name], **changes)
    return dataclasses.replace(result, coefficients=result.coefficients | {name: coefficient})


def test_what_has_no_value_gets_none(result):
    """Assert that a coefficient of which the log says nothing is not taken for 0."""
    assert set(request_of_identification(result).values) == set(result.coefficients)
    source = request_of_identification(doubted(result, value=nan))
    assert set(source.values) == set(result.coefficients) - {"alpha2"}
    assert "alpha2" in source.system.coefficients


def test_units_are_those_of_the_estimate(result):
    """Assert that inputs have the unit that the log had, and coefficients theirs."""
    units = request_of_identification(result).units
    assert (units["u"], units["theta2"], units["beta1"]) == ("N m", "1/s^2", "rad/s^2/(N m)")
    gain = dataclasses.replace(result.coefficients["beta1"], unit="rad/s^2/A")
    current = dataclasses.replace(result, coefficients=result.coefficients | {"beta1": gain})
    assert request_of_identification(current).units["u"] == "A"


def test_doubts_are_said(result):
    """Assert that a value that the log leaves undetermined is named, and others are not."""
    assert request_of_identification(result).doubts == ()
    (doubt,) = request_of_identification(doubted(result, verdict="undetermined")).doubts
    assert doubt == "the estimate leaves alpha2 undetermined"


@pytest.mark.parametrize("name", ["theta2", "alpha1", "beta1"])
@pytest.mark.parametrize("value", [0.0, -100.0])
def test_no_drive_has_it(result, name, value):
    """Assert that a spring or an inertia that is not positive is refused by name."""
    with pytest.raises(SettingError, match=f"^{name}: is {value:g} .* makes it positive"):
        request_of_identification(doubted(result, name, value=value))
