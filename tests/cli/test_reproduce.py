"""``flexid reproduce`` from the command line."""

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def reproduced(tmp_path_factory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Return the finished command, run once in a process of its own, and its directory."""
    out = tmp_path_factory.mktemp("reproduced") / "new" / "directory"
    command = [sys.executable, "-c", "from flexid.cli.main import main; main()"]
    run = subprocess.run(
        [*command, "reproduce", "--out", str(out)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    return run, out


def test_it_writes_figures_and_result_and_nothing_else(reproduced):
    """Assert that tables are printed, and that Figures 1 to 5 and that of Theorem 1 are written."""
    run, out = reproduced
    assert run.returncode == 0, run.stderr
    assert "Claims of the paper" in run.stdout
    assert "Traceback" not in run.stderr
    names = [*(f"figure{number}" for number in range(1, 6)), "theorem1"]
    expected = {f"{name}.{extension}" for name in names for extension in ("png", "pdf")}
    assert {file.name for file in out.iterdir()} == expected | {"result.json", "report.html"}
    assert all(file.stat().st_size > 5000 for file in out.iterdir())


def test_result_has_the_agreed_keys(reproduced):
    """Assert the shape of result.json that others rely on."""
    _, out = reproduced
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert set(result["readings"]) == {"1,2,3", "1,1,3"}
    for reading in result["readings"].values():
        errors = reading["parameter_errors_at_30s"]
        assert set(errors) == {"theta1", "theta2", "alpha1", "alpha2"}
        assert reading["max_tracking_error_20_30"] > 0
        assert len(reading["poles"]) == 4
    assert {"key", "source", "statement", "verdict", "findings"} == set(result["claims"][0])
    assert result["provenance"]["flexid_version"]


def test_json_is_the_document(reproduced, flexid):
    """Assert that --json prints what result.json holds, and no table."""
    _, out = reproduced
    printed = flexid("reproduce", "--json")
    assert printed.status == 0
    assert json.loads(printed.stdout) == json.loads((out / "result.json").read_text("utf-8"))
