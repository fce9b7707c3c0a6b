"""Invalid arguments of functions: one sentence with valid ones; properties of all exceptions."""

from __future__ import annotations

import inspect
import pickle
from typing import TYPE_CHECKING, Any

import pytest

import flexid
from flexid import errors
from flexid.cli.commands import COMMANDS
from flexid.errors import ArgumentError
from flexid.library.arguments import _CONVERTED, _TYPES, entrance, joint_settings

if TYPE_CHECKING:
    from flexid.library.arguments import AutoNumber, Bounds, Known, Terms


def call(name, *arguments, **options):
    """Return a call with these arguments, to be made later."""
    return lambda: getattr(flexid, name)(*arguments, **options)


WRONG = {
    "misspelt": call("identify", "a.csv", knwon={}),
    "of the excitation": call("excitation", "a.csv", hould="zero"),
    "missing": call("identify"),
    "progress": call("identify", "a.csv", progress=3),
    "one too many": call("identify", "a.csv", "b.csv"),
    "twice": call("identify", "a.csv", logs="b.csv"),
    "hold": call("identify", "a.csv", hold=0),
    "hold of an export": call("export", "flexible-joint", to="c99", out="b", hold="cubic"),
    "hold of a stream": call("watch", sample_time=1e-3, hold="cubic"),
    "known value": call("identify", "a.csv", known={"beta1": "3"}),
    "bounds": call("identify", "a.csv", bounds={"theta2": 3.0}),
    "terms": call("identify", "a.csv", terms=3),
    "delay": call("identify", "a.csv", input_delay="late"),
    "columns": call("identify", "a.csv", columns=["t"]),
    "empty path": call("identify", ""),
    "empty file": call("load", ""),
    "thresholds": call("identify", "a.csv", thresholds=3),
    "stream": call("identify", {"time": []}, stream=True),
    "load": call("load", None),
    "estimate": call("validate", 3, "a.csv"),
    "compared": call("compare", 3, "a.json"),
    "model": call("derive", 3),
    "seed": call("design", "a.toml", seed=0.5),
    "set": call("simulate", "a.toml", set=["controller.k=3"]),
    "set value": call("simulate", "a.toml", set={"controller.k": "3"}),
    "workers": call("campaign", "a.toml", out="b", workers="all"),
    "no sample time": call("watch"),
    "sample time": call("watch", sample_time="fast"),
    "source": call("watch", source=3),
    "filter": call("watch", sample_time=1e-3, filter=3),
    "seed of no use": call("design", "a.toml", seed=-1),
    "thresholds of no use": call(
        "identify", "a.parquet", stream=True, thresholds=flexid.Thresholds()
    ),
}


def test_wrong_calls(refusals):
    """Assert that the message names function and argument, and a valid value."""
    refusals(WRONG)
    assert issubclass(ArgumentError, TypeError)


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "studio"])
def test_every_type_is_checked(name):
    """Assert that all declared types are known to the check of arguments."""
    for parameter in inspect.signature(getattr(flexid, name)).parameters.values():
        kind = str(parameter.annotation).removesuffix(" | None")
        known = kind in _CONVERTED or kind.startswith("Literal") or kind == "bool"
        assert known or {*kind.split(" | ")} & {*_TYPES}, parameter


def test_options_mean_what_the_commands_mean():
    """Assert that values, pairs, open intervals and lists in one text become settings."""

    @entrance
    def options(known: Known, bounds: Bounds, terms: Terms, input_delay: AutoNumber):
        return joint_settings(known=known, bounds=bounds, terms=terms, input_delay=input_delay)

    known: dict[str, Any] = {"alpha1": 3, "motor_inertia": (0.3, 0.01), "theta1": (5.0, 0.1)}
    settings = options(
        known=known,
        bounds={"theta2": (50, None), "alpha2": (None, 2.0)},
        terms="gravity, motor_viscous,gravity",
        input_delay=0,
    )
    assert settings.known == {"alpha1": 3.0, "motor_inertia": 0.3, "theta1": 5.0}
    assert settings.known_deviations == {"motor_inertia": 0.01, "theta1": 0.1}
    assert settings.bounds == {"theta2": (50.0, float("inf")), "alpha2": (-float("inf"), 2.0)}
    assert settings.terms == ("gravity", "motor_viscous")
    assert settings.input_delay == 0.0


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
