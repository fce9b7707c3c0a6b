"""A stored identification equals the original, except for its free runs."""

import json
from dataclasses import asdict, fields, is_dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest
from made_result import made_result

from flexid.arrays import to_json
from flexid.stored_estimates.estimate_file import (
    FORMAT_VERSION,
    estimate_document,
    read_estimate,
    sealed,
)
from made_estimates import MISSING, altered

SERIES = ("validation", "excitation", "fit")


@pytest.fixture(scope="module")
def document():
    """Return the document of an identification as in its file."""
    return json.loads(to_json(estimate_document(made_result())))


def text(part):
    """Return all fields of a part, which may be a mapping by name."""
    if isinstance(part, dict):
        return {name: text(one) for name, one in part.items()}
    return repr(asdict(part) if is_dataclass(part) and not isinstance(part, type) else part)


def test_what_was_found_comes_back(document):
    """Assert that all parts but the series are recovered, infinities and arrays included."""
    made, found = made_result(), read_estimate(document).of_joint
    for part in fields(made):
        if part.name not in SERIES:
            # As text, since NaN does not equal itself.
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


BY_HAND: dict[str, Any] = {
    "coefficients.theta1.value": 5.0000001,
    "parameters.gravity_torque.interval": [6.8, None],
    "provenance.flexid_version": "1",
    "residual_excess": MISSING,
    "note": "mine",
    "sha256": "0" * 64,
}
UNKNOWN: dict[str, Any] = {
    "format_version": FORMAT_VERSION + 1,
    "model": "pendulum",
    "coefficients": 3,
    "coefficients.theta1.value": "3",
    "choices.hold": MISSING,
    "fit.covariance": "none",
    "summary": None,
}


def test_files_that_hold_no_estimate(document, refusals):
    """Assert that an edited file, and one of an unknown version, are refused."""
    endless: dict[str, Any] = {}
    endless["itself"] = endless
    true, no = (sealed(altered(document, "format_version", one)) for one in (True, MISSING))
    contents = {
        **{f"{key} by hand": altered(document, key, one) for key, one in BY_HAND.items()},
        "no checksum": altered(document, "sha256", MISSING),
        **{f"another {key}": sealed(altered(document, key, one)) for key, one in UNKNOWN.items()},
        "a version that is true": true,
        "no version": no,
        "keys that JSON does not have": {(1, 2): 3},
        "what holds itself": endless,
    }
    refusals({name: partial(read_estimate, content) for name, content in contents.items()})


def test_other_files_are_read(document):
    """Assert that a file without disturbances is read, in any order, white space and format."""
    older = {key: part for key, part in document.items() if key != "disturbances"}
    assert read_estimate(sealed(older)).of_joint.disturbances is None
    text = json.dumps(dict(reversed(document.items())), indent=9).replace("5.0,", "5,")
    assert "5," in text
    assert read_estimate(json.loads(text)).of_joint.coefficients["theta1"].value == 5.0
