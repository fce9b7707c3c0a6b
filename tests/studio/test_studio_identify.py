"""Identification of a log in the studio, in a browser."""

import json
import re
from pathlib import Path
from urllib.request import Request, urlopen

import pytest

from browser import Watched, serious_faults


def tab_to(page, selector: str) -> None:
    """Move the focus to an element by the keyboard."""
    for _ in range(80):
        page.keyboard.press("Tab")
        if page.evaluate("(s) => document.activeElement?.matches(s)", selector):
            return
    raise AssertionError(f"the keyboard does not lead to {selector}")


def send(page, log: Path) -> None:
    """Upload a log when the page is ready."""
    page.wait_for_selector("#file:enabled")
    page.set_input_files("#file", log)


def test_by_keyboard_from_a_log_to_its_files(page, address: str, tmp_path: Path):
    """Assert that check, terms, identification, another run and files need no mouse."""
    watched = Watched(page)
    page.goto(address)
    page.wait_for_selector("#run-form")
    assert "1000 Hz" in page.inner_text("#check")
    tab_to(page, "#choose-terms")
    page.keyboard.press("ArrowDown")
    for term in ("gravity", "motor_viscous"):
        tab_to(page, f"input[value={term}]")
        page.keyboard.press("Space")
        assert page.is_checked(f"input[value={term}]")
    tab_to(page, "#run-form button")
    page.keyboard.press("Enter")
    page.wait_for_selector("#found")
    assert "terms=gravity%2Cmotor_viscous" in page.url
    report = page.frame_locator("#report")
    table = report.locator(".lead table").inner_text()
    assert re.search(r"joint_stiffness\s+(100\.\d+|99\.9\d+)", table)
    report.locator(".chart").nth(2).wait_for()
    frame = page.locator("#report").bounding_box()
    assert frame is not None
    assert frame["height"] > 2000.0  # all terms
    assert serious_faults(page) == []

    tab_to(page, "[href='#found']")  # the page's messages link there
    tab_to(page, "[href$='report.html']")
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    assert "joint_<wbr>stiffness" in download.value.path().read_text()
    tab_to(page, "[href$='estimate.json']")
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    download.value.save_as(tmp_path / "estimate.json")
    estimate = json.loads((tmp_path / "estimate.json").read_text())
    assert estimate["choices"]["terms"] == ["gravity", "motor_viscous"]
    assert str(tmp_path.parent.parent) not in json.dumps(estimate["provenance"])

    tab_to(page, "[data-target=mjcf]")
    page.keyboard.press("Enter")
    page.wait_for_selector("#export-state a")
    assert page.inner_text("#export-state a") == "mjcf.zip"
    assert watched.complaints == []
    assert {url.split("/")[2] for url in watched.requests} == {address.split("/")[2]}


@pytest.mark.thorough
def test_a_log_is_sent_and_its_columns_mapped(page, empty_address: str, tmp_path: Path):
    """Assert that columns with unclear names are mapped by hand, with units, and checked."""
    log = tmp_path / "raw.csv"
    rows = [f"{k},{k % 50},{(k % 50) * 1.1},{(-1) ** (k // 25)}" for k in range(400)]
    log.write_text("\n".join(["a,b,c,d", *rows]))
    page.goto(empty_address)
    send(page, log)
    page.wait_for_selector("#columns-state .problem")
    assert "there is no" in page.inner_text("#columns-state")
    for channel, column, unit in (
        ("time", "a", "ms"),
        ("link_position", "b", "deg"),
        ("motor_position", "c", "deg"),
        ("motor_torque", "d", "mN m"),
    ):
        page.select_option(f"[name='column.{channel}']", column)
        page.select_option(f"[name='unit.{channel}']", unit)
    page.fill("[name='scale.time']", "10")
    page.keyboard.press("Tab")
    page.wait_for_selector("text=100 Hz")
    checked = page.inner_text("#check")
    assert "Gaps" in checked
    assert "scale.time=10" in page.url
    assert "chosen below" in page.inner_text("#columns-state")
    page.select_option("[name='unit.motor_position']", "rad")
    page.wait_for_selector("#check .problem")
    assert serious_faults(page) == []


@pytest.mark.thorough
def test_a_hostile_log_does_nothing(page, empty_address: str, tmp_path: Path):
    """Assert that markup in names of columns and of the file is shown as text."""
    watched = Watched(page)
    evil = "<img src=x onerror=alert(1)>"
    log = tmp_path / f"{evil}.csv"
    log.write_text(
        f"time [s],motor_position,{evil},<script>alert(2)</script>,{{{{7*7}}}}\n"
        + "".join(f"{0.01 * k},{k % 40},1,2,3\n" for k in range(300))
    )
    page.goto(empty_address)
    send(page, log)
    page.wait_for_selector("#columns-title")
    text = page.inner_text("#columns")
    assert "alert(2)" in page.content()
    assert "{{7*7}}" in page.inner_text("#columns") or "{{7*7}}" in page.content()
    assert "49" not in text
    assert page.locator("main img, main script").count() == 0
    assert watched.complaints == []


@pytest.mark.parametrize(
    "path", ["files/x/estimate.json", "files/../../etc/passwd", "assets/..%2f..%2f__init__.py"]
)
def test_nothing_else_is_readable(empty_address: str, path: str):
    """Assert that paths give access to no other file."""
    with pytest.raises(OSError, match="404"):
        urlopen(Request(f"{empty_address}{path}"), timeout=10)


@pytest.mark.thorough
def test_a_log_is_named_from_where_the_studio_was_started(page, start, short_log, monkeypatch):
    """Assert that a relative path leads to the log, also in later windows."""
    monkeypatch.chdir(short_log.parent.parent)
    with start(short_log.relative_to(Path.cwd())) as address:
        for _ in range(2):
            page.goto(address)
            page.wait_for_selector("#run-form")
