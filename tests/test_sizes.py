"""Files that are too large, wide or deeply nested: refused with bounded memory."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from flexid import files
from flexid.errors import FlexidError
from flexid.experiment_design.drive import read_drive
from flexid.experiments.experiment import read_experiment
from flexid.files import MAX_BYTES
from flexid.models.model_file import read_model
from flexid.recording import read_log
from flexid.recording.recipes import read_map
from flexid.stored_estimates.estimate_file import read_estimate

TOML: dict[str, Callable[[Path], object]] = {
    "column map": read_map,
    "drive": read_drive,
    "experiment": read_experiment,
    "model": read_model,
}
MOST = 60_000_000  # bytes of memory: 1.5 times the largest file below, decoded


def refusal(path: Path, raw: bytes, read: Callable[[Path], object]) -> str:
    """Return the one-line message of a refusal, in bounded memory."""
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


NOT_TOML = {
    "a million terms": (b"a = [" + b"{x = 1}," * 1_000_000 + b"]", "larger than 200 kB"),
    "a byte too many": (b"#" * (MAX_BYTES + 1), "larger than 200 kB"),
    "arrays": (b"a = " + b"[" * 1000 + b"]" * 1000, "not TOML that can be read"),
    "arrays without an end": (b"a = " + b"[" * 5000, "not TOML that can be read"),
    "tables": (b"a = " + b"{a = " * 1000 + b"1" + b"}" * 1000, "not TOML that can be read"),
    "keys": (b"a" + b".a" * 1000 + b" = 1", "a key of more than 20 parts"),
    "headers": (b"[a" + b".a" * 1000 + b"]", "a key of more than 20 parts"),
    "a large number": (b"a = " + b"9" * 6000, "not TOML that can be read"),
    "a key twice": (b"a = 1\na = 2", "not TOML: Cannot overwrite a value"),
    "a table without an end": (b"[a", "not TOML: "),
    "no text": (b"a=\xff\xfe\x00", "not text at byte 2: save it as UTF-8"),
    "null": (b"a=\0", "not TOML: "),
}


@pytest.mark.parametrize("what", TOML)
@pytest.mark.parametrize("case", NOT_TOML)
def test_what_is_no_toml(what: str, case: str, tmp_path: Path):
    """Assert that every reader of TOML refuses the file by name, with the reason."""
    raw, words = NOT_TOML[case]
    message = refusal(tmp_path / "a.toml", raw, TOML[what])
    assert words in message
    assert str(tmp_path / "a.toml") in message


@pytest.mark.parametrize("what", TOML)
def test_what_is_no_file(what: str, tmp_path: Path):
    """Assert that a path without a file is refused by name, and that the largest file is read."""
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(FlexidError, match=path.name):
            TOML[what](path)
    assert "larger than" not in refusal(tmp_path / "a.toml", b"#" * MAX_BYTES, TOML[what])


@pytest.mark.parametrize("raw", [b"[" * 200_000, b'{"a":' * 100_000], ids=["lists", "objects"])
def test_an_estimate_nested_deep(raw: bytes, tmp_path: Path):
    """Assert that JSON nested a hundred thousand levels deep is no estimate."""
    assert "is not JSON" in refusal(tmp_path / "estimate.json", raw, read_estimate)


def test_logs_that_are_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that very many columns, and a file that grows while it is read, are refused."""
    header = ",".join(f"c{number}" for number in range(160_000))
    rows = "\n" + ",".join("1" * 160_000)
    message = refusal(tmp_path / "log.csv", (header + 2 * rows).encode(), read_log)
    assert "line 1: the line has more than 1000000 bytes" in message
    header = ",".join(f"c{number}" for number in range(20_000))
    rows = "\n" + ",".join("1" * 20_000)
    message = refusal(tmp_path / "log.csv", (header + 3 * rows).encode(), read_log)
    assert "there are 20000 columns of 3 rows, more than are read at once" in message
    (tmp_path / "log.csv").write_text("time,motor_position\n" + "0,1\n" * 100)
    monkeypatch.setattr(files, "check_file", lambda *_: 100)
    with pytest.raises(FlexidError, match="the file grows while it is read"):
        read_log(tmp_path / "log.csv")
