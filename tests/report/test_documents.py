"""Documents for JSON, and complete output or none."""

import json
import os
import subprocess
import sys

import pytest

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.files import output_directory


def test_json_has_no_infinities():
    """Assert that infinities and NaN become null at any depth, for strict parsers."""
    text = to_json({"a": [float("inf"), {"b": float("nan")}], "c": (1.5, "x")})
    assert json.loads(text) == {"a": [None, {"b": None}], "c": [1.5, "x"]}


def test_output_appears_whole_or_not_at_all(tmp_path):
    """Assert that files appear at the end, and that a failure leaves earlier results alone."""
    out = tmp_path / "deep" / "out"
    with output_directory(out) as directory:
        (directory / "a.txt").write_text("1")
        assert not (out / "a.txt").exists()
    assert [file.name for file in out.iterdir()] == ["a.txt"]
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
    """Assert that the folder of an ended process is removed, and that of a running one is not."""
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


def test_directories_that_cannot_be_written(tmp_path):
    """Assert that a directory with a file's name, or with a name not in UTF-8, is refused."""
    (tmp_path / "b.txt").mkdir()

    def write():
        with output_directory(tmp_path) as staging:
            (staging / "a.txt").write_text("1")
            (staging / "b.txt").write_text("1")

    with pytest.raises(SettingError, match="is a directory"):
        write()
    assert [file.name for file in tmp_path.iterdir()] == ["b.txt"]
    out = tmp_path / "run\udcff"
    with pytest.raises(SettingError, match="not UTF-8"), output_directory(out):
        pass
    assert not out.exists()
