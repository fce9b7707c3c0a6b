"""Arguments that a function does not take: one sentence with what would be right."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import pytest

import flexid
from flexid.cli.commands import COMMANDS
from flexid.errors import ArgumentError, SettingError
from flexid.library.arguments import _CONVERTED, _TYPES, entrance, joint_settings

if TYPE_CHECKING:
    from flexid.library.arguments import AutoNumber, Bounds, Known, Terms


def call(name, *arguments, **options):
    """A call that is made later."""
    return lambda: getattr(flexid, name)(*arguments, **options)


UNTAKEN = {
    "misspelt": (call("identify", "a.csv", knwon={}), "unexpected keyword argument 'knwon'"),
    "of the excitation": (call("excitation", "a.csv", hould="zero"), "'hould'"),
    "missing": (call("identify"), "missing a required argument: 'logs'"),
    "progress": (call("identify", "a.csv", progress=3), "progress is an int.*print"),
    "one too many": (call("identify", "a.csv", "b.csv"), "too many positional arguments"),
    "twice": (call("identify", "a.csv", logs="b.csv"), "logs"),
    "hold": (call("identify", "a.csv", hold=0), "an int.*'zero'"),
    "known value": (call("identify", "a.csv", known={"beta1": "3"}), "beta1.*a str"),
    "bounds": (call("identify", "a.csv", bounds={"theta2": 3.0}), r"theta2.*\(lower, upper\)"),
    "terms": (call("identify", "a.csv", terms=3), "an int.*gravity"),
    "delay": (call("identify", "a.csv", input_delay="late"), "'late'.*auto"),
    "columns": (call("identify", "a.csv", columns=["t"]), "a list.*path.*mapping"),
    "empty path": (call("identify", ""), "logs is empty: give a path"),
    "empty file": (call("load", ""), "path is empty: give a path"),
    "thresholds": (call("identify", "a.csv", thresholds=3), "an int: give a flexid.Thresholds"),
    "stream": (call("identify", {"time": []}, stream=True), "path of one Parquet"),
    "load": (call("load", None), "None.*path"),
    "estimate": (call("validate", 3, "a.csv"), "an int.*JointEstimate.*path"),
    "compared": (call("compare", 3, "a.json"), "a is an int.*JointEstimate"),
    "model": (call("derive", 3), "an int.*path"),
    "seed": (call("design", "a.toml", seed=0.5), "a float"),
    "set": (call("simulate", "a.toml", set=["controller.k=3"]), "controller.k"),
    "set value": (call("simulate", "a.toml", set={"controller.k": "3"}), "controller.k"),
    "workers": (call("campaign", "a.toml", out="b", workers="all"), "a str"),
    "no sample time": (call("watch"), "sample_time is missing"),
    "sample time": (call("watch", sample_time="fast"), "sample_time is a str"),
    "source": (call("watch", source=3), "source is an int: give text or a path"),
    "filter": (call("watch", sample_time=1e-3, filter=3), "unexpected keyword argument 'filter'"),
}
UNUSABLE = {
    "seed": (call("design", "a.toml", seed=-1), "seed"),
    "thresholds": (
        call("identify", "a.parquet", stream=True, thresholds=flexid.Thresholds()),
        "thresholds",
    ),
}


@pytest.mark.parametrize(
    ("run", "said", "kind"),
    [
        *((*case, ArgumentError) for case in UNTAKEN.values()),
        *((*case, SettingError) for case in UNUSABLE.values()),
    ],
    ids=[*UNTAKEN, *(f"{name} of no use" for name in UNUSABLE)],
)
def test_wrong_calls_are_one_sentence(run, said, kind):
    """Assert that the sentence names function and argument and says what would be right."""
    with pytest.raises(kind, match=said) as caught:
        run()
    error: Any = caught.value
    assert "\n" not in str(error)
    if kind is ArgumentError:
        assert str(error).startswith(f"{error.function}: ")
        assert isinstance(error, TypeError)


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "studio"])
def test_every_type_is_checked(name):
    """Assert that what a function declares is known to what checks arguments."""
    for parameter in inspect.signature(getattr(flexid, name)).parameters.values():
        kind = str(parameter.annotation).removesuffix(" | None")
        known = kind in _CONVERTED or kind.startswith("Literal") or kind == "bool"
        assert known or {*kind.split(" | ")} & {*_TYPES}, parameter


def test_options_mean_what_the_commands_mean():
    """Assert that values, pairs, ends that are open and names in one text become settings."""

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
