"""The room in which a stream is watched, in a browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from browser import Watched, serious_faults

if TYPE_CHECKING:
    from playwright.sync_api import Page


def health(page: Page, words: str) -> None:
    """Wait until the health is so."""
    page.wait_for_selector(f"#live-health .word:text-is('{words}')")


def test_a_drive_converges_changes_and_loses_an_encoder(page: Page, empty_address: str):
    """Assert that a path through the room shows values, and what the health makes of changes."""
    watched = Watched(page)
    page.goto(empty_address)
    page.wait_for_selector("#file:enabled")
    page.click("nav >> text=Live")
    page.wait_for_url("**room=live**")
    page.click("button[data-kind=live-start]")
    health(page, "Converged")
    stiffness = "#live-table tr:has-text('joint stiffness')"
    assert "true: 100" in page.inner_text(stiffness)
    value = float(page.inner_text(f"{stiffness} td:nth-child(2)"))
    assert value == pytest.approx(100.0, rel=0.05)
    page.locator("#live-charts canvas").nth(5).wait_for()
    page.check("input[name=loaded]")
    health(page, "Inconsistent")
    health(page, "Converged")
    page.wait_for_selector("#live-table tr:has-text('link inertia'):has-text('true: 1.5')")
    page.check("input[name=unplugged]")
    health(page, "Sensor fault")
    assert "n encoder stands still" in page.inner_text("#live-health")
    page.wait_for_selector("#live-more:has-text('of a stuck encoder')")
    assert serious_faults(page) == []
    page.click("button[data-kind=live-pause]")
    page.wait_for_selector("#live-line:has-text('Paused')")
    page.click("button[data-kind=live-start]")
    page.wait_for_selector("#live-line:has-text('Running')")
    page.click("button[data-kind=live-stop]")
    page.wait_for_selector("#live-line:has-text('Stopped')")
    assert page.is_visible("#live-table table")
    assert watched.complaints == []


def test_keys_suffice(page: Page, empty_address: str):
    """Assert that a stream is started, changed and stopped without a mouse."""
    page.goto(f"{empty_address}?room=live&pace=16")
    page.wait_for_selector("#live-controls select")
    assert page.input_value("#live-form select[name=pace]") == "16"
    page.focus("#live-form select[name=pace]")
    for place in ("loaded", "unplugged"):
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.name") == place
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    health(page, "Converged")
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Space")
    health(page, "Sensor fault")
    page.wait_for_url("**unplugged=yes**")
    for _ in range(3):
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.wait_for_selector("#live-line:has-text('Stopped')")


def test_the_log_of_the_command_line_is_played_again(page: Page, address: str):
    """Assert that a link chooses it, that it ends, and that no other file can be named."""
    page.goto(f"{address}?room=live&source=replay&pace=16&log=../../etc/passwd")
    page.click("button[data-kind=live-start]")
    page.wait_for_selector("#live-line:has-text('at its end')")
    health(page, "Converged")
    assert "4000 of 4000" in page.inner_text("#live-more")
    page.goto(f"{address}?room=live&source=/etc/passwd")
    page.wait_for_selector("#live-problem .problem")
    assert "drive, replay, follow" in page.inner_text("#live-problem")
