"""Text formats of loggers, spreadsheets and NumPy, as a log and as a stream."""

from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import joint_log
import numpy as np
import pytest

from flexid.recording import read_log
from flexid.recording.layout import layout_of
from flexid.streaming.incoming import TextSamples, TextStream

COLUMNS = joint_log.without(joint_log.joint_columns(500), "velocity")
TEXT = joint_log.csv_text(COLUMNS)
UNITS = "s,rad,rad,N m"
PREAMBLE = "Logger 3000\nRecorded: 2024-05-01, 12:00\nChannels, 6\n\n"


def rows(change: joint_log.Change) -> joint_log.Change:
    """Change each row of numbers."""

    def changed(text: str) -> str:
        header, *lines = text.splitlines()
        return "\n".join([header, *map(change, lines)]) + "\n"

    return changed


def cells(change: joint_log.Change, separator: str = ",") -> joint_log.Change:
    """Change each cell of each row, and the separator."""
    return rows(lambda line: separator.join(map(change, line.split(","))))


def ending(cell: str, header: str = "") -> joint_log.Change:
    """Add a cell to each row, and perhaps one to the header."""
    return lambda text: rows(lambda line: line + cell)(text.replace("\n", header + "\n", 1))


def german(text: str) -> str:
    """Change to decimal commas and semicolons."""
    return text.replace(",", ";").replace(".", ",")


def fortran(cell: str) -> str:
    """Return a number in Fortran's format of double precision."""
    return f"{float(cell):.17E}".replace("E", "D")


def grouped(mark: str, decimal: str = ".") -> joint_log.Change:
    """Change torques to mN m with thousands separators, and others to six decimals."""

    def changed(line: str) -> str:
        *others, torque = line.split(",")
        text = f"{1e3 * float(torque):,.1f}".replace(".", "!").replace(",", mark)
        return ";".join([*(o.replace(".", decimal) for o in others), text.replace("!", decimal)])

    return lambda text: rows(changed)(text).replace(",", ";", 3)


def scaled(line: str) -> str:
    """Return a row with its time in microseconds."""
    time, _, others = line.partition(",")
    return f"{1e6 * float(time):.0f},{others}"


def below(line: str) -> joint_log.Change:
    """Add a line below the header."""
    return lambda text: text.replace("\n", f"\n{line}\n", 1)


def tabbed(text: str) -> str:
    """Change commas to tabs."""
    return text.replace(",", "\t")


def degrees(_: str) -> str:
    """Return the log with the link position in °."""
    columns = {"time": COLUMNS["time"], "link_position [°]": np.degrees(COLUMNS["link_position"])}
    return joint_log.csv_text(columns | joint_log.without(COLUMNS, "time", "link"))


IN_DEGREES = {f"degrees in {code}": code for code in ("utf-8-sig", "latin-1", "utf-16")}
ENCODED = {"Latin-1": "latin-1", **IN_DEGREES}
NOT_STREAMED = ("degrees in utf-16", "carriage returns alone")
READ: dict[str, joint_log.Change] = {
    "semicolons": lambda text: text.replace(",", ";"),
    "tabs": tabbed,
    "blanks around commas": lambda text: text.replace(",", " , "),
    "blanks around tabs": lambda text: text.replace(",", " \t ").replace("\n", " \n "),
    "blanks": lambda text: text.replace(",", " "),
    "aligned by blanks": lambda text: "  " + text.replace(",", "   ").replace("\n", " \n  "),
    "bars": lambda text: text.replace(",", "|"),
    "carriage returns and line feeds": lambda text: text.replace("\n", "\r\n"),
    "mixed ends of lines": lambda text: text.replace("1\n", "1\r\n"),
    "a byte-order mark": lambda text: "\N{ZERO WIDTH NO-BREAK SPACE}" + text,
    "blank lines before": lambda text: "\n\n" + text,
    "blank lines after": lambda text: text + "\n\n\n",
    "all quoted": lambda text: (
        '"' + text.replace("\n", '"\n"').replace(",", '","').removesuffix('"')
    ),
    "quoted": cells(lambda cell: f'"{cell}"'),
    "quoted, with decimal commas": cells(lambda cell: '"' + cell.replace(".", ",") + '"'),
    "decimal commas": german,
    "tabs and decimal commas": lambda text: tabbed(text).replace(".", ","),
    "rows end with a separator": ending(","),
    "all lines end with a separator": lambda text: text.replace("\n", ",\n"),
    "tabs at the ends of rows": lambda text: tabbed(ending(",")(text)),
    "tabs at the ends of lines": lambda text: tabbed(text.replace("\n", ",\n")),
    "tabs at the ends, and none below": lambda text: (
        tabbed(text.replace("\n", ",\r\n")) + "  \r\n\r\n"
    ),
    "an empty first column": lambda text: tabbed("n," + rows(lambda line: "," + line)(text)),
    "an empty last column": lambda text: tabbed(ending(",", ",spare")(text)),
    "an empty column": ending(",", ",spare"),
    "a column of words": ending(",true", ",enabled"),
    "exponents of Fortran": cells(fortran),
    "a Fortran table": lambda text: "# " + cells(fortran, "   ")(text).replace(",", " "),
    "a minus sign": lambda text: text.replace("-", "\N{MINUS SIGN}"),
    "plus signs": cells(lambda cell: f"+{cell}".replace("+-", "-")),
    "Latin-1": lambda text: rows(scaled)(text.replace("time", "time [\N{MICRO SIGN}s]")),
    "commented header, as numpy.savetxt writes it": lambda text: "# " + text,
    "the same with blanks": lambda text: "# " + text.replace(",", " "),
    "comments before the header": lambda text: "# made by hand, at 200 Hz\n%\n// x\n" + text,
    "comment below the header": below("# now the numbers"),
    "units in brackets below the names": below("[s],(rad),(rad),(Nm)"),
    "only the units that matter": below("s,,,Nm"),
    "units in semicolons": lambda text: german(below(UNITS)(text)),
    "a preamble": lambda text: PREAMBLE + below(UNITS)(text),
    "units that convert": lambda text: below("us,rad,rad,N m")(rows(scaled)(text)),
    **dict.fromkeys(IN_DEGREES, degrees),
    "carriage returns alone": lambda text: text.replace("\n", "\r"),
}


def streamed(path: Path) -> np.ndarray:
    """Return the samples of a file read as a stream."""
    with closing(TextSamples(str(path), stop_at_end=True)) as samples:
        return np.concatenate([part for part in samples if len(part)])


@pytest.mark.parametrize("name", READ)
def test_read(tmp_path: Path, name: str) -> None:
    """Assert that log and stream have the values of the text."""
    path = joint_log.written(tmp_path, READ[name](TEXT), ENCODED.get(name, "utf-8"))
    log = read_log(path)
    joint_log.assert_equal_logs(log, joint_log.read_columns(COLUMNS), 1e-12)
    assert all("not used" in warning or "not read" in warning for warning in log.warnings)
    if name not in NOT_STREAMED:
        np.testing.assert_allclose(streamed(path), np.column_stack([*COLUMNS.values()]), rtol=1e-12)


LAST_AS_WORD = rows(lambda line: ",".join([*line.split(",")[:-1], str(line[-1] > "5")]))
REFUSED: dict[str, joint_log.Change] = {
    "apostrophes between thousands": grouped("'"),
    "blanks between thousands": grouped(" "),
    "commas between thousands": grouped(","),
    "points between thousands": grouped(".", ","),
    "whole thousands": lambda text: cells(lambda cell: f"{round(1e4 * float(cell)):,}", ";")(
        text
    ).replace(",", ";", 3),
    "hexadecimal": cells(lambda cell: hex(int(1e4 * float(cell)))),
    "words for numbers": LAST_AS_WORD,
    "parentheses": cells(lambda cell: f"({cell[1:]})" if cell.startswith("-") else cell),
    "a name too many": lambda text: "Log\n" + text.replace("\n", ",enabled\n", 1),
    "units of another column": below("V,rad,rad,N m"),
}


def test_refused_texts(here: Path, golden: Any) -> None:
    """Assert that a log names place and reason, and a stream without any sample the same."""
    found = {}
    for name, change in REFUSED.items():
        path = joint_log.written(Path(), change(TEXT))
        found[name] = joint_log.refused(read_log, path)
        if name != "parentheses":  # few lines have parentheses
            found[f"{name}, as a stream"] = joint_log.refused(streamed, path)
    golden(found)


@pytest.mark.parametrize("cell", ["inf", "?", "1,5", "1_000"])
def test_one_bad_cell(tmp_path: Path, cell: str) -> None:
    """Assert that a log refuses a bad cell by its line, and a stream drops that value alone."""
    lines = [line.replace(",", ";") for line in TEXT.splitlines()]
    lines[300] = ";".join([*lines[300].split(";")[:-1], cell])
    path = joint_log.written(tmp_path, "\n".join(lines) + "\n")
    assert "line 301, column 'motor_torque': " in joint_log.refused(read_log, path)
    samples = streamed(path)
    assert np.flatnonzero(~np.isfinite(samples[:, 3])).tolist() == [299]
    assert np.isfinite(samples[:, :3]).all()


def test_ends_and_beginnings_without_numbers(tmp_path: Path) -> None:
    """Assert no lost sample by null bytes or half a row, and patience with empty cells at first."""
    for end in ("\0" * 4096, "\0" * 2_000_000, "2.5,0.1"):
        path = joint_log.written(tmp_path, TEXT + end)
        (warning,) = read_log(path).warnings
        assert "line 502 was left out, as a last row that is not complete" in warning
        if len(end) < 1_000_000:  # a stream must not wait for the end of such a line
            assert len(streamed(path)) == 500
    lines = TEXT.splitlines()
    for k in range(1, 250):
        lines[k] = ",".join([*lines[k].split(",")[:-1], "" if k % 2 else "nan"])
    samples = streamed(joint_log.written(tmp_path, "\n".join(lines) + "\n"))
    assert np.isnan(samples[:249, 3]).all()
    assert np.isfinite(samples[249:]).all()


@pytest.mark.parametrize("parts", [1, 3, 200])
def test_a_decimal_mark_is_that_of_the_first_lines(parts: int) -> None:
    """Assert that the decimal mark of the first lines holds for all, in parts of any size."""
    lines = ["time [ms];motor_position;motor_torque", *(f"{k};{k % 7};{k % 5}" for k in range(150))]
    lines += ["250;1,234;1", "251;0,5;1", "252;\N{MINUS SIGN}1,234;1", "253;x;1"]
    raw = ("\n".join(lines) + "\n").encode()
    stream = TextStream("stream")
    edges = np.linspace(0, len(raw), parts + 1).astype(int)
    found = [stream.samples(raw[a:b], ended=b == len(raw)) for a, b in pairwise(edges)]
    samples = np.concatenate([part for part in found if len(part)])
    np.testing.assert_array_equal(samples[150:, 1], [1.234, 0.5, -1.234, np.nan])


LAYOUTS = (
    *("a,b\n1,2\n3,4\n", "a,b\n1,2\n", "Version 2\na,b\n1,2\n3,4\n"),
    *("Date,2024,5\na,b,c\n1,2,3\n4,5,6\n", "Rig,7,arm\nRate,9,slow\na,b,c\n1,2,3\n4,5,6\n"),
    *("Version,2,1\n10,20\na,b,c\n1,2,3\n4,5,6\n", "x,y\na,b\n1,2\n3,4\n"),
    *("a,b\ns,V\n1,2\n3,4\n", "# units: ms, V\na,b\n1,2\n3,4\n", "Unit,V\na,b\n1,2\n3,4\n"),
    *("s,V\n1,2\n3,4\n", "a;b,c\n1,5;2\n3,5;4\n", "t [s] q [N m] u\n1 2 3\n4 5 6\n"),
    *(" t [s]  link angle [deg]  u\n1 2 3\n4 5 6\n", "a,,c\n1,2,3\n"),
    *("# a, b\n# c d\n1,2\n3,4\n", "a,b\n\n1,2\n3,4\n", "a,b\nx,y\n", "comment\nx\n"),
    *("a,b\nnan,1\n2,3\n", "a,b,c,d\n0,1,2,3\n0,(1),(2),3\n4,5,6,7\n8,9,1,2\n"),
    *("Rig\na,b,c,d\n0,1,2,\n4,5,6,\n", "Rig\na,b,c\n0,1,2,\n4,5,6,\n"),
)


def test_layouts(golden: Any) -> None:
    """Assert names, units and the first row."""
    found = {}
    for text in LAYOUTS:
        layout = layout_of("log.csv", text.encode())
        found[repr(text)] = f"{layout.names} above line {layout.first_line}"
        rest = "".join(text.splitlines(keepends=True)[layout.first_line - 1 :])
        assert text.encode()[layout.start :].decode() == rest
    golden(found)


@pytest.mark.parametrize("name", ["q_" * 50_000, "[" * 100_000, "-" * 100_000, " " * 100_000])
@pytest.mark.parametrize("separator", [",", " "])
def test_endless_names(name: str, separator: str, tmp_path: Path) -> None:
    """Assert that a name of 100 kB neither hides other columns nor takes minutes."""
    lines = TEXT.splitlines()
    text = "\n".join([f"{lines[0]},{name}x", *(f"{line},0" for line in lines[1:])])
    log = read_log(joint_log.written(tmp_path, text.replace(",", separator)))
    joint_log.assert_equal_logs(log, joint_log.read_columns(COLUMNS))
    assert "not used" in log.warnings[0]
    joint_log.assert_equal_logs(read_log(joint_log.written(tmp_path, name + "\n" + TEXT)), log)
    path = joint_log.written(tmp_path, 2 * name + "x," + "\n".join(lines))
    assert "line 1: " in joint_log.refused(read_log, path)
