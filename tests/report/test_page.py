"""A page in a browser: alone, watched, hostile, zoomed, printed."""

from __future__ import annotations

import re

import pytest
from made_page import made_chart, made_other_charts, made_page

from browser import Watched, serious_faults, wait_until
from flexid.report.charts.document import chart_document
from flexid.report.page.render import page_html

UPDATE = "made => flexid.update(document.querySelector('[data-chart]'), made)"
HOSTILE = '"><img src=x onerror=alert(1)></script><script>alert(2)</script>{{ 7 * 7 }}'


@pytest.fixture(scope="module")
def context(browser):
    """Return a window in which nothing has been opened."""
    window = browser.new_context(viewport={"width": 1280, "height": 800})
    window.set_default_timeout(10_000)
    yield window
    window.close()


@pytest.fixture
def opened(context, tmp_path):
    """Return a function that opens a page from an empty folder, watched."""

    def open_page(made, **options):
        path = tmp_path / "report.html"
        path.write_text(page_html(made), encoding="utf-8")
        page = context.new_page()
        page.emulate_media(**options)
        watched = Watched(page)
        page.goto(path.as_uri())
        page.wait_for_selector(".chart-plot canvas")
        return page, watched

    yield open_page
    for page in context.pages:
        page.close()


def test_a_page_asks_for_nothing(opened):
    """Assert that a page opened alone makes one request, that for itself, and no complaint."""
    page, watched = opened(made_page())
    page.wait_for_timeout(200)
    assert watched.requests == [page.url]
    assert watched.complaints == []


def test_a_page_may_ask_for_nothing(opened):
    """Assert that the policy stops a request, and a script, that somebody puts into a page."""
    page, watched = opened(made_page())
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


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_serious_fault(opened, scheme):
    """Assert that axe-core finds nothing that keeps people out, by day and by night."""
    page, _ = opened(made_page(), color_scheme=scheme)
    page.locator(".chart-data summary").last.click()
    page.wait_for_selector(".chart-table")
    assert serious_faults(page) == []


def test_hostile_words_are_text(opened):
    """Assert that markup from a log is shown as it is, and does nothing."""
    page, watched = opened(made_page(HOSTILE))
    page.locator(".chart-data summary").first.click()
    page.wait_for_selector(".chart-table")
    assert page.locator("h1").inner_text() == HOSTILE
    assert HOSTILE in page.locator(".chart-legend").first.inner_text()
    assert HOSTILE in page.locator(".chart-table").first.inner_text()
    assert page.locator("img").count() == 0
    assert page.title().startswith(HOSTILE)
    assert watched.complaints == []


def drag(page, plot):
    """Draw a box over the middle third of a plot."""
    plot.scroll_into_view_if_needed()
    box = plot.locator(".u-over").bounding_box()
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] / 3, middle)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 2 / 3, middle, steps=4)
    page.mouse.up()


def reading(page, plot):
    """What a plot says of the point at the left of it: the time, in seconds."""
    plot.scroll_into_view_if_needed()
    box = plot.locator(".u-over").bounding_box()
    page.mouse.move(box["x"] + 2, box["y"] + box["height"] / 2)
    text = plot.locator("xpath=..").locator(".chart-reading").inner_text()
    found = re.match(r"[\d.]+", text)
    assert found, text
    return float(found[0])


def test_a_zoom_reaches_all_plots_over_time(opened):
    """Assert that a box drawn in one plot zooms those of another figure, and a button ends that."""
    page, _ = opened(made_page())
    plots = page.locator(".chart-plot")
    assert reading(page, plots.nth(0)) == pytest.approx(0.0, abs=0.05)
    drag(page, plots.nth(0))
    for place in range(4):  # two figures of two panels
        if place not in (1, 3):  # whose points are far apart
            assert reading(page, plots.nth(place)) == pytest.approx(10 / 3, abs=0.1)
    page.get_by_role("button", name="Show everything again").nth(1).click()
    for place in (0, 2):
        assert reading(page, plots.nth(place)) == pytest.approx(0.0, abs=0.05)


def test_a_zoom_leaves_other_axes_alone(opened):
    """Assert that a figure over frequency does not follow one over time."""
    page, _ = opened(made_page())
    plots = page.locator(".chart-plot")
    before = plots.nth(4).screenshot()
    drag(page, plots.nth(0))
    assert plots.nth(4).screenshot() == before
    drag(page, plots.nth(4))
    assert plots.nth(4).screenshot() != before


def test_keys_zoom_and_move(opened):
    """Assert that a plot can be zoomed, moved and shown whole without a mouse."""
    page, _ = opened(made_page())
    plot = page.locator(".chart-plot").first
    plot.focus()
    page.keyboard.press("+")
    assert reading(page, plot) == pytest.approx(2.5, abs=0.1)
    page.keyboard.press("ArrowRight")
    assert reading(page, plot) == pytest.approx(3.5, abs=0.1)
    page.keyboard.press("0")
    assert reading(page, plot) == pytest.approx(0.0, abs=0.05)


def test_a_table_behind_every_figure(opened):
    """Assert that each figure has a table with its numbers, units and the names of its lines."""
    page, _ = opened(made_page())
    tables = page.locator(".chart-data")
    assert tables.count() == page.locator("[data-chart]").count() == 5
    tables.first.locator("summary").click()
    page.wait_for_selector(".chart-table")
    first = tables.first.locator("table").first
    headings = first.locator("th").all_inner_texts()
    assert headings == ["time (s)", "95 % band, lower end", "95 % band, upper end", "stiffness"]
    assert first.locator("tbody tr").count() == 501
    last = first.locator("tbody tr").last.locator("td").all_inner_texts()
    assert last == ["10", "-0.644", "-0.444", "-0.544"]


def test_a_label_hides_its_marks(opened):
    """Assert that the legend hides and shows, by key as well, and says so."""
    page, _ = opened(made_page())
    plot = page.locator(".chart-plot").first
    before = plot.screenshot()
    entry = page.locator(".chart-entry", has_text="stiffness").first
    entry.focus()
    page.keyboard.press("Enter")
    assert entry.get_attribute("aria-pressed") == "false"
    assert plot.screenshot() != before
    page.keyboard.press("Enter")
    page.locator("h1").click()
    assert entry.get_attribute("aria-pressed") == "true"
    assert plot.screenshot() == before


def test_data_can_be_replaced(opened):
    """Assert that other data are drawn where a figure is, which stays zoomed and hidden."""
    page, watched = opened(made_page())
    plot, entry = page.locator(".chart-plot").first, page.locator(".chart-entry").first
    document = chart_document(made_chart())
    page.evaluate(UPDATE, document)
    entry.click()
    plot.focus()
    page.keyboard.press("+")
    before = plot.screenshot()
    document["arrays"][1:] = [[value and 2 * value for value in a] for a in document["arrays"][1:]]
    page.evaluate(UPDATE, document)
    assert plot.screenshot() != before
    assert reading(page, plot) == pytest.approx(2.5, abs=0.1)
    assert entry.get_attribute("aria-pressed") == "false"
    assert watched.complaints == []


def test_another_figure_can_be_drawn(opened):
    """Assert that data of another shape make the figure anew, and the old one is gone."""
    page, watched = opened(made_page())
    page.evaluate(UPDATE, chart_document(made_other_charts()[0]))
    holder = page.locator("[data-chart]").first
    assert holder.locator(".chart-plot").count() == 1
    assert holder.locator(".chart-entry").all_inner_texts() == ["model"]
    assert watched.complaints == []


def test_words_and_signs_beside_colours(opened):
    """Assert that a verdict is a word with a sign of its own, and each stroke has its shape."""
    page, _ = opened(made_page())
    sign = "element => getComputedStyle(element, '::before').content"
    cells = page.locator(".lead td.tone")
    assert cells.all_inner_texts() == ["determined", "weak", "lost"]
    signs = [cell.evaluate(sign) for cell in cells.all()]
    assert len(set(signs)) == 3
    assert "none" not in signs


def test_a_page_prints(opened):
    """Assert that a page can be printed, in dark mode too with light figures."""
    page, watched = opened(made_page(), color_scheme="dark")
    colour = "() => getComputedStyle(document.documentElement).getPropertyValue('--paper').trim()"
    assert page.evaluate(colour) == "#14171a"
    assert page.pdf(format="A4").startswith(b"%PDF")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(colour) == "#ffffff"
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(colour) == "#14171a"
    assert watched.complaints == []


def test_figures_follow_the_window(opened):
    """Assert that no figure is wider than a telephone, where columns stand below each other."""
    page, _ = opened(made_page())
    page.set_viewport_size({"width": 390, "height": 844})
    wait_until(page, "document.querySelector('.chart-plot canvas').clientWidth < 390")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
