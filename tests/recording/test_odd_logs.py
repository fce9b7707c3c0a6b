"""Logs as engineers' programs export them: right values, or a message with a remedy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_log import (
    Columns,
    assert_equal_logs,
    csv_text,
    joint_columns,
    read_columns,
    refused,
    said,
    without,
    written,
)

from flexid.arrays import FloatArray
from flexid.recording.read import read_log

COLUMNS = without(joint_columns(), "velocity")
TEXT = csv_text(COLUMNS)
HEADER, _, ROWS = TEXT.partition("\n")
LINES = ROWS.splitlines()
DEGREES = {n: np.degrees(v) if "position" in n else v for n, v in COLUMNS.items()}


def headed(header: str, columns: Columns = COLUMNS) -> str:
    """Return the log with another header."""
    return f"{header}\n{csv_text(columns).partition(chr(10))[2]}"


def times_per_channel() -> str:
    """Return the log with a time column for each channel."""
    rows = [line.split(",") for line in LINES]
    lines = [f"{t},{q},{t},{m},{t},{u}" for t, q, m, u in rows]
    return "\n".join(["time,link_position,time,motor_position,time,motor_torque", *lines]) + "\n"


LABELS = (
    ",Type: double,Type: double,Type: double\n"
    ",Unit: deg,Unit: deg,Unit: N*m\n"
    ",BlockPath: m/a,BlockPath: m/b,BlockPath: m/c"
)
HUNDREDTHS = {n: 100.0 * v if "position" in n else v for n, v in DEGREES.items()}
HEADERS = {  # for columns in SI units
    "topics of states": "__time,/link/joint_states/pos,/motor/joint_states/pos,/js/effort",
    "round brackets": "time (s),link_position(rad),motor_position,motor_torque (N m)",
    "capitals and blanks": "TIME,Link position [RAD],MotorPosition,Motor-Torque (Nm)",
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
    "LabVIEW": (
        "Samples,400,400,400,\nY_Unit_Label,deg,deg,Nm,\n"
        "X_Value,link_position,motor_position,motor_torque,Comment"
    ),
    "units above the names": f"s,deg,deg,Nm\n{HEADER}",
}
GERMAN = headed("Zeit [s],Winkel Abtrieb [°],Winkel Motor [°],Drehmoment [Nm]", DEGREES)
PARTS = "time,link_position [0.01 deg],motor_position [1e-2 deg],motor_torque"
LINK = COLUMNS["link_position"]
READ: dict[str, str | bytes] = {
    **{name: headed(header) for name, header in HEADERS.items()},
    **{name: headed(header, DEGREES) for name, header in IN_DEGREES.items()},
    "parts of a unit": headed(PARTS, HUNDREDTHS),
    "German": GERMAN.replace(",", ";").replace(".", ","),
    "durations of MATLAB": "\n".join([HEADER, *(o.replace(",", " sec,", 1) for o in LINES)]),
    "a time for each channel": times_per_channel(),
    "comments at the end": f"{TEXT}# end\n\n% of the log\n",
    "rows of empty cells at the end": f"{TEXT},,,\n;;;\n",
    "UTF-16 without a mark": TEXT.encode("utf-16-le"),
    "UTF-16 of the other order": TEXT.encode("utf-16-be"),
    "GB 2312": headed("时间(s),负载角度(deg),电机角度(deg),转矩(Nm)", DEGREES).encode("gb2312"),
    "Shift-JIS": headed("時間,リンク角度[deg],モーター角度[deg],トルク", DEGREES).encode("cp932"),
    "Latin-1": headed(f"{HEADER} [Nm],Größe [°]", COLUMNS | {"size": LINK}).encode("latin-1"),
}


def interrupted(*others: str) -> str:
    """Return the log with other lines inserted, one after each tenth row."""
    lines = [HEADER, *LINES]
    for place, other in enumerate(others, start=1):
        lines.insert(11 * place, other)
    return "\n".join(lines) + "\n"


HOLES = ("", "NaN", "NA", "n/a", "null", "None", "#N/A", "-", "-1.#QNAN0")


def with_holes(cell: str) -> str:
    """Return the log with a link position in every second row only."""
    rows = [line.split(",") for line in LINES]
    for row in rows[1::2]:
        row[1] = cell
    return "\n".join([HEADER, *map(",".join, rows)]) + "\n"


def runs_one_after_the_other() -> str:
    """Return the log in two halves, each of which begins at zero."""
    half = len(LINES) // 2
    again = [line.split(",", 1)[1] for line in LINES[half:]]
    second = [f"{line.split(',', 1)[0]},{rest}" for line, rest in zip(LINES, again, strict=False)]
    return "\n".join([HEADER, *LINES[:half], *second]) + "\n"


def sparse(every: int) -> FloatArray:
    """Return a velocity with few values."""
    return np.where(np.arange(400) % every == every - 1, COLUMNS["link_position"], np.nan)


LEFT_OUT = {
    "a comment": interrupted("# paused"),
    "comments with blanks": interrupted("# a b").replace(",", " "),
    "blank lines": interrupted("", "  ", ""),
    "the header": interrupted(f"\ufeff{HEADER}"),
    "all of them": interrupted("% x", HEADER, ""),
    "a scope's rows": headed(f"{HEADER}\nLREAL,LREAL,LREAL,LREAL\nport,801,of,task"),
    "a line between two": "\n\n".join([HEADER, *LINES]),
}
READ |= LEFT_OUT


@pytest.mark.parametrize("name", LEFT_OUT)
def test_lines_count_where_some_hold_no_sample(name: str, tmp_path: Path) -> None:
    """Assert that the line number of a bad cell is right despite lines without samples."""
    lines = LEFT_OUT[name].splitlines()
    place = lines.index(LINES[-1].replace(",", " ") if "blanks" in name else LINES[-1])
    lines[place] = lines[place].replace("1.995", "1.9x5", 1)
    path = written(tmp_path, "\n".join(lines))
    assert f"line {place + 1}, column 'time': '1.9x5' is not" in refused(read_log, path)


@pytest.mark.parametrize("name", READ)
def test_read(name: str, tmp_path: Path) -> None:
    """Assert that values are right without a column map."""
    log = read_log(written(tmp_path, READ[name]))
    assert_equal_logs(log, read_columns(COLUMNS), 1e-12)


TWO_LINES = headed('time,"link\nposition","motor\nposition",motor_torque')
LISTS = "".join(f'{t},"[0.1, {t}]",0\n' for t in range(9))
OTHERS: dict[str, str] = {
    "a log twice": f"{TEXT}{TEXT}",
    "two times that differ": times_per_channel().replace("\n0.005,", "\n0.006,", 1),
    "degrees in German": headed("time,link_position [Grad],motor_position [Grad],tau", DEGREES),
    "the same below the names": headed(f"{HEADER}\ns,Grad,Grad,kpm", DEGREES),
    "a share of the rated torque": headed(f"{HEADER} [%]"),
    "thousandths of the rated torque": headed(f"{HEADER} [0.1 % of rated torque]"),
    "a header in two lines": TWO_LINES,
    "a range as a unit": headed(f"{HEADER} [3.3 V]"),
    "lists in cells": f"time,link_position,motor_position\n{LISTS}",
    "units in cells": TEXT.replace("\n1.0,", "\n1.0 s,"),
    "positions of several things": headed("time,robot_pos_estimate,tool_pos_estimate,tau"),
    "numbers of samples": headed(HEADER.replace("time", "sample")),
    "units that are called so": headed(f"{HEADER}\ns,rad,units,N m"),
    "names in cells": "\n".join(f"time:{k},link:0.1,motor:0.{k}" for k in range(9)),
    "names between labels": (
        times_per_channel()
        .replace("time,", "Name,")
        .replace("torque\n", "torque\nUnit,deg,Unit,deg,Unit,Nm\nBased,Yes,Based,Yes,Based,Yes\n")
    ),
    "a torque of the link": headed(
        "time,joint/link/position,joint/motor/position,joint/link/torque"
    ),
    **{f"holes of {cell!r}": with_holes(cell) for cell in HOLES},
    "runs one after the other": runs_one_after_the_other(),
}


def test_what_is_said_of_texts(here: Path, golden: Any) -> None:
    """Assert that one sentence gives the remedy, or names what was left out."""
    golden({name: said(read_log, written(Path(), text)) for name, text in (READ | OTHERS).items()})


def without_values(**places: Any) -> dict[str, Any]:
    """Return the log with missing values."""
    columns = {name: values.copy() for name, values in COLUMNS.items()}
    for name, missing in places.items():
        columns[name][missing] = np.nan
    return columns


def some(places: Any, columns: Columns = COLUMNS, **changed: Any) -> dict[str, Any]:
    """Return some samples of a log, in this order, with some columns replaced."""
    return {name: values[places] for name, values in columns.items()} | changed


def marked(name: str, *marks: float) -> FloatArray:
    """Return a column with five samples of each value."""
    values = COLUMNS[name]
    for place, mark in enumerate(marks):
        values = np.where(np.arange(400) % 90 == 3 + 10 * place, mark, values)
    return values


COUNTED_TURNS = np.rint(3e4 / np.pi * COLUMNS["motor_position"]).astype(int) % 60_000


COUNTED = (np.rint(300.0 / np.pi * 1e3 * COLUMNS["motor_position"]).astype(int) + 9) % 2**16
FAILED = {"link_position": [50, 51, 52, 200, 300], "motor_torque": range(20, 400, 40)}


def with_zeros(name: str) -> FloatArray:
    """Return a channel that is zero in some samples."""
    values = COLUMNS[name].copy()
    values[[*FAILED[name]]] = 0.0
    return values


MARKS = {"motor_torque": -999.0, "link_position": 32768.0, "motor_position": 99.99}
EVERY = np.arange(400)
TICKS = np.rint(1e3 * COLUMNS["time"]).astype(np.int64)
WRAPPED = (TICKS - TICKS[150]) % 2**16
RANDOM = np.random.default_rng(1).random(400) < 0.2
TWICE = np.sort(np.r_[EVERY, 7, 7, 300])
LATE = 0.5 * (EVERY > 49)
FLOORED = np.floor(EVERY - 0.3 * (EVERY % 3 == 1))  # 0, 0, 2, 3, 3, ...
NO_TIME = without(COLUMNS, "time")
SINCE_1970 = 1_700_000_000_000_000_000 + 5_000_000 * EVERY
BY_STEPS = {"sample_time": "1/200", **{name: name for name in NO_TIME}}
WINDOWS = SINCE_1970 // 100 + 116_444_736 * 10**9
STATED = {f"a sample time of {bad!r}"[:30]: bad for bad in (0.9, 10**400, "fast")}
IN_MEMORY: dict[str, dict[str, Any]] = {
    "a counter that overflows": {**NO_TIME, "time [ms]": WRAPPED},
    "one of 32 bits, in seconds": {**NO_TIME, "time": (TICKS - TICKS[150]) % 2**32 / 1e3},
    "a motor's counter that overflows": {**COLUMNS, "motor_position": COUNTED},
    "marks of missing values": {**COLUMNS, **{n: marked(n, v) for n, v in MARKS.items()}},
    "zeros of readings that failed": {**COLUMNS, **{n: with_zeros(n) for n in FAILED}},
    "zeros between two levels": {**COLUMNS, "motor_torque": np.sign(EVERY % 20 - 10.0)},
    "two zeros": {**COLUMNS, "motor_torque": np.where(EVERY % 200 == 150, 0.0, 10.0)},
    "an encoder of 60 000 counts": {**COLUMNS, "motor_position": COUNTED_TURNS},
    "moments without a voltage": {**COLUMNS, "motor_torque": np.where(EVERY % 60 < 2, 0.0, 24.0)},
    "three pulses as high as a mark": {
        **COLUMNS,
        "motor_torque": np.where(EVERY % 150 < 3, 32767, COLUMNS["motor_torque"]),
    },
    "marks of two kinds": {**COLUMNS, "motor_torque": marked("motor_torque", -999.0, 9999.0)},
    "pulses as high as a mark": {**COLUMNS, "motor_torque": 999.0 * (EVERY // 10 % 2)},
    "levels of which one is": {**COLUMNS, "motor_torque": np.array([0, 9, 999])[EVERY // 10 % 3]},
    "a clock that runs back": {**NO_TIME, "time [ms]": -TICKS},
    "few holes": without_values(link_position=[0, 399], motor_torque=100),
    "holes at random": without_values(link_position=RANDOM, motor_torque=100),
    "no value at all": without_values(link_position=EVERY),
    "rows written twice": some(TWICE),
    "rows with a hole twice": some(TWICE, without_values(motor_torque=300)),
    "numbers that are no link's": without(COLUMNS, "link") | {"q1": LINK, "q2": LINK[::-1]},
    "a sample time": NO_TIME,
    "a sample time and no time": COLUMNS,
    "a sample time beside a time": COLUMNS,
    **dict.fromkeys(STATED, NO_TIME),
    **{f"one velocity of {n}": {**COLUMNS, "motor_velocity": sparse(n)} for n in (20, 400)},
    "zeros before the drive answers": {n: (v + 0.5) * (EVERY > 49) for n, v in NO_TIME.items()}
    | {"time": COLUMNS["time"]},
    "every sample five times": some(EVERY // 5 * 5, time=COLUMNS["time"]),
    "whole nanoseconds": {**COLUMNS, "time": SINCE_1970},
    "as Windows counts": {**COLUMNS, "time": WINDOWS},
    "whole milliseconds as seconds": {**COLUMNS, "time": FLOORED},
    "steps of 45 ms": {**COLUMNS, "time": 0.045 * EVERY},
    "steps of 55 ms": {**COLUMNS, "time": 0.055 * EVERY},
    "steps of 100 ms, as they say": {**NO_TIME, "time [s]": 0.1 * EVERY},
    "whole milliseconds": {**NO_TIME, "time [ms]": FLOORED},
}
MAPS: dict[str, dict[str, Any]] = {
    "a motor's counter that overflows": {
        "gear_ratio": 300,
        "motor_position": {"column": "motor_position", "scale": "1/2000", "unit": "turn"},
        "motor_torque": {"column": "motor_torque", "unit": "N m", "side": "link"},
    },
    "an encoder of 60 000 counts": {
        "motor_position": {"column": "motor_position", "scale": "1/60000", "unit": "turn"},
    },
    "a sample time": BY_STEPS,
    "a sample time and no time": {**BY_STEPS, "time": False},
    "a sample time beside a time": {**BY_STEPS, "time": "time"},
    **{name: BY_STEPS | {"sample_time": bad} for name, bad in STATED.items()},
}


def test_what_is_said_of_columns(golden: Any) -> None:
    """Assert that missing, repeated or differently counted values are corrected or named."""
    golden({name: said(read_columns, one, MAPS.get(name)) for name, one in IN_MEMORY.items()})
