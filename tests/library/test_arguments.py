"""Arguments of functions: logs of all sources, and one sentence on invalid ones; exceptions."""

from __future__ import annotations

import inspect
import pickle
from datetime import date
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest

import flexid
from flexid import errors
from flexid.cli.commands import COMMANDS
from flexid.errors import ArgumentError, RecordingError, SettingError
from flexid.library.arguments import _CONVERTED, _TYPES, entrance, joint_settings
from flexid.library.logs import all_logs

if TYPE_CHECKING:
    from flexid.library.arguments import AutoNumber, Bounds, Known, Terms

NAMES = ("time [s]", "link_position [deg]", "motor_position [rad]", "motor_torque [N m]")


@pytest.fixture(scope="module")
def arrays():
    """Return a log as arrays by name, one of them in degrees."""
    time = 1e-3 * np.arange(200)
    moved = np.sin(40.0 * time)
    link, torque = np.rad2deg(moved) + 0.3 * np.cos(90.0 * time), 3.0 * np.cos(35.0 * time)
    return dict(zip(NAMES, (time, link, moved, torque), strict=True))


KINDS = {
    "arrays": dict,
    "lists": lambda arrays: {name: values.tolist() for name, values in arrays.items()},
    "polars": pl.DataFrame,
    "pandas": pd.DataFrame,
    "an index": lambda arrays: pd.DataFrame(arrays).set_index(NAMES[0]),
    "a column as index": lambda arrays: pd.DataFrame(arrays).set_index(NAMES[0], drop=False),
    "pyarrow": lambda arrays: pa.table({n: pa.array(v) for n, v in arrays.items()}),
}


def test_public_functions_can_be_pickled():
    """Assert that another process gets the same function or class."""
    every = [getattr(flexid, name) for name in vars(flexid)["__all__"]]
    named = [value for value in every if callable(value) and hasattr(value, "__qualname__")]
    assert len(named) > 20
    assert [pickle.loads(pickle.dumps(value)) for value in named] == named


@pytest.mark.parametrize("kind", KINDS)
def test_memory_is_read_as_a_file_is(arrays, tmp_path, kind):
    """Assert that samples and units equal those of the log's file."""
    path = tmp_path / "log.parquet"
    pl.DataFrame(arrays).write_parquet(path)
    wanted, found = flexid.read_log(path), flexid.read_log(KINDS[kind](arrays))
    (one,), (other,) = wanted.recordings, found.recordings
    assert other.input_unit == "N m"
    assert other.sample_time == one.sample_time
    for channel in ("link_position", "motor_position", "input"):
        np.testing.assert_array_equal(getattr(other, channel), getattr(one, channel))


def test_a_column_map_serves_a_frame(arrays, tmp_path):
    """Assert that a column map applies to a frame."""
    path = tmp_path / "map.toml"
    path.write_text('link_position = {column = "q", unit = "deg"}')
    frame = pl.DataFrame(arrays).rename({NAMES[1]: "q"})
    (wanted,) = flexid.read_log(arrays).recordings
    for columns in (path, str(path), {"link_position": {"column": "q", "unit": "deg"}}):
        (found,) = flexid.read_log(frame, columns=columns).recordings
        link = found.needed_link_position
        np.testing.assert_allclose(link, wanted.needed_link_position, rtol=1e-15)


def test_the_same_data_twice_are_known(arrays):
    """Assert that the digest depends on the data and not on their form."""
    digests = {flexid.read_log(KINDS[kind](arrays)).sha256 for kind in KINDS}
    assert len(digests) == 1
    other = {**arrays, NAMES[3]: arrays[NAMES[3]] + 1e-9}
    assert flexid.read_log(other).sha256 not in digests


OTHERS = {name: np.arange(3.0) for name in NAMES}
NO_LOG = {
    "a number": 3,
    "nothing": None,
    "an array": np.zeros((3, 3)),
    "a lazy frame": pl.DataFrame({"a": [1]}).lazy(),
    "an empty list": [],
}
COLUMNS = {
    "no samples": {name: [] for name in NAMES},
    "two dimensions": {"time": np.zeros((3, 2))},
    "a number for a name": {1: [1.0]},
    "a frame without names": pd.DataFrame({0: [1.0]}),
    "a missing time": {**OTHERS, "time [s]": [0.0, None, 0.2]},
    "letters for times": {**OTHERS, "time [s]": ["a", "b", "c"]},
    "a masked array": {**OTHERS, "time [s]": np.ma.masked_greater([0.0, 1.0, 9.0], 2.0)},
    "dates": {**OTHERS, "time [s]": pl.Series([date(2026, 1, d) for d in (1, 2, 3)])},
}


def test_what_holds_no_log(refusals):
    """Assert that the message names the argument and valid kinds of logs, or the bad column."""
    refusals(
        {name: partial(flexid.identify, given) for name, given in NO_LOG.items()}
        | {name: partial(flexid.read_log, given) for name, given in COLUMNS.items()}
    )
    # The message of the library that makes the table.
    with pytest.raises(RecordingError, match="motor_torque"):
        flexid.read_log({"time": [0.0, 1.0], "motor_torque": [1.0]})
    with pytest.raises(RecordingError, match="'time' 2 times"):
        flexid.read_log(pd.DataFrame([[0.0, 1.0]], columns=["time", "time"]))


def test_a_log_is_taken_as_it_is(arrays, tmp_path):
    """Assert that logs and recordings are used unchanged, without a column map for them."""
    log = flexid.read_log(arrays)
    assert flexid.read_log(log) is log
    (recording,) = log.recordings
    alone = flexid.read_log(recording)
    assert alone.recordings == (recording,)
    assert all_logs([log, recording, arrays], None)[0] is log
    log = flexid.read_log(arrays)
    with pytest.raises(SettingError, match="columns"):
        flexid.read_log(log, columns=tmp_path / "map.toml")


@pytest.mark.parametrize(("most", "said"), [(199, ["200 samples take minutes"]), (200, [])])
def test_many_samples_are_said_to_take_long(arrays, monkeypatch, caplog, most, said):
    """Assert that a long log is announced at the start, and no shorter one."""
    monkeypatch.setattr("flexid.library.identify._MANY", most)
    monkeypatch.setattr("flexid.identification.identify.identify", lambda *_: None)
    caplog.set_level("INFO", "flexid")
    flexid.identify(arrays)
    assert [message.partition(":")[0] for message in caplog.messages] == said


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
    "a model's terms": call("flexible_joint", 3),
    "a model's velocity": call("flexible_joint", coulomb_velocity="slow"),
    "a threshold": call("Thresholds", determined_width="wide"),
    "a huge number": call("simulate", "a.toml", set={"plant.link_inertia": 10**400}),
    "a model by its name": call("recursive_least_squares", "flexible-joint", 1e-3),
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
