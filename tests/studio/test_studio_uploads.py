"""Logs that are sent to the studio."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from flexid.studio import guard
from flexid.studio.guard import UploadError, safe_name, save


async def chunks(*parts: bytes) -> AsyncIterator[bytes]:
    """Return what a browser sends."""
    for part in parts:
        yield part


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("run 1.csv", "run 1.csv"),
        ("../../etc/passwd.csv", "passwd.csv"),
        ("..\\..\\windows\\log.CSV", "log.CSV"),
        ("<script>alert(1)</script>.csv", "script_.csv"),
        ("....csv", "log.csv"),
        ("-rf.parquet", "rf.parquet"),
        ("a\0b\n\u202e.csv", "a_b__.csv"),
        ("x" * 500 + ".csv", "x" * 80 + ".csv"),
        ("Messung März.csv", "Messung M_rz.csv"),
    ],
)
def test_names_are_plain(name: str, safe: str):
    """Assert that a name from outside leads nowhere and holds nothing but plain characters."""
    assert safe_name(name) == safe


@pytest.mark.parametrize("name", ["", "passwd", "log.exe", "log.csv/", "log.html", ".csv.sh"])
def test_other_kinds_are_refused(name: str):
    """Assert that only logs are taken."""
    with pytest.raises(UploadError, match="whose names end in"):
        safe_name(name)


def test_a_full_disk_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that logs do not fill the disk."""
    monkeypatch.setattr(guard, "LEAST_FREE", 10**18)
    with pytest.raises(UploadError, match="disk"):
        asyncio.run(save(chunks(b"1"), "a.csv", tmp_path))


@pytest.mark.parametrize(("parts", "status"), [((b"12345", b"678901"), 413), ((), 400)])
def test_size_is_bounded(
    parts: tuple[bytes, ...], status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Assert that too much, and nothing, is refused, and the log in use stays whole."""
    monkeypatch.setattr(guard, "LARGEST_UPLOAD", 10)
    before = asyncio.run(save(chunks(b"time", b",q\n"), "a.csv", tmp_path))
    assert before == tmp_path / "a.csv"
    with pytest.raises(UploadError) as caught:
        asyncio.run(save(chunks(*parts), "a.csv", tmp_path))
    assert caught.value.status == status
    assert before.read_bytes() == b"time,q\n"
    assert [*tmp_path.iterdir()] == [before]
