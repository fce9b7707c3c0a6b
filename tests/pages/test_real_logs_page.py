"""Numbers of the page on real logs, which the page's own commands print."""

import contextlib
import re
from pathlib import Path

import pytest
from page_blocks import ROOT, blocks
from page_output import agrees
from run_page import command_output, commands

LOGS = {  # where the logs lie, by their names on the page
    "ist_square_1p5V.csv": "ist-flexible-arm/ist_square_1p5V.csv",
    "ist_prbs.csv": "ist-flexible-arm/ist_prbs.csv",
    "emps.csv": "emps/emps_train.csv",
    "pulses.csv": "emps/emps_pulses.csv",
    "kr300_B.csv": "kr300/kr300_B.csv",
    "quanser.csv": "quanser-two-stage/lqr_10deg.csv",
    "ddp.csv": "dfki-pendulum/ddp.csv",
}
UNSHOWN = (  # commands behind the page's tables
    "flexid identify ist_prbs.csv --columns examples/columns_voltage_arm.toml",
    "flexid identify pulses.csv --columns pulses.toml",
    "flexid identify pulses.csv",
)
INTERVAL = re.compile(r"[-−]?[\d.]+ \[[^]]+\](?!\()")


@pytest.mark.thorough
def test_the_page_shows_what_is_printed(
    shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Assert the output below each command of the page, and each interval of its text."""
    monkeypatch.setenv("COLUMNS", "80")
    text = (ROOT / "docs" / "real-logs.md").read_text(encoding="utf-8")
    for name, log in LOGS.items():
        (tmp_path / name).symlink_to(shared_data / log)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    sums = re.findall(r"`(motor_torque = \{ sum = .*?\})`", text)
    (tmp_path / "pulses.toml").write_text("\n".join(sums), encoding="utf-8")
    printed = []
    with contextlib.chdir(tmp_path):
        for block in blocks(text):
            if block.file is not None:
                Path(block.file).write_text(block.text, encoding="utf-8")
            for _, command, shown in commands(block) if block.language == "console" else ():
                if command.startswith("flexid"):
                    printed.append(command_output(command)[1])
                    assert not shown or agrees(f"{shown} ...", printed[-1]), printed[-1]
        printed += [command_output(command)[1] for command in UNSHOWN]
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    wrong = [
        one
        for one in INTERVAL.findall(" ".join(prose.split()))
        if not any(agrees(f"... {one} ...", output) for output in printed)
    ]
    assert wrong == []
