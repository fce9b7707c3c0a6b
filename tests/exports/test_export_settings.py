"""Export of an estimate: its content and settings, and refusals."""

import dataclasses
from functools import partial
from math import nan

import polars as pl
import pytest

import flexid
from flexid.errors import SettingError
from flexid.exports.request import doubts_of, request_of_identification


@pytest.fixture(scope="module")
def result(example_estimate):
    """Return an identification of the example."""
    return example_estimate.result


def doubted(result, name="alpha2", **changes):
    """Return the identification with one coefficient changed."""
    coefficient = dataclasses.replace(result.coefficients[name], **changes)
    return dataclasses.replace(result, coefficients=result.coefficients | {name: coefficient})


def test_what_is_exported_of_an_estimate(result):
    """Assert the log's units, and that unknown values are named instead of taken as 0."""
    whole = request_of_identification(result)
    assert set(whole.values) == set(result.coefficients)
    source = request_of_identification(doubted(result, value=nan))
    assert set(source.values) == set(result.coefficients) - {"alpha2"}
    assert "alpha2" in source.system.coefficients
    units = (whole.units[name] for name in ("u", "theta2", "beta1"))
    assert tuple(units) == ("N m", "1/s^2", "rad/s^2/(N m)")
    current = doubted(result, "beta1", unit="rad/s^2/A")
    assert request_of_identification(current).units["u"] == "A"
    assert doubts_of(result.coefficients) == ()
    (doubt,) = doubts_of(doubted(result, verdict="undetermined").coefficients)
    assert doubt == "the estimate leaves alpha2 undetermined"


LOG = "examples/flexible_joint.csv"
REFUSED = {
    "no sample time": {},
    "no number": {"sample_time": nan},
    "too short": {"sample_time": 1e-9},
    "too long": {"sample_time": 2.0},
    **{
        f"a filter of {rate}": {"sample_time": 1e-3, "filter_rate": rate}
        for rate in (0.009, 501.0, -20.0)
    },
    "too short a memory": {"sample_time": 1e-3, "memory": 0.0},
    "another sample time": {"sample_time": 2e-3, "log": LOG},
    "another machine": {"what": "examples/models/pendulum.toml", "log": LOG},
}


def test_what_no_drive_has_is_refused(result, tmp_path, refusals):
    """Assert that invalid settings are refused in one sentence, and that no file is left."""
    calls = {}
    for name, options in REFUSED.items():
        given = {"what": "flexible-joint", "to": "c99", "out": tmp_path / "drive"} | options
        calls[name] = partial(flexid.export, **given)
    for name in ("theta2", "alpha1", "beta1"):
        for value in (0.0, -100.0):
            other = doubted(result, name, value=value)
            calls[f"{name} = {value}"] = partial(request_of_identification, other)
    refusals(calls)
    assert not (tmp_path / "drive").exists()


def test_a_log_of_another_input_is_refused(tmp_path):
    """Assert that a log of a current is refused as test vector of an estimate from a torque."""
    log = pl.read_csv("examples/flexible_joint.csv").head(2000)
    terms = ("gravity", "motor_viscous")
    estimate = flexid.identify(log, terms=terms, hold="zero", input_delay=0, link_delay=0)
    current = log.rename({"motor_torque [N m]": "motor_current [A]"})
    with pytest.raises(SettingError, match="input in A, and the estimate was made with one in N m"):
        flexid.export(estimate, to="c99", out=tmp_path / "drive", log=current)
    written = flexid.export(estimate, to="c99", out=tmp_path / "drive", log=log)
    names = ["README.md", "example_main.c", "flexid_drive.c", "flexid_drive.h", "test_vector.h"]
    assert [path.name for path in written.paths] == names
