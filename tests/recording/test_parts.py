"""Logs that are read in parts, for whoever plays them again: as they are when read whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import polars as pl
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from flexid.errors import RecordingError
from flexid.recording import turns
from flexid.recording.series import table_of_file, tables_of_file

BEGIN = 1_700_000_000_000_000_000  # ns
STEP = 5_000_000  # ns
TIMES = np.arange(2000)
MOTOR = 1.5 * np.sin(0.02 * TIMES) + 0.4 * np.sin(0.053 * TIMES)
LINK = MOTOR + 0.05 * np.sin(0.037 * TIMES)
TORQUE = 20.0 * np.sin(0.02 * TIMES)
NAMES = {"motor_position": MOTOR, "link_position": LINK, "motor_torque": TORQUE}

Messages = list[tuple[str, int, dict[str, Any]]]


def together(stamps: np.ndarray) -> Messages:
    """All channels in one message, with its time in ns."""
    return [
        ("/drive", int(stamps[k]), {name: float(of[k]) for name, of in NAMES.items()})
        for k in TIMES
    ]


def apart(delay: int, every: int = 1) -> Messages:
    """The encoders and the torque in two topics, the torque so many ns later."""
    messages = []
    for k in TIMES:
        stamp = BEGIN + STEP * int(k)
        if k % every == 0:
            both = {name: float(NAMES[name][k]) for name in ("motor_position", "link_position")}
            messages.append(("/encoders", stamp, both))
        messages.append(("/torque", stamp + delay, {"motor_torque": float(TORQUE[k])}))
    return messages


def written(path: Path, messages: Messages, **options: Any) -> Path:
    """An MCAP file of JSON messages, in the order in which they stand."""
    import json

    with path.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType.LZ4, **options)
        writer.start()
        channels: dict[str, int] = {}
        for topic, stamp, message in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            writer.add_message(channels[topic], stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    return path


def joined(path: Path, size: int) -> tuple[pl.DataFrame, list[int], set[str]]:
    """What the parts hold together, how many rows each has, and what was warned of."""
    tables = list(tables_of_file(path, None, size))
    rows = [table.first_row for table in tables]
    counts = [table.frame.height for table in tables]
    assert rows == (1 + np.cumsum([0, *counts[:-1]])).tolist()
    return (
        pl.concat([table.frame for table in tables]),
        counts,
        {warning for table in tables for warning in table.warnings},
    )


def rows_before(path: Path, words: str) -> int:
    """How many rows come before the error that ends the parts."""
    rows: list[int] = []
    with pytest.raises(RecordingError, match=words):
        rows.extend(table.frame.height for table in tables_of_file(path, None, 100))
    return sum(rows)


def assert_close(found: pl.DataFrame, right: pl.DataFrame, tolerance: float = 1e-9) -> None:
    """Assert that two tables hold the same."""
    assert found.columns == right.columns
    for name in right.columns:
        np.testing.assert_allclose(found[name], right[name], rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("size", [70, 500, 10_000])
def test_one_clock(tmp_path: Path, size: int):
    """Assert that messages of one topic are those of the whole file, a part at a time."""
    path = written(tmp_path / "log.mcap", together(BEGIN + STEP * TIMES))
    found, counts, _ = joined(path, size)
    assert_close(found, table_of_file(path, None).frame, 0.0)
    assert max(counts[:-1], default=0) <= size


@pytest.mark.parametrize("size", [300, 700])
@pytest.mark.parametrize(("delay", "every"), [(2_000_000, 1), (1_000_000, 4)])
def test_several_clocks(tmp_path: Path, size: int, delay: int, every: int):
    """Assert that channels are brought to one clock as in the whole file, filtered or not."""
    path = written(tmp_path / "log.mcap", apart(delay, every))
    found, counts, _ = joined(path, size)
    assert_close(found, table_of_file(path, None).frame, 1e-8)
    assert len(counts) > 1


def test_a_clock_that_pauses_holds_nobody_up(tmp_path: Path):
    """Assert that a topic that is silent for long leaves a gap, and that no more is kept for it."""
    quiet = (BEGIN + 300 * STEP, BEGIN + 1700 * STEP)
    messages = [m for m in apart(0) if m[0] != "/torque" or not quiet[0] < m[1] < quiet[1]]
    path = written(tmp_path / "log.mcap", messages)
    found, _, _ = joined(path, 50)
    assert_close(found, table_of_file(path, None).frame, 1e-8)


@pytest.mark.parametrize("block", [500, 2000])
@pytest.mark.parametrize("torque_first", [False, True])
def test_topics_in_large_blocks(tmp_path: Path, block: int, torque_first: bool):
    """Assert that topics that stand far apart in the file lose no row, and little is kept."""
    topics: dict[str, Messages] = {"/encoders": [], "/torque": []}
    for message in apart(2_000_000):
        topics[message[0]].append(message)
    messages = []
    for first in range(0, len(TIMES), block):
        for name in sorted(topics, reverse=torque_first):
            messages += topics[name][first : first + block]
    path = written(tmp_path / "log.mcap", messages)
    found, counts, warnings = joined(path, 40)
    assert_close(found, table_of_file(path, None).frame, 1e-8)
    assert len(counts) > 40
    assert not any("left out" in warning for warning in warnings)


def test_topics_too_far_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that no more waits for a topic that stands far behind than a limit."""
    monkeypatch.setattr(turns, "_MOST", 1000)
    messages = sorted(apart(2_000_000), key=lambda message: message[0])
    path = written(tmp_path / "log.mcap", messages)
    assert rows_before(path, "stands more than 1000 values behind another") == 0


def test_topics_that_never_overlap(tmp_path: Path):
    """Assert that they are refused in parts, too."""
    messages = apart(10**11)
    path = written(tmp_path / "log.mcap", sorted(messages, key=lambda message: message[0]))
    for size in (50, 100_000):
        with pytest.raises(RecordingError, match="no times in common"):
            joined(path, size)


def test_one_stamp_in_the_future(tmp_path: Path):
    """Assert that it takes none of the samples after it with it."""
    stamps = BEGIN + STEP * TIMES
    stamps[300] += 10**18
    path = written(tmp_path / "log.mcap", together(stamps))
    found, _, warnings = joined(path, 100)
    assert_close(found, table_of_file(path, None).frame, 0.0)
    assert not any("stand behind" in warning for warning in warnings)


@pytest.mark.parametrize(("by", "lost"), [(150, 0), (800, 1)])
def test_messages_that_overtook_each_other(tmp_path: Path, by: int, lost: int):
    """Assert that those of a little are put in order, and one of much is left out and said."""
    messages = together(BEGIN + STEP * TIMES)
    messages.insert(900 + by, messages.pop(900))
    path = written(tmp_path / "log.mcap", messages)
    found, _, warnings = joined(path, 100)
    right = np.delete(MOTOR, 900) if lost else MOTOR
    np.testing.assert_array_equal(found["/drive.motor_position"], right)
    assert any("stand behind 200 later ones are left out" in w for w in warnings) is bool(lost)


def test_what_is_damaged_in_the_middle(tmp_path: Path):
    """Assert that what comes before the damage is read, and the whole is refused."""
    path = written(tmp_path / "log.mcap", together(BEGIN + STEP * TIMES), chunk_size=5_000)
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2 : len(raw) // 2 + 2000] = b"\xff" * 2000
    path.write_bytes(raw)
    words = r"row \d+ or after: the file cannot be read on from there"
    assert 500 < rows_before(path, words) < 1500
    with pytest.raises(RecordingError, match=words):
        table_of_file(path, None)


def test_damage_that_the_parts_do_not_meet(tmp_path: Path):
    """Assert that messages of another topic which cannot be read are said after all parts."""
    messages = together(BEGIN + STEP * TIMES)
    messages.insert(700, ("/other", BEGIN, {"a": 1.0}))
    path = written(tmp_path / "log.mcap", messages, use_chunking=False)
    path.write_bytes(path.read_bytes().replace(b'{"a": 1.0}', b'{"a": 1.0['))
    assert rows_before(path, "row 2001 or after: the file cannot be read on") == len(TIMES)


def test_a_message_without_its_number(tmp_path: Path):
    """Assert that it is named by its place in the whole file, after what comes before it."""
    messages = together(BEGIN + STEP * TIMES)
    del messages[1500][2]["link_position"]
    path = written(tmp_path / "log.mcap", messages)
    assert rows_before(path, "message 1501 of '/drive': it has no") == 1500


@pytest.mark.parametrize(("wraps", "words"), [(False, ""), (True, "absolute encoder")])
def test_an_encoder_at_rest_is_none_that_wraps(tmp_path: Path, wraps: bool, words: str):
    """Assert that noise about nothing is interpolated, and the jump of an encoder is refused."""
    messages = [m for k, m in enumerate(apart(2_000_000)) if k % 4 != 3]  # a slow torque
    noise = 1e-3 * np.random.default_rng(3).integers(-2, 3, len(messages))
    rest = [m for m in messages if m[1] < BEGIN + 1200 * STEP]
    for (_, _, message), off in zip(rest, noise, strict=False):
        if "motor_position" in message:
            message |= {"motor_position": MOTOR[1200] + off, "link_position": LINK[1200] + off}
    if wraps:
        for _, _, message in messages[len(rest) :]:
            if "motor_position" in message:
                message["motor_position"] = float(np.mod(4.0 * message["motor_position"], 6.28))
    path = written(tmp_path / "log.mcap", messages)
    if words:
        with pytest.raises(RecordingError, match=words):
            joined(path, 300)
    else:
        assert joined(path, 300)[0].height > 990


def test_hdf5(tmp_path: Path):
    """Assert that arrays are read as many rows at a time as are asked for, each alike."""
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["time"] = 0.005 * TIMES
        file["positions"] = np.column_stack((MOTOR, LINK))
        file["motor_torque"] = TORQUE
    columns = {"motor_position": "positions[:,0]", "link_position": "positions[:,1]"}
    columns = {name: {"column": of, "unit": "rad"} for name, of in columns.items()}
    parts = [table.frame for table in tables_of_file(path, columns, 300)]
    assert [part.height for part in parts] == [300] * 6 + [200]
    assert_close(pl.concat(parts), table_of_file(path, columns).frame, 0.0)


def test_arrays_with_another_time_beside_them(tmp_path: Path):
    """Assert that what has other times is refused in the part where they differ."""
    path = tmp_path / "log.h5"
    other = 0.005 * TIMES
    other[1000] += 1e-3
    with h5py.File(path, "w") as file:
        file["time"] = 0.005 * TIMES
        file["motor_position"], file["link_position"] = MOTOR, LINK
        file["drive/time"], file["drive/motor_torque"] = other, TORQUE
    columns = {"time": {"column": "time"}}
    rows: list[int] = []
    with pytest.raises(RecordingError, match="its times stand in 'drive/time' and differ"):
        rows.extend(table.frame.height for table in tables_of_file(path, columns, 300))
    assert sum(rows) == 900
