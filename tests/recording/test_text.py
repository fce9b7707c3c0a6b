"""Text as loggers, spreadsheets and NumPy write it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from joint_log import csv_text, joint_columns, write_csv

from flexid.errors import RecordingError
from flexid.recording import Log, read_log
from flexid.recording.layout import layout_of

Change = Callable[[str], str]
UNITS = "s,rad,rad,rad/s,rad/s,N m"
PREAMBLE = "Logger 3000\nRecorded: 2024-05-01, 12:00\nChannels, 6\n\n"


def assert_same(log: Log, other: Log) -> None:
    """Assert that two logs hold the same numbers, bit for bit."""
    for one, two in zip(log.recordings, other.recordings, strict=True):
        assert one.sample_time == two.sample_time
        for name in ("link_position", "motor_position", "input", "link_velocity"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def below_header(line: str) -> Change:
    """Return a change that adds a line below the header."""
    return lambda text: text.replace("\n", f"\n{line}\n", 1)


def renamed(**names: str) -> Change:
    """Return a change of the header."""

    def change(text: str) -> str:
        header, _, body = text.partition("\n")
        for old, new in names.items():
            header = header.replace(old, new)
        return f"{header}\n{body}"

    return change


def decimal_commas(text: str) -> str:
    """Return the text as a German spreadsheet writes it."""
    return text.replace(",", ";").replace(".", ",")


READ: dict[str, Change] = {
    "semicolons and decimal commas": decimal_commas,
    "tabs and decimal commas": lambda text: text.replace(",", "\t").replace(".", ","),
    "blanks": lambda text: text.replace(",", " "),
    "aligned by blanks": lambda text: "  " + text.replace(",", "   ").replace("\n", " \n  "),
    "bars": lambda text: text.replace(",", "|"),
    "commented header, as numpy.savetxt writes it": lambda text: "# " + text,
    "the same with blanks": lambda text: "# " + text.replace(",", " "),
    "comments before the header": lambda text: "# made by hand, at 200 Hz\n%\n// x\n" + text,
    "comment below the header": below_header("# now the numbers"),
    "units below the names": below_header(UNITS),
    "units in brackets below the names": below_header("[s],(rad),(rad),(rad/s),[rad/s],(Nm)"),
    "units in a comment": below_header("# " + UNITS),
    "only the units that matter": below_header("s,,,,,Nm"),
    "units in semicolons": lambda text: decimal_commas(below_header(UNITS)(text)),
    "units in round brackets": renamed(
        time="time (s)", link_position="link_position(rad)", motor_torque="motor_torque (N m)"
    ),
    "capitals": renamed(time="TIME", link_position="Link_Position", motor_position="MotorPosition"),
    "blanks in names": renamed(link_position="Link position", motor_torque="Motor-Torque (Nm)"),
    "capitals in units": renamed(time="time [S]", link_position="link_position [RAD]"),
}
READ["capitals in units"] = renamed(link_position="link_position [RAD]")


@pytest.mark.parametrize("name", READ)
def test_read(name: str, tmp_path: Path) -> None:
    """Assert that the text is read as what it says, without a warning."""
    columns = joint_columns()
    path = tmp_path / "other.csv"
    path.write_text(READ[name](csv_text(columns)), encoding="utf-8")
    log = read_log(path)
    assert log.warnings == ()
    assert_same(log, read_log(write_csv(tmp_path, columns)))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16"])
def test_encodings(encoding: str, tmp_path: Path) -> None:
    """Assert that degrees are degrees in every encoding in which a ° is written."""
    columns = joint_columns()
    expected = read_log(write_csv(tmp_path, columns))
    columns["link_position [°]"] = np.degrees(columns.pop("link_position"))
    path = tmp_path / "other.csv"
    path.write_bytes(csv_text(columns).encode(encoding))
    (recording,), (other,) = read_log(path).recordings, expected.recordings
    np.testing.assert_allclose(
        recording.needed_link_position, other.needed_link_position, rtol=1e-12
    )


def test_preamble(tmp_path: Path) -> None:
    """Assert that lines before the names are left out, and said to be; lines count as they do."""
    columns = joint_columns()
    path = tmp_path / "other.csv"
    text = PREAMBLE + below_header(UNITS)(csv_text(columns))
    path.write_text(text)
    log = read_log(path)
    assert_same(log, read_log(write_csv(tmp_path, columns)))
    (warning,) = log.warnings
    assert "lines 1 to 3 were not read, since the column names stand in line 5" in warning
    lines = text.split("\n")
    lines[20] = "oops" + lines[20]
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="line 21, column 'time"):
        read_log(path)


def test_units_below_the_names(tmp_path: Path) -> None:
    """Assert that a row of units converts, and that one that is none of the column's is refused."""
    columns = joint_columns()
    expected = read_log(write_csv(tmp_path, columns))
    columns["time"] = columns["time"] * 1e3
    path = tmp_path / "other.csv"
    path.write_text(below_header("ms" + UNITS[1:])(csv_text(columns)))
    assert read_log(path).recordings[0].sample_time == pytest.approx(0.005, rel=1e-12)
    assert_same_positions(read_log(path), expected)
    path.write_text(below_header("V" + UNITS[1:])(csv_text(columns)))
    with pytest.raises(RecordingError, match=r"'time \[V\]': the unit \[V\] does not measure"):
        read_log(path)


def assert_same_positions(log: Log, other: Log) -> None:
    """Assert that the positions of two logs are the same."""
    for one, two in zip(log.recordings, other.recordings, strict=True):
        np.testing.assert_array_equal(one.needed_link_position, two.needed_link_position)


def test_thousands(tmp_path: Path) -> None:
    """Assert that a comma that may stand between thousands is not taken for a decimal's."""
    columns = joint_columns()
    whole = {
        "time [ms]": np.round(columns["time"] * 1e3),
        "link_position [deg]": np.round(np.degrees(columns["link_position"])),
        "motor_position [deg]": np.round(np.degrees(columns["motor_position"])),
        "motor_torque [mN m]": np.round(1e3 * columns["motor_torque"]),
    }
    rows = zip(*(values.astype(int).tolist() for values in whole.values()), strict=True)
    lines = ["\t".join(whole), *("\t".join(f"{value:,}" for value in row) for row in rows)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="has a comma, and it cannot be known whether"):
        read_log(path)


@pytest.mark.parametrize(
    ("text", "names", "first"),
    [
        ("a,b\n1,2\n3,4\n", ("a", "b"), 2),
        ("a,b\n1,2\n", ("a", "b"), 2),
        ("Version 2\na,b\n1,2\n3,4\n", ("a", "b"), 3),
        ("Date,2024,5\na,b,c\n1,2,3\n4,5,6\n", ("a", "b", "c"), 3),
        ("Rig,7,arm\nRate,9,slow\na,b,c\n1,2,3\n4,5,6\n", ("a", "b", "c"), 4),
        ("Version,2,1\n10,20\na,b,c\n1,2,3\n4,5,6\n", ("a", "b", "c"), 4),
        ("x,y\na,b\n1,2\n3,4\n", ("a", "b"), 3),
        ("a,b\ns,V\n1,2\n3,4\n", ("a [s]", "b [V]"), 3),
        ("s,V\n1,2\n3,4\n", ("s", "V"), 2),
        ("a;b,c\n1,5;2\n3,5;4\n", ("a", "b,c"), 2),
        ("t [s] q [N m] u\n1 2 3\n4 5 6\n", ("t [s]", "q [N m]", "u"), 2),
        ("a,,c\n1,2,3\n", ("a", "unnamed 2", "c"), 2),
        ("# a, b\n# c d\n1,2\n3,4\n", ("a", "b"), 3),
        ("a,b\n\n1,2\n3,4\n", ("a", "b"), 3),
        ("a,b\nx,y\n", ("a", "b"), 2),
        ("a,b\nnan,1\n2,3\n", ("a", "b"), 2),
        ("a,b,c,d\n0,1,2,3\n0,(1),(2),3\n4,5,6,7\n8,9,1,2\n", ("a", "b", "c", "d"), 2),
        ("Rig\na,b,c,d\n0,1,2,\n4,5,6,\n", ("a", "b", "c", "d"), 3),
        ("Rig\na,b,c\n0,1,2,\n4,5,6,\n", ("a", "b", "c", "unnamed 4"), 3),
    ],
)
def test_layout(text: str, names: tuple[str, ...], first: int) -> None:
    """Assert that names, units and the first row are found."""
    layout = layout_of("log.csv", text.encode())
    assert layout.names == names
    assert layout.first_line == first
    assert text.encode()[layout.start :].decode() == "".join(
        text.splitlines(keepends=True)[first - 1 :]
    )


@pytest.mark.parametrize("name", ["q_" * 50_000, "[" * 100_000, "-" * 100_000, " " * 100_000])
@pytest.mark.parametrize("separator", [",", " "])
def test_endless_names(name: str, separator: str, tmp_path: Path) -> None:
    """Assert that a name of a tenth of a megabyte neither hides the others nor takes minutes."""
    columns = joint_columns()
    lines = csv_text(columns).splitlines()
    text = "\n".join([f"{lines[0]},{name}x", *(f"{line},0" for line in lines[1:])])
    path = tmp_path / "other.csv"
    path.write_text(text.replace(",", separator))
    log = read_log(path)
    assert_same(log, read_log(write_csv(tmp_path, columns)))
    assert "not used" in log.warnings[0]
    path.write_text(name + "\n" + csv_text(columns))
    assert_same(read_log(path), log)
    path.write_text(2 * name + "x," + "\n".join(lines))
    with pytest.raises(RecordingError, match="line 1: "):
        read_log(path)
