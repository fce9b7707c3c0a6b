"""The pages about real logs: their column maps read the logs that they are about."""

import hashlib
from pathlib import Path

import pytest

from flexid.recording.read import read_log

PAGE = Path(__file__).parents[2] / "docs" / "real-logs.md"
LOGS = {  # column map, samples, sample time in s, unit of the input, and what is warned of
    "ist-flexible-arm/ist_square_1p5V.csv": ("columns_voltage_arm.toml", 2001, 0.01, "V", ""),
    "dfki-pendulum/ddp.csv": ("columns_pendulum.toml", 3000, 0.002, "N m", "no link_position"),
    "kr300/kr300_A.csv": ("columns_kuka_axis_1.toml", 2501, 0.004, "N m", ""),
    "kr300/kr300_B.csv": ("columns_kuka_axis_1.toml", 2501, 0.004, "N m", ""),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_page_s_column_map_reads_its_log(shared_data, examples, name):
    """Assert that the log is the one whose digest the page shows, and that all of it is read."""
    columns, count, sample_time, unit, words = LOGS[name]
    path = shared_data / name
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert digest[:16] in PAGE.read_text(encoding="utf-8")
    log = read_log(path, examples / columns)
    assert sum(len(recording) for recording in log.recordings) >= count - 1
    assert log.recordings[0].sample_time == pytest.approx(sample_time, rel=2e-3)
    assert log.recordings[0].input_unit == unit
    assert bool(log.warnings) == bool(words)
    assert words in " ".join(log.warnings)
    assert not any("did you mean" in warning for warning in log.warnings)
