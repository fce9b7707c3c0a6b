"""Files that are larger, wider or deeper than anybody means: refused before they fill memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from flexid import files
from flexid.errors import FlexidError
from flexid.experiment_design.drive import read_drive
from flexid.experiments.experiment import read_experiment
from flexid.models.model_file import read_model
from flexid.recording import read_log
from flexid.recording.column_map import read_map
from flexid.stored_estimates.estimate_file import read_estimate

TOML: dict[str, Callable[[Path], object]] = {
    "column map": read_map,
    "drive": read_drive,
    "experiment": read_experiment,
    "model": read_model,
}
MOST = 60_000_000  # bytes of memory: the largest file below, decoded, and half as much again


def refusal(path: Path, raw: bytes, read: Callable[[Path], object]) -> str:
    """The one line with which a file is refused, in bounded memory."""
    path.write_bytes(raw)
    tracemalloc.start()
    try:
        with pytest.raises(FlexidError) as caught:
            read(path)
        assert tracemalloc.get_traced_memory()[1] < MOST
    finally:
        tracemalloc.stop()
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 2000
    return message


@pytest.mark.parametrize("what", TOML)
def test_a_million_terms(what: str, tmp_path: Path):
    """Assert that a TOML file of a million terms is refused by its size."""
    raw = b"a = [" + b"{x = 1}," * 1_000_000 + b"]"
    assert "larger than 200 kB" in refusal(tmp_path / "a.toml", raw, TOML[what])


@pytest.mark.parametrize("what", TOML)
@pytest.mark.parametrize(
    "raw",
    [
        b"a = " + b"[" * 1000 + b"]" * 1000,
        b"a = " + b"{a = " * 1000 + b"1" + b"}" * 1000,
        b"a" + b".a" * 1000 + b" = 1",
        b"[a" + b".a" * 1000 + b"]",
    ],
    ids=["arrays", "tables", "keys", "headers"],
)
def test_nested_a_thousand_deep(what: str, raw: bytes, tmp_path: Path):
    """Assert that a TOML file that is nested a thousand deep is refused."""
    message = refusal(tmp_path / "a.toml", raw, TOML[what])
    assert "not TOML that can be read" in message or "a key of more than 20 parts" in message


@pytest.mark.parametrize("raw", [b"[" * 200_000, b'{"a":' * 100_000], ids=["lists", "objects"])
def test_an_estimate_nested_deep(raw: bytes, tmp_path: Path):
    """Assert that JSON that is nested a hundred thousand deep is no estimate."""
    assert "is no JSON" in refusal(tmp_path / "estimate.json", raw, read_estimate)


def test_a_header_of_a_million_columns(tmp_path: Path):
    """Assert that a header longer than a megabyte is refused, and one of very many columns."""
    header = ",".join(f"c{number}" for number in range(1_000_000))
    rows = "\n" + ",".join("1" * 1_000_000)
    message = refusal(tmp_path / "log.csv", (header + 2 * rows).encode(), read_log)
    assert "line 1: the line has more than 1000000 bytes" in message
    header = ",".join(f"c{number}" for number in range(20_000))
    rows = "\n" + ",".join("1" * 20_000)
    message = refusal(tmp_path / "log.csv", (header + 3 * rows).encode(), read_log)
    assert "there are 20000 columns of 3 rows, more than are read at once" in message


def test_a_file_that_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that of a file that is still written not a part is taken for the whole."""
    (tmp_path / "log.csv").write_text("time,motor_position\n" + "0,1\n" * 100)
    monkeypatch.setattr(files, "check_file", lambda *_: 100)
    with pytest.raises(FlexidError, match="the file grows while it is read"):
        read_log(tmp_path / "log.csv")
