"""The room in which the paper's closed loop is played, in a browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from browser import Watched, serious_faults

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.thorough


def cell(page: Page, column: int) -> str:
    """The tracking error of this run, or of the pinned one."""
    return page.inner_text(f"#play-figures tbody tr:first-child td:nth-child({column + 1})")


def test_the_misprint_is_one_click_away(page: Page, empty_address: str):
    """Assert that the other reading is a click, beside the first, and that a link repeats it."""
    watched = Watched(page)
    page.goto(empty_address)
    page.wait_for_selector("#file:enabled")
    page.click("nav >> text=Play")
    page.wait_for_selector("#play-figures table")
    assert cell(page, 1) == cell(page, 2) == "0.00082 rad"
    page.check("input[value='1,1,3']")
    page.wait_for_selector("#play-figures td:has-text('0.27 rad')")
    assert cell(page, 2) == "0.00082 rad"
    page.wait_for_selector("#play-charts .chart.wide:has-text('V of Theorem 1')")
    assert serious_faults(page) == []
    again = page.url
    page.goto("about:blank")
    page.goto(again)
    page.wait_for_selector("#play-figures td:has-text('0.27 rad')")
    assert page.is_checked("input[value='1,1,3']")
    assert page.is_hidden("#room-identify")
    assert watched.complaints == []


def test_a_slider_is_moved_pinned_and_put_back(page: Page, empty_address: str):
    """Assert that keys move a slider, that what they give can be pinned, and Table I comes back."""
    page.goto(f"{empty_address}?room=play&pin=none")
    page.wait_for_selector("#play-figures table")
    assert cell(page, 2) == ""
    page.focus("input[name=k]")
    for _ in range(15):
        page.keyboard.press("ArrowLeft")
    page.wait_for_selector("#play-figures td:not(:has-text('0.00082 rad'))")
    page.wait_for_url("**k=**")
    label = page.get_attribute("input[name=k]", "aria-valuetext")
    assert label is not None
    assert label.endswith("1/s")
    assert float(label.split()[0]) < 50.0
    page.click("text=Pin this run")
    page.wait_for_url("**pin.k=**")
    page.click("[data-kind=reset]")
    page.wait_for_url(lambda url: "k=" not in url)
    page.wait_for_selector("#play-figures td:has-text('0.00082 rad')")


def test_a_hostile_room_does_nothing(page: Page, empty_address: str):
    """Assert that values that cannot be meant are refused where one sees it."""
    page.goto(f"{empty_address}?room=play&k=%3Cscript%3Ealert(1)%3C/script%3E")
    page.wait_for_selector("#play-figures table")
    assert "give a number from 5 to 200" in page.inner_text("#play-problem")
    assert cell(page, 1) == "0.00082 rad"
    page.goto(f"{empty_address}?room=play&joint_stiffness=-1e300")
    page.wait_for_selector("#play-problem .problem")
    page.check("input[value='1,1,3']")
    page.wait_for_selector("#play-figures td:has-text('0.27 rad')")
    assert page.inner_text("#play-problem") == ""
