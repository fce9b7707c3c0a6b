"""What the elements of a MATLAB file say, before SciPy believes it."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import scipy.io.matlab
import scipy.sparse
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import loadmat, savemat

from flexid.errors import RecordingError
from flexid.recording import read_log
from flexid.recording.matlab_elements import DamagedError, check_elements

WRITTEN = sorted((Path(scipy.io.matlab.__file__).parent / "tests" / "data").glob("*.mat"))
"""Files that many versions of MATLAB wrote, which SciPy brings along to test itself."""

VALUES = {
    "vector": np.arange(5.0),
    "complex": np.array([1 + 2j, 3]),
    "text": "abc",
    "letters": "äöü",
    "cells": np.array([1, "a", [1, 2, 3]], dtype=object),
    "struct": {"x": 1, "y": {"z": np.zeros((3, 4))}},
    "sparse": scipy.sparse.csc_matrix(np.eye(4)),
    "empty": np.zeros((0, 3)),
    "no fields": {},
    "logical": np.array([True, False]),
    "three": np.zeros((2, 3, 4), dtype=np.uint8),
}


@pytest.mark.skipif(not WRITTEN, reason="this SciPy came without its tests")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.stem)
def test_what_scipy_reads_is_let_through(path: Path):
    """Assert that no file that MATLAB wrote and SciPy reads is refused."""
    try:
        loadmat(path)
    except Exception:
        return
    check_elements(path)


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize("compressed", [False, True])
def test_what_scipy_writes_is_let_through(name: str, compressed: bool, tmp_path: Path):
    """Assert that every kind of value passes, compressed or not."""
    savemat(tmp_path / "a.mat", {"a": VALUES[name]}, do_compression=compressed)
    check_elements(tmp_path / "a.mat")


def with_type(tmp_path: Path, kind: int) -> Path:
    """A file whose numbers are said to be of a type."""
    path = tmp_path / "a.mat"
    savemat(path, {"a": np.arange(100.0)})
    raw = bytearray(path.read_bytes())
    place = raw.index((9).to_bytes(4, "little") + (800).to_bytes(4, "little"))
    raw[place : place + 4] = kind.to_bytes(4, "little")
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize("kind", [0, 8, 14, 20, 1000])
def test_types_that_are_none(kind: int, tmp_path: Path):
    """Assert that numbers of a type that numbers cannot have are refused."""
    check_elements(with_type(tmp_path, 9))
    with pytest.raises(DamagedError):
        check_elements(with_type(tmp_path, kind))
    with pytest.raises(RecordingError, match="no MATLAB file that can be read"):
        read_log(tmp_path / "a.mat")


def test_what_it_saves_from(tmp_path: Path):
    """Assert that SciPy's process ends where the type is beyond its table."""
    path = with_type(tmp_path, 60_000)
    code = f"import scipy.io; scipy.io.loadmat({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode != 0
    with pytest.raises(DamagedError):
        check_elements(path)


def changed(tmp_path: Path, value: object, old: bytes, new: bytes) -> Path:
    """A file with some bytes replaced."""
    path = tmp_path / "a.mat"
    savemat(path, {"a": value})
    raw = path.read_bytes()
    assert raw.count(old) >= 1
    path.write_bytes(raw.replace(old, new, 1))
    return path


def number(*values: int) -> bytes:
    """Numbers of four bytes."""
    return b"".join(value.to_bytes(4, "little", signed=True) for value in values)


@pytest.mark.parametrize(
    ("value", "old", "new"),
    [
        ({"x": 1}, number(1, 1), number(2**30, 1)),  # structs without end
        ({"x": 1}, number(1, 1), number(-1, 1)),
        (VALUES["cells"], number(1, 3), number(2**20, 2**10)),
        (np.arange(5.0), number(5, 8), number(5, 2**31 - 1)),  # dimensions
        (np.arange(5.0), number(5, 8), number(5, 7)),
        (np.arange(5.0), number(6, 8), number(6, 4)),  # flags
        (np.arange(5.0), number(6, 8), number(9, 8)),
    ],
)
def test_sizes_that_are_none(value: object, old: bytes, new: bytes, tmp_path: Path):
    """Assert that what does not fit into where it stands is refused."""
    with pytest.raises(DamagedError):
        check_elements(changed(tmp_path, value, old, new))


def test_an_element_larger_than_its_file(tmp_path: Path):
    """Assert that for an element that says that it has gigabytes no memory is reserved."""
    savemat(tmp_path / "a.mat", {"a": np.arange(5.0)})
    raw = bytearray((tmp_path / "a.mat").read_bytes())
    raw[132:136] = (2**32 - 1).to_bytes(4, "little")
    (tmp_path / "a.mat").write_bytes(raw)
    tracemalloc.start()
    try:
        with pytest.raises(DamagedError):
            check_elements(tmp_path / "a.mat")
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_nested_deep(tmp_path: Path):
    """Assert that structs in structs end at a depth."""
    value: object = 1.0
    for _ in range(20):
        value = {"a": value}
    savemat(tmp_path / "a.mat", {"a": value})
    with pytest.raises(DamagedError):
        check_elements(tmp_path / "a.mat")


@settings(
    deadline=None,
    max_examples=150,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.integers(128, 600), st.binary(min_size=1, max_size=4), st.sampled_from(sorted(VALUES)))
def test_any_damage(tmp_path: Path, start: int, patch: bytes, name: str):
    """Assert that of a damaged file nothing is raised but that it is damaged."""
    path = tmp_path / "a.mat"
    savemat(path, {"a": VALUES[name]})
    raw = bytearray(path.read_bytes())
    start = 128 + (start - 128) % (len(raw) - 128)
    raw[start : start + len(patch)] = patch
    path.write_bytes(raw)
    try:
        check_elements(path)
    except DamagedError:
        return
    assert path.exists()
