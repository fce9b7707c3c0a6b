"""A page in a browser: alone, watched, hostile, by day, by night, small and printed."""

from __future__ import annotations

import pytest
from made_page import made_page

from browser import Watched, serious_faults
from flexid.report.page import Command, Presenter, page_html
from flexid.report.terminal import Column, Table

HOSTILE = '"><img src=x onerror=alert(1)></script><script>alert(2)</script>{{ 7 * 7 }}'
STROKE = "() => getComputedStyle(document.querySelector('.chart path[stroke]')).stroke"


@pytest.fixture
def opened(browser, tmp_path):
    """Return a function that opens a page from an empty folder, watched."""

    def open_page(made, width=1280, **options):
        path = tmp_path / "report.html"
        path.write_text(page_html(made), encoding="utf-8")
        page = browser.new_page(viewport={"width": width, "height": 844})
        page.emulate_media(**options)
        watched = Watched(page)
        page.goto(path.as_uri())
        return page, watched

    yield open_page
    for page in (page for context in browser.contexts for page in context.pages):
        page.close()


def test_a_page_asks_for_nothing_and_may_ask_for_nothing(opened):
    """Assert that a page makes no request, and its policy stops what somebody puts into it."""
    page, watched = opened(made_page())
    page.wait_for_timeout(200)
    assert (watched.requests, watched.complaints) == ([page.url], [])
    page.evaluate(
        """async () => {
            await fetch("http://127.0.0.1:9/").catch(() => 0);
            const script = document.createElement("script");
            script.textContent = "window.ran = true";
            document.body.append(script);
        }"""
    )
    assert page.evaluate("window.ran") is None
    assert any("Connecting to" in text for text in watched.complaints)
    assert any("inline script" in text for text in watched.complaints)
    assert watched.requests == [page.url]


def test_how_to_repeat_it_says_only_what_is_known():
    """Assert that a result without provenance has no table of it, and without a command nothing."""
    table = Table("Values", [Column("name")])
    shown = Presenter(lambda _: ("Title", "subject"), lambda _: [table], lambda _: {})
    assert shown.page((None,), (), (), "").sections == []
    (origin,) = shown.page((None,), (), (), "flexid watch -").sections
    assert origin.content == [Command("flexid watch -")]


@pytest.mark.thorough
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_serious_fault(opened, scheme):
    """Assert that axe-core finds nothing that keeps people out, by day and by night."""
    page, _ = opened(made_page(), color_scheme=scheme)
    assert serious_faults(page) == []


@pytest.mark.thorough
def test_hostile_words_are_text(opened):
    """Assert that markup from a log is shown as it is, in figures too, and does nothing."""
    page, watched = opened(made_page(HOSTILE))
    assert page.locator("h1").inner_text() == HOSTILE
    legend = "".join(page.locator(".chart").first.locator("text").all_text_contents())
    assert HOSTILE in legend.replace("\n", " ")
    assert page.locator("img, script").count() == 0
    assert page.title().startswith(HOSTILE)
    assert watched.complaints == []


@pytest.mark.thorough
def test_words_and_signs_beside_colours(opened):
    """Assert that a verdict is a word with a sign of its own."""
    page, _ = opened(made_page())
    sign = "element => getComputedStyle(element, '::before').content"
    cells = page.locator(".lead td.tone")
    assert cells.all_inner_texts() == ["determined", "weak", "lost"]
    signs = [cell.evaluate(sign) for cell in cells.all()]
    assert len(set(signs)) == 3
    assert "none" not in signs


@pytest.mark.thorough
def test_figures_take_the_colours_of_the_page(opened):
    """Assert that strokes are light in the dark, and dark on paper."""
    page, watched = opened(made_page())
    by_day = page.evaluate(STROKE)
    page.emulate_media(color_scheme="dark")
    by_night = page.evaluate(STROKE)
    page.emulate_media(color_scheme="dark", media="print")
    assert by_day == page.evaluate(STROKE) != by_night
    assert "none" not in (by_day, by_night)
    assert page.pdf(format="A4").startswith(b"%PDF")
    assert watched.complaints == []


@pytest.mark.thorough
def test_a_telephone_scrolls_figures(opened):
    """Assert that a narrow window is no wider than it is, and that figures keep readable text."""
    page, _ = opened(made_page(), width=390)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    heights = [one.bounding_box()["height"] for one in page.locator(".chart text").all()[:20]]
    assert min(heights) > 8.0
