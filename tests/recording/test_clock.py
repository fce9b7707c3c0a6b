"""Times as time stamps, times of day, and numbers with a large offset."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest
from joint_log import csv_text, joint_columns, read_columns, said, written

from flexid.arrays import FloatArray
from flexid.recording import Log, read_log
from flexid.recording.columns import channels_of, recipes_of
from flexid.recording.frame import table_of_arrays, table_of_frame
from flexid.recording.read import log_of_table, tables_of_file
from flexid.recording.table import Clock, Table
from flexid.streaming.incoming import Replay

COUNT, STEP = 400, timedelta(microseconds=200)  # 5 kHz; as floats since 1970 steps err by 0.1 %
BEGIN = datetime(2024, 5, 1, 23, 59, 59, 950_000, tzinfo=UTC)  # across midnight
COLUMNS = joint_columns(COUNT, STEP.total_seconds())
HOUR = timedelta(hours=1)
CELLS = {name: values.tolist() for name, values in COLUMNS.items() if name != "time"}
FORMS: dict[str, Callable[[datetime], str]] = {
    "iso": lambda t: t.isoformat(),  # without a fraction if it is zero
    "iso, Z": lambda t: t.isoformat().replace("+00:00", "Z"),
    "iso, summer": lambda t: (t + 2 * HOUR).isoformat().replace("+00:00", "+0200"),
    "blank": lambda t: f"{t:%Y-%m-%d %H:%M:%S.%f}",
    "blank, UTC": lambda t: f"{t:%Y-%m-%d %H:%M:%S.%f} UTC",
    "comma": lambda t: f"{t:%Y-%m-%dT%H:%M:%S,%f}",
    "slashes": lambda t: f"{t:%Y/%m/%d %H:%M:%S.%f}",
    "days first": lambda t: f"{t:%d.%m.%Y %H:%M:%S.%f}",
    "names of months": lambda t: f"{t:%d-%b-%Y %H:%M:%S.%f}",
    "nanoseconds": lambda t: f"{t:%Y-%m-%dT%H:%M:%S.%f}125",
    "days before it": lambda t: f"{t.day - 1} days {t:%H:%M:%S.%f}",
    "time of day": lambda t: f"{t:%H:%M:%S.%f}".lstrip("0") if t.hour else f"{t:%H:%M:%S.%f}",
}
MOMENTS = [BEGIN + k * STEP for k in range(COUNT)]
ISO, DAYS_FIRST = ([*map(FORMS[form], MOMENTS)] for form in ("iso", "days first"))


def text_of(stamps: list[str], header: str = "time") -> str:
    """Return the log with these time stamps, separated by semicolons."""
    return csv_text({header: stamps, **CELLS}, ";")


def assert_is_the_log(log: Log) -> None:
    """Assert that time starts at zero exactly, and that the samples are those of the log."""
    (recording,) = log.recordings
    assert recording.start_time == 0.0
    assert recording.sample_time == pytest.approx(2e-4, rel=1e-12)
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])


def since_1970(places: int) -> list[str]:
    """Return nanoseconds with a decimal point before the last places."""
    ticks = [f"{1_714_607_999_950_000_000 + 200_000 * k}" for k in range(COUNT)]
    return [f"{t[: len(t) - places]}.{t[len(t) - places :]}".removesuffix(".") for t in ticks]


COMMAS = {n: [str(value).replace(".", ",") for value in values] for n, values in CELLS.items()}
SECONDS = {"sec": [1_714_607_999 + k // 5000 for k in range(COUNT)]}
NANOSECONDS = {"nanosec": [200_000 * (k % 5000) for k in range(COUNT)]}
ADDED = {"time": {"sum": ["sec", {"column": "nanosec", "scale": 1e-9}]}}
HEADERS = ("timestamp [UTC]", "Date Time", "date/time", "DateTime (ISO)")  # without a unit
PLACES = {"s": 9, "ms": 6, "us": 3, "ns": 0}
SAME: dict[str, tuple[str, dict[str, Any] | None]] = {  # texts, and column maps
    **{form: (text_of([*map(FORMS[form], MOMENTS)]), None) for form in FORMS},
    **{header: (text_of(ISO, header), None) for header in HEADERS},
    "decimal commas": (csv_text({"time": DAYS_FIRST, **COMMAS}, ";"), None),
    "a name in a map": (text_of(ISO), {"time": "time"}),
    "two columns": (csv_text(SECONDS | NANOSECONDS | COLUMNS), ADDED),
    **{u: (text_of(since_1970(places), f"time [{u}]"), None) for u, places in PLACES.items()},
    "s, commas": (text_of(since_1970(9), "time [s]").replace(".", ","), None),
    "whole us": (text_of([t[:16] for t in since_1970(0)], "time [us]"), None),
}


@pytest.mark.parametrize("name", SAME)
def test_times_are_seconds_from_the_first(tmp_path: Path, name: str):
    """Assert that times are exact in any format and by any name, across midnight too."""
    text, column_map = SAME[name]
    assert_is_the_log(read_log(written(tmp_path, text), column_map))


LATE = [t + 13 * HOUR * (k >= 200) for k, t in enumerate(MOMENTS)]
DECIMALS = [f"{1_714_557_600 + k // 5_000}.{2 * (k % 5_000):04d}" for k in range(COUNT)]


EIGHTH = {  # one among valid ones, in line 9: formats, zones and centuries must agree
    **dict.fromkeys(
        ["", "2024-05-01", "2024-05-01 23:59:59.9514", "2024-05-01T23:59:59.9514"], ISO
    ),
    "0.0014": ISO,
    "2024-02-30T23:59:59.9514+00:00": ISO,
    "9024-05-01T23:59:59.9514+00:00": ISO,
    **dict.fromkeys([" ", "17145576x0.5", "1714557600.1.2", "nan"], DECIMALS),
}
NONE_IS_READ: dict[str, list[Any]] = {
    "stamps that repeat": [f"{t:%Y-%m-%dT%H:%M:%S}" for t in MOMENTS],
    "a clock that is set back": [*map(FORMS["iso"], (t - HOUR * (t.minute == 0) for t in MOMENTS))],
    "no zeros": [f"{t:%H:%M:%S}.{t.microsecond // 100}" for t in MOMENTS],
    "half a day": [f"{t:%H:%M:%S.%f}" for t in LATE],
    "half a day in Parquet": [t.time() for t in LATE],
    "minutes": [f"{t:%M:%S.%f}" for t in MOMENTS],
    "no marks": [f"{t:%Y%m%dT%H%M%S.%f}" for t in MOMENTS],
    "American": [f"{t:%m/%d/%Y %I:%M:%S.%f %p}" for t in MOMENTS],
    "a thirteenth month": ["2024-13-01T10:00:00"] * COUNT,
    "a leap second": ["23:59:60"] * COUNT,
    "a point at the end": ["2024-05-01T10:00:00."] * COUNT,
    "hyphens": ["01-05-2024 10:00:00"] * COUNT,
    "dates in Parquet": [t.date() for t in MOMENTS],
    **{f"an eighth {cell!r}": [*all_[:7], cell, *all_[8:]] for cell, all_ in EIGHTH.items()},
    "empty cells first": ["", " ", *ISO[2:]],
}


COMPUTED: list[dict[str, object]] = [
    *({"column": "time", **one} for one in ({"scale": 2}, {"offset": 1}, {"unit": "ms"})),
    {"sum": ["time", "motor_torque"]},
]


def test_stamps_that_do_not_do(here: Path, golden: Any):
    """Assert that unreadable or decreasing time stamps are named with a remedy."""

    def log(stamps: list[Any]) -> Log:
        if isinstance(stamps[0], str):
            return read_log(written(Path(), text_of(stamps)))
        return log_of_table(table_of_frame(pl.DataFrame({"time": stamps} | CELLS)))

    found = {name: said(log, stamps) for name, stamps in NONE_IS_READ.items()}
    for entry in COMPUTED:
        found[f"a map {entry}"] = said(read_log, written(Path(), text_of(ISO)), {"time": entry})
    ticks = np.where(np.arange(COUNT) == 7, np.timedelta64("NaT", "ms"), np.arange(COUNT))
    found["no time"] = said(read_columns, {"time": ticks} | CELLS)
    golden(found)


TIMES = pl.Series("time", MOMENTS)
TICKS = [int(tick) for tick in since_1970(0)]
TYPES = {
    "nanoseconds": TIMES.dt.replace_time_zone(None).cast(pl.Datetime("ns")),
    "microseconds": TIMES.dt.replace_time_zone(None),
    "a zone": TIMES.dt.convert_time_zone("Europe/Vienna"),
    "times of day": TIMES.dt.time(),
    "durations": TIMES - MOMENTS[0],
    "text": TIMES.dt.to_string("iso"),
    "decimals": pl.Series("time", DECIMALS).cast(pl.Decimal(18, 6)),
    "whole ns": pl.Series("time [ns]", TICKS),
    "whole us": pl.Series("time [us]", [tick // 1000 for tick in TICKS]),
}


@pytest.mark.parametrize("kind", TYPES)
def test_columns_of_parquet_files(tmp_path: Path, kind: str):
    """Assert that times of each type are read, in parts as in the whole."""
    path = tmp_path / "log.parquet"
    pl.DataFrame(CELLS).insert_column(0, TYPES[kind]).write_parquet(path, row_group_size=50)
    log = read_log(path)
    assert log.warnings == ()
    assert_is_the_log(log)
    clock, tables = Clock(), [*tables_of_file(path, None, 90)]
    recipes, _ = recipes_of(tables[0], None)
    assert len(tables) > 3
    time = np.concatenate([channels_of(t, recipes, clock)["time"].values for t in tables])
    np.testing.assert_allclose(time, 2e-4 * np.arange(COUNT), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Vienna"])
def test_frames_and_arrays(zone: str | None):
    """Assert that stamps of pandas and NumPy are read to the nanosecond."""
    times = pd.date_range("2024-05-01", periods=COUNT, freq="200001ns", tz=zone)
    frame = pd.DataFrame(CELLS, index=times.rename("time"))
    for table in (
        table_of_frame(frame),
        table_of_frame(frame.rename_axis(None)),
        table_of_frame(pl.from_pandas(frame.reset_index())),
        table_of_arrays({"time": times.tz_localize(None).to_numpy()} | CELLS),
    ):
        (recording,) = log_of_table(table).recordings
        assert recording.sample_time == pytest.approx(2.00001e-4, rel=1e-12)


def streamed(clock: Clock, *stamps: str) -> FloatArray:
    """Return the times of a part of a stream."""
    frame = pl.DataFrame({"time": stamps}, schema={"time": pl.String})
    found = clock.stamped(Table("stream", frame, row_word="line", mark=""), "time")
    assert found is not None
    return found


def test_streams_count_on(tmp_path: Path):
    """Assert seconds since 1970 of a replay, and late times of day that stay in their day."""
    path = tmp_path / "log.parquet"
    pl.DataFrame(CELLS).insert_column(0, pl.Series("time", MOMENTS)).write_parquet(path)
    samples = next(iter(Replay(path, None)))
    assert samples[:, 0] == pytest.approx([t.timestamp() for t in MOMENTS], abs=1e-6)
    found = streamed(Clock(since_1970=True), "", " ", "00:00:01.5")
    np.testing.assert_array_equal(found, [np.nan, np.nan, 1.5])
    clock = Clock(since_1970=True)
    stamps = ["23:59:59.5", "00:00:00.5", "23:59:59.75", "", "1:2", "0:00:01"]
    found = np.concatenate((streamed(clock, *stamps), streamed(clock, "00:00:01.5"))) - 86_400.0
    np.testing.assert_array_equal(found, [-0.5, 0.5, -0.25, np.nan, np.nan, 1.0, 1.5])


def test_large_numbers_as_times():
    """Assert exact differences of distant integers, and that seconds since 1970 start at zero."""
    ticks = np.array([-3, 0, 3]) * 2**61
    table = table_of_arrays({"time": ticks})
    found = Clock().numbers(table, "time", 1e-9)
    np.testing.assert_array_equal(found, [0.0, 3 * 2.0**61, 6 * 2.0**61])
    columns = joint_columns()
    log = read_columns({**columns, "time": columns["time"] + 1.7e9})
    assert log.warnings == ()
    assert log.recordings[0].start_time == 0.0


def test_a_time_that_restarts():
    """Assert that trials in one file become recordings, also if samples are lost in them."""
    whole = joint_columns(900)
    kept = np.setdiff1d(np.arange(900), np.arange(25, 880, 40))
    columns = {name: values[kept] for name, values in whole.items()}
    time = columns["time"]
    columns["time"] = time - np.select([time < 1.5, time < 3.0], [0.0, 1.5], 3.0)
    log = read_columns(columns)
    assert [len(recording) for recording in log.recordings] == [300, 300, 300]
    for part, recording in enumerate(log.recordings):
        true = whole["motor_position"][300 * part : 300 * (part + 1)]
        np.testing.assert_allclose(recording.motor_position, true, rtol=0.0, atol=1e-5)
    said_of_it = " ".join(log.warnings)
    assert "restarts after 1.495 s, 1.495 s, so the log was cut there into 3" in said_of_it
    assert "are missing from" not in said_of_it  # the pauses are no gaps of the log
