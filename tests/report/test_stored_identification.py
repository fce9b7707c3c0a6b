"""An identification that was written and read again is the same, but for its free runs."""

import json
from copy import deepcopy
from dataclasses import asdict, fields, is_dataclass
from typing import Any, cast

import numpy as np
import pytest
from made_result import made_result

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.stored_estimates.estimate_file import (
    FORMAT_VERSION,
    estimate_document,
    read_estimate,
    sealed,
)

SERIES = ("validation", "excitation", "fit")


@pytest.fixture(scope="module")
def document():
    """The document of an identification as a file has it."""
    return json.loads(to_json(estimate_document(made_result())))


def text(part):
    """All fields of a part, be it one or many by name."""
    if isinstance(part, dict):
        return {name: text(one) for name, one in part.items()}
    return repr(asdict(part) if is_dataclass(part) and not isinstance(part, type) else part)


def test_what_was_found_comes_back(document):
    """Assert that all but the series is as it was, infinities and arrays included."""
    made, found = made_result(), read_estimate(document).of_joint
    for part in fields(made):
        if part.name not in SERIES:
            # By text, in which what is not a number equals itself.
            assert text(getattr(found, part.name)) == text(getattr(made, part.name)), part.name

    assert found.fit.names == made.fit.names
    assert found.fit.degrees_of_freedom == made.fit.degrees_of_freedom
    np.testing.assert_array_equal(found.fit.covariance, made.fit.covariance)
    row, other = found.excitation["link"], made.excitation["link"]
    assert row.coefficients == other.coefficients
    assert row.condition_number == other.condition_number
    np.testing.assert_array_equal(row.direction, other.direction)
    assert repr(found.validation.fit_percent) == repr(made.validation.fit_percent)
    assert repr(found.validation.horizons) == repr(made.validation.horizons)
    assert found.validation.runs == ()


def test_a_file_from_before_disturbances_is_read(document):
    """Assert that what an earlier version did not write is not asked for."""
    older = {key: part for key, part in document.items() if key != "disturbances"}
    assert read_estimate(sealed(older)).of_joint.disturbances is None


def test_what_json_cannot_hold_is_no_estimate():
    """Assert that a mapping with other keys, and one that holds itself, are refused."""
    endless: dict[str, Any] = {}
    endless["itself"] = endless
    for content in (cast("Any", {(1, 2): 3}), endless):
        with pytest.raises(SettingError, match="is no JSON"):
            read_estimate(content)


MISSING = object()


def altered(document, keys, value):
    """The document with another value somewhere, or without what was there."""
    made = deepcopy(document)
    part = made
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    if value is MISSING:
        del part[keys[-1]]
    return made


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("coefficients", "theta1", "value"), 5.0000001),
        (("parameters", "gravity_torque", "interval"), [6.8, None]),
        (("provenance", "flexid_version"), "1"),
        (("residual_excess",), MISSING),
        (("note",), "mine"),
        (("sha256",), MISSING),
        (("sha256",), "0" * 64),
    ],
)
def test_a_file_that_was_altered_is_refused(document, keys, value):
    """Assert that no number can be changed by hand, nor anything be added or left out."""
    with pytest.raises(SettingError, match="was changed since flexid wrote it"):
        read_estimate(altered(document, keys, value))


def test_a_file_that_was_laid_out_otherwise_is_read(document):
    """Assert that order, blanks and whole numbers without a point are none of its content."""
    text = json.dumps(dict(reversed(document.items())), indent=9).replace("5.0,", "5,")
    assert "5," in text
    assert read_estimate(json.loads(text)).of_joint.coefficients["theta1"].value == 5.0


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("format_version",), FORMAT_VERSION + 1, "update flexid"),
        (("format_version",), True, "holds no estimate"),
        (("format_version",), MISSING, "holds no estimate"),
        (("model",), "pendulum", "model"),
        (("coefficients",), 3, "coefficients"),
        (("coefficients", "theta1", "value"), "3", "coefficients.theta1.value"),
        (("choices", "hold"), MISSING, "hold"),
        (("fit", "covariance"), "none", "covariance"),
        (("summary",), None, "summary"),
    ],
)
def test_a_file_of_another_version_is_refused(document, keys, value, words):
    """Assert that what this version does not know is named by its key, in one line."""
    with pytest.raises(SettingError, match=words) as caught:
        read_estimate(sealed(altered(document, keys, value)))
    assert "\n" not in str(caught.value)
