"""A small synthetic log, functions that write and read it, and messages of refusal."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording import Log, Recording
from flexid.recording.frame import table_of_arrays
from flexid.recording.read import log_of_table
from flexid.recording.recording import CHANNELS, rank_of

Columns = Mapping[str, FloatArray]
Change = Callable[[str], str]


def joint_columns(count: int = 400, sample_time: float = 0.005) -> dict[str, FloatArray]:
    """Canonical columns of a smooth, plausible motion, in SI units."""
    time = sample_time * np.arange(count, dtype=np.float64)
    motor = np.sin(2.0 * time) + 0.4 * np.sin(5.3 * time + 0.5)
    motor_velocity = 2.0 * np.cos(2.0 * time) + 2.12 * np.cos(5.3 * time + 0.5)
    deflection = 0.05 * np.sin(3.7 * time + 1.0)
    return {
        "time": time,
        "link_position": motor + deflection,
        "motor_position": motor,
        "link_velocity": motor_velocity + 0.185 * np.cos(3.7 * time + 1.0),
        "motor_velocity": motor_velocity,
        "motor_torque": 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time),
    }


def without(columns: Columns, *words: str) -> dict[str, FloatArray]:
    """Return the columns whose names contain none of these words."""
    return {name: v for name, v in columns.items() if not any(word in name for word in words)}


def csv_text(columns: Mapping[str, Any], separator: str = ",") -> str:
    """Return columns as CSV text with all digits."""
    rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
    lines = [separator.join(columns), *(separator.join(map(str, row)) for row in rows)]
    return "\n".join(lines) + "\n"


def written(
    folder: Path, content: str | bytes, encoding: str = "utf-8", name: str = "log.csv"
) -> Path:
    """Write a text, or bytes, to a file and return its path."""
    path = folder / name
    path.write_bytes(content.encode(encoding) if isinstance(content, str) else content)
    return path


def read_columns(columns: Mapping[str, Any], column_map: Any = None) -> Log:
    """Return the log of columns in memory."""
    return log_of_table(table_of_arrays(columns), column_map)


def refused(read: Callable[..., object], *arguments: Any) -> str:
    """Return the message of a refusal, which is one line that begins with the file."""
    with pytest.raises(RecordingError) as caught:
        read(*arguments)
    message = str(caught.value)
    assert message.startswith(caught.value.file)
    assert "\n" not in message
    return message


def said(read: Callable[..., Log], *arguments: Any) -> str:
    """Return the message of a refusal, or a summary of recordings and warnings."""
    try:
        log = read(*arguments)
    except RecordingError as error:
        return str(error)
    warnings = [f"{rank_of(text).name}: {text}" for text in log.warnings]
    return " | ".join([*map(shown, log.recordings), *warnings])


def shown(recording: Recording) -> str:
    """Return a recording's grid and the RMS of each channel in one line."""
    found = {name: getattr(recording, name) for name in CHANNELS}
    sizes = {name: np.sqrt(np.mean(v**2)) for name, v in found.items() if v is not None}
    begin, step = recording.start_time, recording.sample_time
    grid = f"{len(recording)} samples from {begin:.6g} s in steps of {step:.6g} s"
    channels = [f"{name} {size:.5g}" for name, size in sizes.items()]
    return ", ".join([f"<{grid}", *channels, f"{recording.input_unit}>"])


def assert_equal_logs(one: Log, other: Log, rtol: float = 0.0) -> None:
    """Assert that two logs have the same recordings."""
    for a, b in zip(one.recordings, other.recordings, strict=True):
        assert a.sample_time == pytest.approx(b.sample_time, rel=1e-12)
        assert a.start_time == pytest.approx(b.start_time, rel=1e-12)
        assert a.input_unit == b.input_unit
        for name in CHANNELS:
            left, right = getattr(a, name), getattr(b, name)
            assert (left is None) == (right is None)
            if left is not None:
                np.testing.assert_allclose(left, right, rtol=rtol, atol=rtol)
