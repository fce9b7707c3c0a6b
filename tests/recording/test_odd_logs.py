"""Logs as drive engineers export them: right numbers, or a sentence that says what to do."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_log import (
    Columns,
    assert_words,
    csv_text,
    joint_columns,
    read_columns,
    refused,
    without,
    written,
)

from flexid.recording import Log
from flexid.recording.read import read_log

COLUMNS = without(joint_columns(), "velocity")
TEXT = csv_text(COLUMNS)
HEADER, _, ROWS = TEXT.partition("\n")
LINES = ROWS.splitlines()
DEGREES = {n: np.degrees(v) if "position" in n else v for n, v in COLUMNS.items()}


def headed(header: str, columns: Columns = COLUMNS) -> str:
    """The log with another header."""
    return f"{header}\n{csv_text(columns).partition(chr(10))[2]}"


def times_per_channel() -> str:
    """The log as programs write it that store a time with each channel."""
    rows = [line.split(",") for line in LINES]
    lines = [f"{t},{q},{t},{m},{t},{u}" for t, q, m, u in rows]
    return "\n".join(["time,link_position,time,motor_position,time,motor_torque", *lines]) + "\n"


def with_stamps() -> str:
    """The log with a stamp as ROS writes it."""
    names = "header.stamp.secs,header.stamp.nsecs,link/position,motor/position,motor/effort"
    stamps = [(int(t), round(1e9 * (t % 1.0))) for t in COLUMNS["time"].tolist()]
    rows = [
        f"{secs},{nsecs},{line.split(',', 1)[1]}"
        for (secs, nsecs), line in zip(stamps, LINES, strict=True)
    ]
    return "\n".join([names, *rows]) + "\n"


LABELS = (
    ",Type: double,Type: double,Type: double\n"
    ",Unit: deg,Unit: deg,Unit: N*m\n"
    ",BlockPath: m/a,BlockPath: m/b,BlockPath: m/c"
)
HUNDREDTHS = {n: 100.0 * v if "position" in n else v for n, v in DEGREES.items()}
HEADERS = {  # of columns in SI
    "topics of states": "__time,/link/joint_states/pos,/motor/joint_states/pos,/js/effort",
    "a control input": "t,q_l,q_m,u_Nm",
    "functions of time": "t,q_l(t),q_m(t),tau(t)",
    "blanks that do not break": "time,link\u00a0position\u00a0[rad],motor\u00a0position,"
    "motor\u00a0torque\u00a0[N\u00a0m]",
    "names below their groups": ",link,motor,motor\ntime,pos,pos,tau",
    "numbers in a preamble": f"Samples,400,400,400\nStep,1,1,1\n{HEADER}",
    "a row of groups": f"Axis 1,Axis 1,Axis 1,Axis 1\n{HEADER}",
    "paths of a simulation": "time,logsout.link_position.Data,logsout.motor_position.Data,"
    "logsout.motor_torque.Data",
    "paths of topics": "__time,/joint/link/position,/joint/motor/position,/joint/effort",
}
IN_DEGREES = {
    "labels below the names": f"{HEADER}\n{LABELS}",
    "names of one program": "t [s],GVL.fLinkPos [°],GVL.fMotorPos [°],GVL.fMotorTorque [Nm]",
    "a comment of units": f"# units: s, deg, deg, Nm\n{HEADER}",
    "no unit of the time": f"{HEADER}\n-,deg,deg,N m",
    "French": "Temps (s),Position charge (deg),Position moteur (deg),Couple (N·m)",
    "units in braces": "time{s},link_position{deg},motor_position{deg},motor_torque{Nm}",
    "units in words": f"{HEADER}\nseconds,degrees,degrees,newton metres",
    "units above the names": f"s,deg,deg,Nm\n{HEADER}",
}
GERMAN = headed("Zeit [s],Winkel Abtrieb [°],Winkel Motor [°],Drehmoment [Nm]", DEGREES)
PARTS = "time,link_position [0.01 deg],motor_position [1e-2 deg],motor_torque"
READ: dict[str, str | bytes] = {
    **{name: headed(header) for name, header in HEADERS.items()},
    **{name: headed(header, DEGREES) for name, header in IN_DEGREES.items()},
    "parts of a unit": headed(PARTS, HUNDREDTHS),
    "German": GERMAN.replace(",", ";").replace(".", ","),
    "a stamp in two columns": with_stamps(),
    "a time for each channel": times_per_channel(),
    "comments at the end": f"{TEXT}# end\n\n% of the log\n",
    "rows of empty cells at the end": f"{TEXT},,,\n;;;\n",
    "a column of remarks": f"Samples,400,400,400\n{headed(HEADER + ',Comment')}",
    "UTF-16 without a mark": TEXT.encode("utf-16-le"),
    "UTF-16 of the other order": TEXT.encode("utf-16-be"),
}


def interrupted(*others: str) -> str:
    """The log with other lines in it, one after each tenth row."""
    lines = [HEADER, *LINES]
    for place, other in enumerate(others, start=1):
        lines.insert(11 * place, other)
    return "\n".join(lines) + "\n"


LEFT_OUT = {
    "a comment": (interrupted("# paused"), "line 12 was left out, as a comment$"),
    "comments with blanks": (interrupted("# a b").replace(",", " "), "left out, as a comment$"),
    "blank lines": (interrupted("", "  ", ""), "line 12 and 2 more were left out, as blank$"),
    "the header": (
        interrupted(f"\ufeff{HEADER}"),
        "line 12 was left out, as the column names once more$",
    ),
    "all of them": (interrupted("% x", HEADER, ""), "as a comment or the column .* or blank$"),
    "a scope's rows": (
        headed(f"{HEADER}\nLREAL,LREAL,LREAL,LREAL\nport,801,of,task"),
        "lines 2 to 3 were not read, since the numbers begin in line 4: check that they do$",
    ),
    "a line between two": ("\n\n".join([HEADER, *LINES]), "and 398 more were left out"),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_lines_that_hold_no_sample(name: str, tmp_path: Path) -> None:
    """Assert that they are left out, with a warning, and that a bad cell has its line still."""
    text, words = LEFT_OUT[name]
    log = read_log(written(tmp_path, text))
    same_numbers(log)
    (warning,) = log.warnings
    assert_words(words, warning)
    lines = text.splitlines()
    place = lines.index(LINES[-1].replace(",", " ") if "blanks" in name else LINES[-1])
    lines[place] = lines[place].replace("1.995", "1.9x5", 1)
    path = written(tmp_path, "\n".join(lines))
    assert_words(f"line {place + 1}, column 'time': '1.9x5' is not", refused(read_log, path))


def same_numbers(log: Log) -> None:
    """Assert that a log holds the numbers of the columns."""
    (recording,) = log.recordings
    assert recording.link_position is not None
    assert recording.input is not None
    np.testing.assert_allclose(recording.time, COLUMNS["time"], atol=1e-12)
    np.testing.assert_allclose(recording.link_position, COLUMNS["link_position"], rtol=1e-12)
    np.testing.assert_allclose(recording.motor_position, COLUMNS["motor_position"], rtol=1e-12)
    np.testing.assert_allclose(recording.input, COLUMNS["motor_torque"], rtol=1e-12)
    assert recording.input_unit == "N m"


@pytest.mark.parametrize("name", READ)
def test_read(name: str, tmp_path: Path) -> None:
    """Assert that the numbers are right without a column map."""
    same_numbers(read_log(written(tmp_path, READ[name])))


REFUSED = {
    "a log twice": (
        f"{TEXT}{TEXT}",
        "line 403, column 'time': the same samples follow once more: remove them",
    ),
    "two times that differ": (
        times_per_channel().replace("\n0.005,", "\n0.006,", 1),
        "line 1: the column 'time' stands there twice, with other values: rename or remove one",
    ),
    "degrees in German": (
        headed("time,link_position [Grad],motor_position [Grad],motor_torque", DEGREES),
        r"column 'link_position \[Grad\]': .*may mean degrees.*write \[deg\]",
    ),
    "a share of the rated torque": (
        headed(HEADER.replace("motor_torque", "motor_torque [%]")),
        r"column 'motor_torque \[%\]': .*rated value as the scale, in a column map",
    ),
    "thousandths of the rated torque": (
        headed(HEADER.replace("motor_torque", "motor_torque [0.1 % of rated torque]")),
        "rated torque. is a share of something: write .N m.* as the unit",
    ),
    "a header in two lines": (
        headed('time,"link\nposition","motor\nposition",motor_torque'),
        "line 1: a quotation mark opens in the header .*: write all column names in one line",
    ),
    "a range as a unit": (
        headed(HEADER.replace("motor_torque", "motor_torque [3.3 V]")),
        "the unit .3.3 V. is not known for this column: write .*, or the unit and a scale",
    ),
    "lists in cells": (
        "time,link_position,motor_position\n" + "".join(f'{t},"[0.1, {t}]",0\n' for t in range(9)),
        "line 2, column 'link_position': '.0.1, 0.' is not a number",
    ),
    "units in cells": (
        headed("time,link_position,motor_position,motor_torque").replace("\n1.0,", "\n1.0 s,"),
        "line 202, column 'time': '1.0 s' is not a number",
    ),
    "positions of several things": (
        headed("time,robot_pos_estimate,tool_pos_estimate,tau"),
        "say in a column map which is which, as motor_position = 'robot_pos_estimate'$",
    ),
    "numbers of samples": (
        headed(HEADER.replace("time", "sample")),
        "there is no time.*without a time, write sample_time = 0.001 for 1 ms",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name: str, tmp_path: Path) -> None:
    """Assert that one sentence says what to do."""
    text, words = REFUSED[name]
    assert_words(words, refused(read_log, written(tmp_path, text)))


@pytest.mark.parametrize("is_signed", [False, True])
def test_a_clock_that_overflows_cuts_the_log(is_signed: bool) -> None:
    """Assert that a counter that begins again costs no sample, and that other times are refused."""
    ticks = np.rint(1e3 * COLUMNS["time"]).astype(np.int64)
    counted = (ticks - ticks[150]) % 2**16 - (2**15 if is_signed else 0)
    columns = {**without(COLUMNS, "time"), "time [ms]": counted}
    log = read_columns(columns)
    assert [len(recording) for recording in log.recordings] == [150, 250]
    assert_words("the time begins again .* cut there into 2 recordings", log.warnings[0])
    assert_words("runs backwards", refused(read_columns, {**columns, "time [ms]": -ticks}))


def with_holes(cell: str) -> str:
    """The log whose link position has a value in every second row."""
    rows = [line.split(",") for line in LINES]
    for row in rows[1::2]:
        row[1] = cell
    return "\n".join([HEADER, *map(",".join, rows)]) + "\n"


@pytest.mark.parametrize("cell", ["", "NaN", "NA", "n/a", "null", "None", "#N/A", "-"])
def test_two_rates_in_one_table(cell: str, tmp_path: Path) -> None:
    """Assert that rows in which one sensor was not read make a log of the slower rate."""
    log = read_log(written(tmp_path, with_holes(cell)))
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(0.01)
    for name in ("link_position", "motor_position"):
        np.testing.assert_allclose(getattr(recording, name), COLUMNS[name][::2], atol=1e-12)
    assert_words("'motor_position', 'motor_torque' had time stamps of their own", log.warnings[0])


def test_few_values_are_missing() -> None:
    """Assert that their rows are left out, or the whole log where each row lacks one."""
    columns = {name: values.copy() for name, values in COLUMNS.items()}
    columns["motor_torque"][100] = columns["link_position"][[0, 399]] = np.nan
    log = read_columns(columns)
    assert [len(recording) for recording in log.recordings] == [99, 298]
    assert_words("no value in 3 of 400 rows .at 0 s, 0.5 s, 1.995 s", log.warnings[0])
    columns["link_position"][np.random.default_rng(1).random(400) < 0.2] = np.nan
    words = "'link_position' and .*'motor_torque'.*no value in .* of 400 rows, at uneven times"
    assert_words(words, refused(read_columns, columns))
    columns["link_position"][:] = np.nan
    assert_words("'link_position'.*it has 0 samples", refused(read_columns, columns))


def test_rows_that_are_written_twice() -> None:
    """Assert that each counts once where all of it is the same."""
    twice = np.sort(np.r_[np.arange(400), 7, 7, 300])
    columns = {name: values[twice] for name, values in COLUMNS.items()}
    (recording,) = read_columns(columns).recordings
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])
    columns["motor_torque"][columns["time"] == 1.5] = np.nan
    log = read_columns(columns)
    assert [len(recording) for recording in log.recordings] == [300, 99]
    assert_words("rows written twice .at 0.035 s, 0.035 s, 1.5 s; 3 in all", log.warnings[0])


def test_no_position_of_several_is_the_link() -> None:
    """Assert that of numbered positions beside the motor's none is taken for its link."""
    link = COLUMNS["link_position"]
    columns = {**without(COLUMNS, "link_position"), "q1": link, "q2": link[::-1]}
    log = read_columns(columns)
    assert log.recordings[0].link_position is None
    assert any("'q1', 'q2' are not used" in warning for warning in log.warnings)


def test_no_time_but_a_sample_time() -> None:
    """Assert that a column map may say how far rows are apart, and not beside a time."""
    columns = without(COLUMNS, "time")
    given = {"sample_time": "1/200", **{name: name for name in columns}}
    (recording,) = read_columns(columns, given).recordings
    np.testing.assert_allclose(recording.time, COLUMNS["time"], atol=1e-12)
    for bad, words in {
        0.9: "0.9 s is outside 1e-06 to 0.5 s",
        10**400: "10*[.]{3} s is outside",
        "fast": "'fast' is not a number of seconds",
    }.items():
        assert_words(words, refused(read_columns, columns, {**given, "sample_time": bad}))
    assert read_columns(columns, {**given, "time": False}).recordings
    message = refused(read_columns, COLUMNS, {**given, "time": "time"})
    assert_words("key 'sample_time': the map names a column for the time, too", message)


@pytest.mark.parametrize("every", [20, 400])
def test_a_velocity_of_few_values_is_not_used(every: int) -> None:
    """Assert that a column that is empty, or nearly so, costs nothing but a warning."""
    sparse = np.where(np.arange(400) % every == every - 1, COLUMNS["link_position"], np.nan)
    log = read_columns({**COLUMNS, "motor_velocity": sparse})
    same_numbers(log)
    assert_words("'motor_velocity': too many values are missing, so it", log.warnings[0])


def test_zeros_before_the_drive_answers() -> None:
    """Assert that what a logger writes until then is left out."""
    columns = {name: values + (0.5 if name != "time" else 0.0) for name, values in COLUMNS.items()}
    for name in columns:
        columns[name][:50] *= 1.0 if name == "time" else 0.0
    log = read_columns(columns)
    assert [len(recording) for recording in log.recordings] == [350]
    assert_words("nothing changes from 0 s to 0.245 s", log.warnings[0])


def test_a_log_that_repeats_every_sample_is_named() -> None:
    """Assert that positions that all stand still in most steps are no lost samples."""
    held = np.arange(400) // 5 * 5
    columns = {name: values[held] for name, values in COLUMNS.items()}
    log = read_columns({**columns, "time": COLUMNS["time"]})
    assert_words("changes only every 5 samples", log.warnings[0])


def test_a_torque_of_the_link_is_not_the_motors(tmp_path: Path) -> None:
    """Assert that the end of a path takes the side along that stands before it."""
    text = headed("time,joint/link/position,joint/motor/position,joint/link/torque")
    assert read_log(written(tmp_path, text)).recordings[0].input is None


@pytest.mark.parametrize("unit", ["ms", "us", "ns", "ps"])
@pytest.mark.parametrize("origin", ["", "2024-05-01"])
def test_times_of_numpy(origin: str, unit: str, tmp_path: Path) -> None:
    """Assert that dates and durations are a time."""
    stamps: Any = np.rint(1e3 * COLUMNS["time"]).astype("m8[ms]").astype(f"m8[{unit}]")
    stamps = stamps + np.datetime64(origin, unit) if origin else stamps
    signals: dict[str, Any] = {**COLUMNS, "time": stamps}
    same_numbers(read_columns(signals))
    np.savez(tmp_path / "log.npz", **signals)
    same_numbers(read_log(tmp_path / "log.npz"))


def test_runs_one_after_the_other(tmp_path: Path) -> None:
    """Assert that each becomes a recording of the numbers it has, with one warning of lines."""
    half = len(LINES) // 2
    again = [line.split(",", 1)[1] for line in LINES[half:]]
    second = [f"{line.split(',', 1)[0]},{rest}" for line, rest in zip(LINES, again, strict=False)]
    log = read_log(written(tmp_path, "\n".join([HEADER, *LINES[:half], *second]) + "\n"))
    assert [len(recording) for recording in log.recordings] == [half, half]
    found = np.concatenate([recording.motor_position for recording in log.recordings])
    np.testing.assert_allclose(found, COLUMNS["motor_position"], rtol=1e-12)
    assert log.recordings[1].sample_time == pytest.approx(0.005, rel=1e-9)
    (warning,) = log.warnings
    assert_words(f"begins again .line {half + 2}, .*into 2 recordings: check that all", warning)


def test_a_time_in_nanoseconds_since_1970(tmp_path: Path) -> None:
    """Assert that it needs no unit, in a file and in memory, to the last digit."""
    stamps = 1_700_000_000_000_000_000 + (5_000_000 * np.arange(len(LINES)))
    lines = [f"{t},{line.split(',', 1)[1]}" for t, line in zip(stamps, LINES, strict=True)]
    same_numbers(read_log(written(tmp_path, "\n".join([HEADER, *lines]) + "\n")))
    same_numbers(read_columns({**COLUMNS, "time": stamps}))


def test_whole_milliseconds_that_repeat() -> None:
    """Assert that a clock that cuts digits off asks for its unit, and is even in that."""
    columns = dict(COLUMNS)
    time = np.floor(np.arange(400) - 0.3 * (np.arange(400) % 3 == 1))  # 0, 0, 2, 3, 3, ...
    message = refused(read_columns, {**columns, "time": time})
    assert_words("the sample time would be 1 s, .*: name the unit of the time, as in", message)
    del columns["time"]
    (recording,) = read_columns({"time [ms]": time, **columns}).recordings
    assert recording.sample_time == pytest.approx(1e-3, rel=1e-4)
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])
