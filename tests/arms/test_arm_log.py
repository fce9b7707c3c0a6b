"""Unusable logs and files of arms: refused in one sentence, with the remedy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexid.arms.log import read_arm_log
from flexid.models.model_file import read_arm
from flexid.models.motion import JointType

TYPES: dict[str, JointType] = {"R": "revolute", "P": "prismatic"}
TURNING = (TYPES["R"],)
TWO = TURNING * 2
NAMES = ("motor_position_{} [deg]", "link_position_{} [deg]", "motor_torque_{} [N m]")


def log_of(path: Path, leave_out: str = "", joints: int = 2, bad: str = "", lost: int = 0) -> Path:
    """Write a log of simulated motion in which each joint can lack rows of its own."""
    rng = np.random.default_rng(5)
    t = 0.002 * np.arange(1500)
    columns = {"time [s]": t}
    for joint in range(1, joints + 1):
        motor = 20.0 * np.sin(3.0 * t + joint) + 0.01 * rng.normal(size=len(t))
        link = motor + 0.5 * np.sin(9.0 * t) + 0.01 * rng.normal(size=len(t))
        torque = np.cos(7.0 * t + joint) + 0.1 * rng.normal(size=len(t))
        for name, values in zip(NAMES, (motor, link, torque), strict=True):
            columns[name.format(joint)] = values
    columns = {name: v for name, v in columns.items() if not (leave_out and leave_out in name)}
    for joint in range(1, joints + 1 if lost else 1):
        gone = 130 * np.arange(1, 11) + lost * joint
        columns |= {n: np.delete(v, gone) for n, v in columns.items() if f"_{joint} " in n}
    columns = {n: v[: len(t) - 10 * (lost > 0)] for n, v in columns.items()}
    rows = [",".join(f"{x:.6f}" for x in row) for row in np.column_stack([*columns.values()])]
    if bad:
        rows[700] = rows[700].rsplit(",", 1)[0] + f",{bad}"
    path.write_text("\n".join([",".join(columns), *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    "names",
    [("qm{}_deg", "ql{}_deg", "tau{}"), ("theta_m{} [deg]", "q{} [deg]", "J{} torque [Nm]")],
)
def test_usual_names_with_numbers(tmp_path: Path, names: tuple[str, ...]):
    """Assert that usual names with numbers are recognised, with their units."""
    path = log_of(tmp_path / "run.csv")
    plain = read_arm_log(path, TWO).recordings[0]
    header, _, rows = path.read_text().partition("\n")
    for name, usual in zip(NAMES, names, strict=True):
        for joint in (1, 2):
            header = header.replace(name.format(joint), usual.format(joint))
    path.write_text(f"{header}\n{rows}")
    (recording,) = read_arm_log(path, TWO).recordings
    np.testing.assert_array_equal(recording.positions, plain.positions)
    np.testing.assert_array_equal(recording.inputs, plain.inputs)


def test_a_column_map_with_numbers(tmp_path: Path):
    """Assert that a map's numbered keys rename, scale, and replace the link by a deflection."""
    path = log_of(tmp_path / "run.csv")
    columns = tmp_path / "map.toml"
    columns.write_text(
        'motor_current_2 = {column = "motor_torque_2", scale = 2.0, unit = "A"}\n'
        'deflection_1 = {column = "link_position_2", scale = 0.01, unit = "deg"}\n'
    )
    log = read_arm_log(path, TWO, columns)
    plain = read_arm_log(path, TWO)
    assert log.input_units == ("N m", "A")
    scaled = 2.0 * plain.recordings[0].inputs[:, 1]
    np.testing.assert_allclose(log.recordings[0].inputs[:, 1], scaled)


LOGS: dict[str, tuple[dict[str, Any], int]] = {
    "no link": ({"leave_out": "link_position_2"}, 2),
    "no torque": ({"leave_out": "motor_torque_1"}, 2),
    "one length": ({}, 1),
    "three lengths": ({}, 3),
    "lost samples": ({"lost": 20}, 2),
    "no time": ({"leave_out": "time"}, 2),
}
SLIDING = {  # keys of a map, and types of the joints
    "angles of a slide": ("gear_ratio_1 = 2.0", "RP"),
    "a slide that turns by the file": ('motor_position_2 = {column = "{}", unit = "mm"}', "RR"),
    "a ratio of a slide": ("gear_ratio_2 = 2.0", "RP"),
}
KEYS = ("gear_ratoi_2", "lead_1", "joint", "motor_position")
BRAKED = {"motor_position_2": 0.0, "link_position_2": 0.01}
RESTING = {
    "a dead encoder": {"motor_position_2": 0.0},
    "all at rest": BRAKED | {"motor_position_1": 0.0, "link_position_1": 0.01},
}
TWICE = {  # a column, and the name of another one with twice the values
    "two torques": ("tau_1", "torque_1"),
    "a constant torque": ("motor_torque_2", ""),
}
ARMS = {
    "no lengths": "[arm]\n",
    "no length": "[arm]\nlengths = []\n",
    "a negative length": "[arm]\nlengths = [0.3, -0.2]\n",
    "too much gravity": "[arm]\nlengths = [0.3]\ngravity = 1e9\n",
    "a key that is none": "[arm]\nlengths = [0.3]\nmass = 2.0\n",
    "no arm": "name = 'x'\n",
    "a slide without a length": "[arm]\nlengths = [0.3]\nslides = {2 = 0.0}\n",
    "no length between turning joints": "[arm]\nlengths = [0.0, 0.3]\n",
    "a slide that is no joint": "[arm]\nlengths = [0.3]\nslides = {first = 0.0}\n",
    "no direction of a slide": "[arm]\nlengths = [0.3]\nslides = {1 = 'x'}\n",
}


def written(name: str, text: str) -> Path:
    """Write a text to a file and return its path."""
    Path(name).write_text(text)
    return Path(name)


def scaled_by(scales: Mapping[str, float]) -> str:
    """Return the text of a column map that scales some positions."""
    form = '{0} = {{column = "{0}", scale = {1}, unit = "deg"}}\n'
    return "".join(form.format(*item) for item in scales.items())


def scaled(scales: Mapping[str, float]) -> Path:
    """Return a column map that scales some positions."""
    return written("map.toml", scaled_by(scales))


def without_common_samples(path: Path) -> Path:
    """Return the log with every row lacking one joint's sample."""
    header, *rows = path.read_text().splitlines()
    for place, row in enumerate(rows):
        cells = row.split(",")
        cells[1 + 3 * (place % 2)] = "nan"
        rows[place] = ",".join(cells)
    return written(path.name, "\n".join([header, *rows]) + "\n")


def twice(path: Path, own: str, other: str) -> Path:
    """Return the log with its torque by another name, and with a copy of twice that before it.

    Without a name of the copy, the torque is constant.
    """
    header, *rows = log_of(path).read_text().splitlines()
    place = 3 if own.endswith("1") else 6
    names = header.split(",")
    names[place] = f"{own} [N m]"
    cells = [row.split(",") for row in rows]
    if not other:
        fixed = [[*row[:place], "1.0", *row[place + 1 :]] for row in cells]
        return written(path.name, "\n".join(map(",".join, [names, *fixed])) + "\n")
    copied = [[row[0], str(2.0 * float(row[place])), *row[1:]] for row in cells]
    names.insert(1, f"{other} [N m]")
    return written(path.name, "\n".join(map(",".join, [names, *copied])) + "\n")


def test_the_name_of_a_channel_comes_before_others(tmp_path: Path, monkeypatch: Any):
    """Assert that a column with a channel's own name is read, though another one precedes it."""
    monkeypatch.chdir(tmp_path)
    plain = read_arm_log(log_of(Path("run.csv")), TWO).recordings[0]
    (recording,) = read_arm_log(twice(Path("run.csv"), "motor_torque_1", "tau_1"), TWO).recordings
    np.testing.assert_array_equal(recording.inputs, plain.inputs)


def read_sliding(path: Path, letters: str, keys: str) -> object:
    """Read the log of turning joints with other types of joints."""
    types: list[JointType] = [TYPES[letter] for letter in letters]
    return read_arm_log(log_of(path), types, written("m.toml", keys))


def test_what_cannot_be_used(tmp_path: Path, refusals: Any, monkeypatch: pytest.MonkeyPatch):
    """Assert that unusable logs, maps and files of arms are refused in one line with a remedy."""
    monkeypatch.chdir(tmp_path)
    log = Path("run.csv")
    calls: dict[str, Callable[[], object]] = {
        name: lambda made=made, joints=joints: read_arm_log(log_of(log, **made), TURNING * joints)
        for name, (made, joints) in LOGS.items()
    }
    for key in KEYS:
        text = f"{key} = 100.0\n"
        calls[f"a map's {key}"] = lambda t=text: read_arm_log(
            log_of(log), TWO, written("m.toml", t)
        )
    for name, (keys, letters) in SLIDING.items():
        text = keys.replace("{}", NAMES[0].format(2))
        calls[name] = partial(read_sliding, log, letters, text)
    for name, scales in RESTING.items():
        calls[name] = lambda one=scales: read_arm_log(log_of(log), TWO, scaled(one))
    for name, (own, other) in TWICE.items():
        calls[name] = lambda own=own, other=other: read_arm_log(twice(log, own, other), TWO)
    calls["no common samples"] = lambda: read_arm_log(without_common_samples(log_of(log)), TWO)
    for name, text in ARMS.items():
        calls[f"an arm: {name}"] = lambda text=text: read_arm(written("arm.toml", text))
    refusals(calls | {"an arm that is not there": lambda: read_arm(Path("no.toml"))})


def test_a_joint_may_rest_while_another_one_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that one braked joint is reported as resting, and so is one whose map clamps it."""
    monkeypatch.chdir(tmp_path)
    path = log_of(Path("run.csv"))
    soft = BRAKED | {"link_position_2": 0.7}  # by 0.5 rad
    maps = [*map(scaled_by, ({}, BRAKED, soft)), "motor_position_2 = 0\n"]
    found = [read_arm_log(path, TWO, written("map.toml", text)).resting for text in maps]
    assert found == [(), (2,), (2,), (2,)]


def test_a_joint_that_is_held_moves_its_link_more_than_its_motor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Assert that only a joint that moves far is warned of, in an arm."""
    monkeypatch.chdir(tmp_path)
    path = log_of(Path("run.csv"))
    for link, warned in ((0.5, False), (2.0, True)):
        scales = scaled({"motor_position_2": 0.1 * link, "link_position_2": link})
        warnings = read_arm_log(path, TWO, scales).warnings
        assert any("times as much" in warning for warning in warnings) == warned


def test_a_gap_of_one_joint_divides_the_recordings_of_all(tmp_path: Path):
    """Assert that a missing value of one joint divides the recordings of all joints."""
    log = read_arm_log(log_of(tmp_path / "run.csv", bad="nan"), TWO)
    assert [len(recording) for recording in log.recordings] == [700, 799]
    assert log.recordings[1].start_time == pytest.approx(701 * 0.002)


def test_samples_that_a_fast_joint_shows_to_be_lost_are_put_back_in_all(tmp_path: Path):
    """Assert that samples found lost in a fast joint are restored in a slow one too."""
    rng = np.random.default_rng(7)
    t = 0.002 * np.arange(3000)
    fast, slow = np.sin(6.0 * t), 0.01 * np.sin(0.5 * t)
    sides = [fast, fast + 0.02 * np.sin(9.0 * t), slow, slow + 0.002 * np.sin(3.0 * t)]
    positions = np.column_stack(sides) + 1e-5 * rng.normal(size=(3000, 4))
    torques = np.column_stack((np.cos(7.0 * t), np.cos(8.0 * t)))
    kept = np.setdiff1d(np.arange(3000), 170 * np.arange(1, 17))
    names = "link_position_1,motor_position_1,link_position_2,motor_position_2"
    rows = np.column_stack((t[: len(kept)], positions[kept], torques[kept]))
    path = tmp_path / "run.csv"
    header = f"time,{names},motor_torque_1,motor_torque_2"
    np.savetxt(path, rows, "%.8g", ",", header=header, comments="")
    (recording,) = read_arm_log(path, TWO).recordings
    assert recording.positions.shape == (3000, 4)
    assert np.abs(recording.positions - positions).max() < 2e-3


def test_late_stamps_are_judged_by_all_joints(tmp_path: Path):
    """Assert that delayed stamps of a noisy joint are judged by another joint's smoothness."""
    names = [name.format(joint) for joint in (1, 2) for name in NAMES]
    t = 0.002 * np.arange(1500)
    rng = np.random.default_rng(4)
    turned, noise = np.radians(20.0) * np.sin(3.0 * t), 1e-3 * rng.normal(size=(2, len(t)))
    still = 0.01 * np.sin(2.0 * t)
    joint = [turned, turned + 0.01 * np.sin(9.0 * t), np.cos(7.0 * t)]
    other = [still + noise[0], still + 0.003 * np.sin(9.0 * t) + noise[1], np.cos(7.0 * t)]
    late = np.sort(t + 0.002 * rng.uniform(0.0, 0.9, len(t)))
    table = np.column_stack(
        (late, *np.degrees([*joint[:2]]), joint[2], *np.degrees(other[:2]), other[2])
    )
    path = tmp_path / "late.csv"
    np.savetxt(
        path, table, fmt="%.9f", delimiter=",", header=",".join(["time [s]", *names]), comments=""
    )
    (recording,) = read_arm_log(path, TWO).recordings
    np.testing.assert_allclose(recording.positions[:, 1], turned, atol=1e-9)
    np.testing.assert_allclose(recording.positions[:, 3], other[0], atol=1e-9)


def test_a_joint_that_slides(tmp_path: Path):
    """Assert that a linear axis has positions in m and its input in N, directly or by a screw."""
    path = log_of(tmp_path / "run.csv")
    turned = read_arm_log(path, TWO).recordings[0]
    header, _, rows = path.read_text().partition("\n")
    slide = header.replace("motor_torque_2 [N m]", "motor_force_2 [kN]")
    slide = slide.replace("position_2 [deg]", "position_2 [mm]")
    path.write_text(f"{slide}\n{rows}")
    types = TYPES["R"], TYPES["P"]
    log = read_arm_log(path, types)
    assert log.input_units == ("N m", "N")
    found, per_mm = log.recordings[0], np.pi / 180.0 / 1e-3
    np.testing.assert_array_equal(found.positions[:, :2], turned.positions[:, :2])
    np.testing.assert_allclose(found.positions[:, 2:] * per_mm, turned.positions[:, 2:])
    np.testing.assert_allclose(found.inputs, turned.inputs * [1.0, 1e3])
    turning = slide.replace("motor_position_2 [mm]", "motor_position_2 [deg]")
    path.write_text(f"{turning}\n{rows}")
    screw = tmp_path / "map.toml"
    screw.write_text("lead_2 = 0.36\n")  # m per turn
    behind = read_arm_log(path, types, screw).recordings[0]
    np.testing.assert_allclose(behind.positions, found.positions)


def test_an_arm_with_slides(tmp_path: Path):
    """Assert that angles are read in degrees, and that joints turn unless listed as slides."""
    path = tmp_path / "arm.toml"
    path.write_text("[arm]\nlengths = [0.0, 0.3]\nslides = {1 = 90.0}\n")
    assert read_arm(path).slides == (pytest.approx(np.pi / 2), None)
    path.write_text("[arm]\nlengths = [0.1, 0.3]\n")
    assert read_arm(path).types == TWO


def test_a_slide_beside_other_joints_has_no_scale_of_its_own(tmp_path: Path):
    """Assert a warning of scales for a single axis only, as weights in an arm vary."""
    path = log_of(tmp_path / "run.csv")
    header, _, rows = path.read_text().partition("\n")
    header = header.replace("position_2 [deg]", "position_2 [mm]").replace("2 [N m]", "2 [N]")
    table = np.loadtxt(rows.splitlines(), delimiter=",")
    table[:, 4] += 8.0 * np.sin(11.0 * table[:, 0]) + 3.0 * np.sin(29.0 * table[:, 0])
    table[:, 5] = 0.985 * table[:, 4] + 0.01 * np.random.default_rng(1).normal(size=len(table))

    def warned(columns: list[int], types: tuple[JointType, ...]) -> bool:
        names = [header.split(",")[column] for column in columns]
        np.savetxt(path, table[:, columns], "%.6f", ",", header=",".join(names), comments="")
        return any("times as far" in word for word in read_arm_log(path, types).warnings)

    assert not warned([*range(7)], (*TURNING, TYPES["P"]))
    header = header.replace("_1 ", "_3 ").replace("_2 ", "_1 ")
    assert warned([0, 4, 5, 6], (TYPES["P"],))


def test_a_named_input_comes_before_a_force(tmp_path: Path):
    """Assert that a slide's current is its input, in preference to an unassigned force."""
    path = log_of(tmp_path / "run.csv")
    header, _, rows = path.read_text().partition("\n")
    header = header.replace("position_2 [deg]", "position_2 [mm]")
    header = header.replace("motor_torque_2 [N m]", "force_2 [N]")
    path.write_text(f"{header}\n{rows}")
    types = (*TURNING, TYPES["P"])
    assert read_arm_log(path, types).input_units == ("N m", "N")
    extended = [f"{row},{row.rsplit(',', 1)[1]}" for row in rows.splitlines()]
    path.write_text("\n".join([f"{header},motor_current_2 [A]", *extended]))
    assert read_arm_log(path, types).input_units == ("N m", "A")
