"""Formats of files, and the child process that reads them: a log or one sentence."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from tests.recording.joint_log import refused

from flexid.errors import RecordingError
from flexid.readers import formats, guard
from flexid.readers.formats import FORMATS, Format, format_of, kinds, looks_like, suffixes
from flexid.readers.guard import Limits, Reading
from flexid.recording.read import table_of_file, tables_of_file

GOOD = """
import polars as pl
from flexid.readers.formats import Contents, RefusedError, Series

def table():
    time = [0.01 * k for k in range(100)]
    return pl.DataFrame({"time": time, "motor_position": time, "link_position": time})
"""
PARTS = """
def read(path):
    def frames(paths, size):
        for start in range(0, 100, size):
            if start >= 50:
                fail()
            yield "", table()[start:start + size].select(paths)
    return Contents([Series(name, "", 100) for name in table().columns], frames, is_table=True)
"""
Readers = Callable[[str], Path]


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Readers:
    """Register a reader of ``.odd`` files by its source, and write such a file."""
    name = f"odd_{abs(hash(tmp_path))}"
    folder = tmp_path / "modules"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    odd = Format("Odd", "an odd file", (".odd",), name, (), "odd")
    monkeypatch.setattr(formats, "FORMATS", [*formats.FORMATS, odd])
    monkeypatch.setattr(guard, "LIMITS", Limits(400_000_000, 5.0, 2.0, 10_000_000, 1_000_000))

    def register(source: str) -> Path:
        (folder / f"{name}.py").write_text(GOOD + source)
        path = tmp_path / "log.odd"
        path.write_bytes(b"anything")
        return path

    return register


def test_one_function_and_one_line(reader: Readers):
    """Assert that a function `read` and a registration are a format, even if a library prints."""
    source = "import os\ndef read(path):\n    print('{'); os.write(1, b'noise'); return table()"
    table = table_of_file(reader(source), None)
    assert table.names == ("time", "motor_position", "link_position")
    assert table.frame["motor_position"].to_list() == [0.01 * k for k in range(100)]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("import os; os.kill(os.getpid(), 11)", "not an odd file that can be read"),
        ("import os; os._exit(0)", "not an odd file that can be read"),
        ("raise KeyError('x')", "not an odd file that can be read"),
        ("return 3", "not an odd file that can be read"),
        ("return bytearray(10**12)", "exceeds the limit of memory or time"),
        (
            "kept = []\n    while True: kept.append(bytearray(10**7))",
            "exceeds the limit of memory or time",
        ),
        ("deep = lambda: deep()\n    deep()", "not an odd file that can be read"),
        ("import time; time.sleep(900)", "the limit of memory or time"),
        ("while True: pass", "the limit of memory or time"),
        ("raise RefusedError('page 3', 'it is torn: export it again')", "page 3: it is torn"),
        ("import no_such_package", "read by no_such_package, which is not installed: pip install "),
        ("return pl.DataFrame({'time': [1.0], 'big': ['x' * 20_000_000]})", "no motor_position"),
    ],
    ids=lambda value: value[:30],
)
def test_what_a_reader_may_do(reader: Readers, body: str, words: str, monkeypatch: Any):
    """Assert that a crash, excessive memory, a hang and an error give one sentence."""
    if words == "the limit of memory or time":  # a hang, stopped after the time limit
        monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(silence=1.0, processor=1.0))
    assert words in refused(table_of_file, reader(f"def read(path):\n    {body}"), None)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("import os; os.abort()", "row 51 or after: the file cannot be read further"),
        ("raise ValueError('two\\nlines')", "row 51 or after: the file cannot be read further"),
        ("raise RefusedError('row 7', 'it is torn: mend it')", "row 7: it is torn: mend it"),
        ("while True: pass", "the limit of memory or time"),
        ("return bytearray(10**12)", "exceeds the limit of memory or time"),
    ],
    ids=lambda value: value[:30],
)
def test_what_a_reader_may_do_later(reader: Readers, body: str, words: str):
    """Assert that earlier parts are returned, and then one sentence."""
    path = reader(f"def fail():\n    {body}\n{PARTS}")
    tables = tables_of_file(path, None, 25)
    assert [next(tables).frame.height for _ in range(2)] == [25, 25]
    with pytest.raises(RecordingError, match=words):
        next(tables)


def test_too_much_at_once(reader: Readers):
    """Assert that a result or a file beyond a limit of bytes is refused."""
    source = "def read(path):\n    return pl.concat([table()] * 10_000)"
    assert "exceeds the limit of memory or time" in refused(table_of_file, reader(source), None)
    path = reader("")
    with path.open("wb") as file:
        file.truncate(2_000_000)
    assert "the file is larger than 1 MB" in refused(table_of_file, path, None)


def test_a_child_ends_with_its_reading(reader: Readers):
    """Assert that no process remains after reading, complete or not."""
    path = reader("def read(path): return table()")
    with Reading(path) as reading:
        next(reading.frames(["time"], 10))
    assert reading._process.returncode is not None
    tables = tables_of_file(path, None, 10)
    next(tables)
    tables.close()


def test_modules_beside_a_log_are_not_run(here: Path):
    """Assert that modules in the folder of a log are not imported."""
    pl.DataFrame({"time": [0.0], "motor_position": [0.0]}).write_parquet(here / "a.parquet")
    (here / "json.py").write_text("open('was_run', 'w')")
    Reading(Path("a.parquet")).close()
    assert not (here / "was_run").exists()


@pytest.mark.parametrize(
    ("package", "name", "extra"),
    [("h5py", "a.h5", "hdf5"), ("asammdf", "a.mf4", "mdf"), ("rosbags", "a.bag", "ros")],
)
def test_without_a_package(tmp_path: Path, monkeypatch: Any, package: str, name: str, extra: str):
    """Assert that a missing library is reported with its extra."""
    stub = f"raise ModuleNotFoundError('no', name={package!r})"
    (tmp_path / f"{package}.py").write_text(stub)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / name).write_bytes(b"anything")
    words = f"read by {package}, which is not installed: pip install 'flexid[{extra}]'"
    assert words in refused(table_of_file, tmp_path / name, None)


PAGE = Path(__file__).parents[2] / "docs" / "logs.md"


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_a_format(one: Format):
    """Assert that a format has a function, its own suffixes, and a row in the docs."""
    assert callable(import_module(one.module).read)
    for suffix in one.suffixes:
        assert format_of(Path(f"log{suffix.upper()}")) == one
        assert sum(suffix in other.suffixes for other in FORMATS) == 1
        assert f"`{suffix}`" in PAGE.read_text(encoding="utf-8").partition("\n## Other formats")[2]
    assert one.name in kinds()
    assert {*one.suffixes} <= {*suffixes()}
    assert all(looks_like(magic + b"more") == one for magic in one.magic)


def test_what_is_no_format(tmp_path: Path):
    """Assert that other files are text, and that a folder has the format of the bags in it."""
    assert format_of(Path("log.csv")) is None
    assert looks_like(b"time,motor_position\n") is None
    assert format_of(tmp_path) is None
    (tmp_path / "a.db3").write_bytes(b"")
    found = format_of(tmp_path)
    assert found is not None
    assert found.name == "ROS 2 bag"
