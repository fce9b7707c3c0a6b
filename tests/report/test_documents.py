"""Documents for JSON, and output that appears whole or not at all."""

import json
import os
import subprocess
import sys

import pytest
from made_result import made_result

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.files import output_directory
from flexid.stored_estimates.estimate_file import estimate_document


def test_json_has_no_infinities():
    """Assert that infinities and NaN become null, deep inside, so that any reader can parse."""
    text = to_json({"a": [float("inf"), {"b": float("nan")}], "c": (1.5, "x")})
    assert json.loads(text) == {"a": [None, {"b": None}], "c": [1.5, "x"]}


@pytest.fixture(scope="module")
def document():
    """Return the document of an identification as any reader of JSON has it."""
    return json.loads(to_json(estimate_document(made_result())))


def test_an_estimate_comes_back_from_its_document(document):
    """Assert that coefficients, parameters and what was removed hold all that was found."""
    made = made_result()
    for kind in ("coefficients", "parameters", "removed"):
        assert list(document[kind]) == list(getattr(made, kind))
    assert document["coefficients"]["alpha_coulomb"] == {
        "value": 2.0,
        "std": 0.5,
        "interval": [1.0, 3.0],
        "unit": "rad/s^2",
        "verdict": "weak",
        "reason": "its interval is wide",
        "degrees_of_freedom": None,
        "logarithmic": False,
        "slopes": {},
    }
    assert document["removed"]["joint_damping"]["interval"] == [-3e-4, 5e-4]
    assert document["removed"]["gravity_angle"]["interval"] == [None, None]


def test_the_evidence_is_in_the_document(document):
    """Assert that model error, disturbances, horizons, delays and evidence of terms are there."""
    assert document["model_error"] == {"excess": 0.05, "growth": 0.9, "share": 0.0}
    assert document["disturbances"]["shares"] == {"link": 0.021, "motor": 0.13}
    assert document["disturbances"]["sample_time"] == 0.004
    assert list(document["validation"]["horizons"]) == ["0.05", "0.2", "1"]
    assert document["validation"]["horizons"]["1"]["motor_position"] == 99.4
    assert document["choices"]["input_delay"]["interval"] == [0.00287, 0.00317]
    assert document["choices"]["term_evidence"][1]["name"] == "alpha_cubic"
    assert document["choices"]["segment_evidence"][0]["duration"] == 0.995


def test_output_appears_whole(tmp_path):
    """Assert that files written in the staging directory end up in the named one."""
    out = tmp_path / "deep" / "out"
    with output_directory(out) as directory:
        (directory / "a.txt").write_text("1")
        assert not (out / "a.txt").exists()
    assert [file.name for file in out.iterdir()] == ["a.txt"]


def test_failure_leaves_nothing_behind(tmp_path):
    """Assert that a failure leaves earlier results, no new ones, and no directory that it made."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.txt").write_text("old")

    def write_and_fail():
        with output_directory(out) as directory:
            (directory / "a.txt").write_text("new")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_and_fail()
    assert [(file.name, file.read_text()) for file in out.iterdir()] == [("a.txt", "old")]

    with pytest.raises(RuntimeError), output_directory(tmp_path / "new"):
        raise RuntimeError
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(os.name != "posix", reason="processes that can be asked whether they live")
def test_what_a_killed_process_has_left_is_removed(tmp_path):
    """Assert that the folder of a process that has gone is removed, and that of a living is not."""
    code = (
        "import os, sys; from pathlib import Path; from flexid.files import *\n"
        "with output_directory(Path(sys.argv[1])): os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    (left,) = tmp_path.iterdir()
    with output_directory(tmp_path) as staging, output_directory(tmp_path):
        assert not left.exists()
        assert staging.exists()
    assert list(tmp_path.iterdir()) == []


def test_directory_in_the_way_of_a_file_is_refused(tmp_path):
    """Assert that a directory with a file's name stops the output before any file is moved."""
    (tmp_path / "b.txt").mkdir()

    def write():
        with output_directory(tmp_path) as staging:
            (staging / "a.txt").write_text("1")
            (staging / "b.txt").write_text("1")

    with pytest.raises(SettingError, match="is a directory"):
        write()
    assert [file.name for file in tmp_path.iterdir()] == ["b.txt"]


def test_name_that_is_no_text_is_refused(tmp_path):
    """Assert that a directory whose name is no UTF-8, where tables cannot go, is refused first."""
    out = tmp_path / "run\udcff"
    with pytest.raises(SettingError, match="not UTF-8"), output_directory(out):
        pass
    assert not out.exists()
