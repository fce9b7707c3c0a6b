"""An identification that was written and read again is the same, but for its time series."""

import json
from copy import deepcopy
from dataclasses import asdict, fields, is_dataclass
from typing import Any, cast

import numpy as np
import pytest
from made_result import made_result

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.stored_estimates.estimate_file import FORMAT_VERSION, estimate_document, read_estimate
from made_estimates import TRUE, exact

SERIES = ("observer", "validation", "excitation", "fit")


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
    assert found.observer.gains == made.observer.gains
    assert (found.validation.runs, len(found.observer.time)) == ((), 0)


def test_a_file_from_before_disturbances_is_read(document):
    """Assert that what an earlier version did not write is not asked for."""
    older = {key: part for key, part in document.items() if key != "disturbances"}
    assert read_estimate(older).of_joint.disturbances is None


def test_what_json_cannot_hold_is_no_estimate():
    """Assert that a mapping with other keys, and one that holds itself, are refused."""
    endless: dict[str, Any] = {}
    endless["itself"] = endless
    for content in (cast("Any", {(1, 2): 3}), endless):
        with pytest.raises(SettingError, match="is no JSON"):
            read_estimate(content)


MISSING = object()

ALTERED: list[tuple[tuple[str, ...], object]] = [
    (("model",), MISSING),
    (("model",), "pendulum"),
    (("coefficients",), 3),
    (("coefficients", "theta1"), MISSING),
    (("coefficients", "theta1", "value"), "3"),
    (("choices",), []),
    (("choices", "hold"), MISSING),
    (("choices", "input_delay", "value"), 1e9),
    (("choices", "coulomb_velocity"), -1.0),
    (("choices", "shapes"), {"a": "wide"}),
    (("parameters", "gravity_torque", "interval"), 3),
    (("coefficients", "theta1", "verdict"), "fine"),
    (("fit", "covariance"), "none"),
    (("fit",), {"names": ["a"], "values": [1.0], "covariance": [[]], "degrees_of_freedom": [9.0]}),
    (("validation",), {"fit_percent": {}, "horizons": {"soon": {}}}),
    (("choices", "hold"), "spline"),
    (("summary",), None),
    (("provenance", "inputs"), None),
    (("provenance", "inputs"), [3]),
    (("provenance", "inputs"), [{"file": 3}]),
    (("provenance", "inputs"), [{"columns": {"time": {"columns": {"t": 1.0}}}}]),
    (("provenance", "settings"), None),
    (("provenance", "settings"), {"known": None}),
    (("excitation",), {}),
    (("excitation", "link", "singular_values"), []),
    (("excitation", "link", "correlated"), ["theta1", "theta2", "theta1"]),
    (("least_squares",), {"zeta": 1.0}),
    (("parameters", "gravity_torque", "slopes"), {"zeta": 1.0}),
    (("validation", "horizons"), {"0.05": {}}),
    (("coefficients", "theta1", "value"), 5.1),
    (("coefficients", "theta1", "value"), 1e308),
    (("coefficients", "theta1", "value"), 1e-308),
]


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("format_version",), FORMAT_VERSION + 1, "update flexid"),
        (("format_version",), True, "holds no estimate"),
        (("format_version",), MISSING, "holds no estimate"),
        *((keys, value, "") for keys, value in ALTERED),
    ],
)
def test_a_file_that_was_altered_is_refused(document, keys, value, words):
    """Assert that the key that is wrong is named, in one line."""
    altered = deepcopy(document)
    part = altered
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    if value is MISSING:
        del part[keys[-1]]
    with pytest.raises(SettingError, match=words or keys[-1]) as caught:
        read_estimate(altered)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "value"), [("joint_stiffness", -100.0), ("link_inertia", 2.0)])
def test_a_parameter_that_contradicts_its_coefficients_is_refused(name, value):
    """Assert that numbers that were altered by hand are no estimate."""
    document = json.loads(to_json(estimate_document(exact(TRUE, "a log"))))
    assert read_estimate(document).of_joint.parameters[name].value > 0.0
    document["parameters"][name]["value"] = value
    with pytest.raises(SettingError, match=rf"{name}.*follows from the coefficients"):
        read_estimate(document)
