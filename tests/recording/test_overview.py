"""What a file holds, before anybody says which column is which."""

from pathlib import Path

import polars as pl
import pytest

from flexid.recording.overview import overview


def test_names_that_say_it_all(tmp_path: Path):
    """Assert that columns, units, first values and channels are found."""
    path = tmp_path / "a.csv"
    rows = "".join(f"{k},{k}.50,1,x\n" for k in range(30))
    path.write_text(f"time [ms],q_motor_deg,tau,other\n{rows}")
    found = overview(path)
    assert found.rows == 30
    assert [(c.header, c.unit) for c in found.columns] == [
        ("time [ms]", "ms"),
        ("q_motor_deg", "deg"),
        ("tau", ""),
        ("other", ""),
    ]
    assert found.columns[1].cells == ("0.50", "1.50", "2.50", "3.50", "4.50")
    assert found.channels == {
        "time": "time [ms]",
        "motor_position": "q_motor_deg",
        "motor_torque": "tau",
    }
    assert found.unclear == ""


def test_names_that_do_not(tmp_path: Path):
    """Assert that the reason is given, and what can be guessed all the same."""
    path = tmp_path / "a.csv"
    path.write_text("t,enc1,tau\n" + "".join(f"{k},{k},{k}\n" for k in range(30)))
    found = overview(path)
    assert "motor_position" in found.unclear
    assert found.channels == {"time": "t", "motor_torque": "tau"}


def test_typed_columns(tmp_path: Path):
    """Assert that Parquet is looked into as text is, and that empty cells stay empty."""
    path = tmp_path / "a.parquet"
    pl.DataFrame({"time": [0.0, 0.1], "motor_position": [None, 1 / 3]}).write_parquet(path)
    found = overview(path)
    assert found.rows == 2
    assert found.columns[0].cells == ("0", "0.1")
    assert found.columns[1].cells == ("", "0.333333333")


def test_long_cells_are_cut(tmp_path: Path):
    """Assert that no cell fills the page."""
    path = tmp_path / "a.csv"
    path.write_text(f"time,text\n0,{'x' * 5000}\n1,y\n")
    assert len(overview(path).columns[1].cells[0]) < 30


def test_signals_of_a_file(tmp_path: Path):
    """Assert that a file of signals says what each is."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["run/time"] = [0.0, 0.1, 0.2]
        file["run/motor_position"] = [0.0, 0.1, 0.2]
    found = overview(path)
    assert found.rows == 3
    assert {c.header for c in found.columns} == {"run/time", "run/motor_position"}
    assert all("3 values" in c.kind for c in found.columns)
    assert found.channels["motor_position"] == "run/motor_position"
