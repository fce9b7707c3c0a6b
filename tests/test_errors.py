"""Properties of all exceptions of flexid."""

import pickle

import pytest

from flexid import errors

RAISED = [
    errors.SettingError("terms", "give one"),
    errors.RecordingError("log.csv", "line 3", "is no number: correct it"),
    errors.SimulationError("the loop diverges", 1.5),
    errors.ExperimentError("a.toml", "controller.k", "is missing: add it"),
    errors.ArgumentError("identify", "knwon", "is no option: did you mean known?"),
]


@pytest.mark.parametrize("error", RAISED, ids=lambda error: type(error).__name__)
def test_errors_travel_between_processes(error: errors.FlexidError) -> None:
    """Assert that a pickled error keeps its class, text and fields."""
    arrived = pickle.loads(pickle.dumps(error))
    assert type(arrived) is type(error)
    assert str(arrived) == str(error)
    assert vars(arrived) == vars(error)
