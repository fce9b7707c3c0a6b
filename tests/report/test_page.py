"""The page of an identification, in a browser: content, security, themes, small screens, print."""

from functools import partial

import pytest

import flexid
from browser import Watched, serious_faults
from flexid.report.page import Command, result_page
from flexid.report.terminal import Column, Table

STROKE = "() => getComputedStyle(document.querySelector('.chart path[stroke]')).stroke"
HOSTILE = "<script>alert(1)<{{ 7 * 7 }}"
FILE = '"><img src=x onerror=alert(2)>.csv'
UNITS = {"time": "s", "link_position": "rad", "motor_position": "rad", "motor_torque": "N m"}
COLUMNS = {name: {"column": f"{HOSTILE}{name}", "unit": unit} for name, unit in UNITS.items()}


@pytest.fixture(scope="module")
def estimate(examples, tmp_path_factory):
    """Return the estimate of the example log, with markup in the names of file and columns."""
    text = (examples / "flexible_joint.csv").read_text()
    header = ",".join(column["column"] for column in COLUMNS.values())
    log = tmp_path_factory.mktemp("log") / FILE
    log.write_text(header + text[text.index("\n") :])
    return flexid.identify(
        log, columns=COLUMNS, terms=["gravity", "motor_viscous"], hold="zero", segment_duration=2.0
    )


@pytest.fixture(scope="module")
def path(estimate, tmp_path_factory):
    """Return the page of the estimate, alone in a folder."""
    path = tmp_path_factory.mktemp("alone") / "report.html"
    estimate.report(path)
    return path


@pytest.fixture
def page(browser, path):
    """Return the page in a browser, and the observed requests and messages."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.watched = Watched(page)
    page.goto(path.as_uri())
    page.wait_for_selector(".chart svg")
    yield page
    page.close()


def test_a_page_asks_for_nothing_and_may_ask_for_nothing(page, path):
    """Assert below 1 MB for 30 s at 1 kHz, no request, and a policy against injected content."""
    assert path.stat().st_size < 1_000_000
    page.wait_for_timeout(200)
    assert (page.watched.requests, page.watched.complaints) == ([page.url], [])
    page.evaluate(
        """async () => {
            await fetch("http://127.0.0.1:9/").catch(() => 0);
            const script = document.createElement("script");
            script.textContent = "window.ran = true";
            document.body.append(script);
        }"""
    )
    assert page.evaluate("window.ran") is None
    assert any("Connecting to" in text for text in page.watched.complaints)
    assert any("inline script" in text for text in page.watched.complaints)
    assert page.watched.requests == [page.url]


def test_how_to_repeat_it_says_only_what_is_known():
    """Assert that a result without provenance or command has no table of it."""
    table = Table("Values", [Column("name")])
    made = {"heading": ("Title", "subject"), "parts": [table]}
    page = partial(result_page, lambda name: made.get(name, ()), (), (), {})
    assert page("").sections == []
    (origin,) = page("flexid watch -").sections
    assert origin.content == [Command("flexid watch -")]


def test_a_loaded_estimate_has_a_page(estimate, tmp_path):
    """Assert that a loaded estimate has a page without figures of time series."""
    estimate.save(tmp_path / "estimate.json")
    page, loaded = estimate._page(), flexid.load(tmp_path / "estimate.json")._page()
    names = [[section.name for section in each.sections] for each in (page, loaded)]
    assert {*names[0]} - {*names[1]} == {"fit", "residuals"}
    assert vars(loaded.lead) == vars(page.lead)


@pytest.mark.thorough
def test_hostile_names_are_text(page):
    """Assert that markup in names of file and columns is shown as text."""
    assert FILE in page.locator(".subject").inner_text()
    assert FILE in page.title()
    origin = page.locator("#origin").inner_text()
    assert f"{HOSTILE}motor_torque" in origin
    assert FILE in origin
    assert page.locator("img, script").count() == 0


@pytest.mark.thorough
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_the_first_screen_answers(page, width, height):
    """Assert that parameters, trust and the next step are on the first screen, also of a phone."""
    page.set_viewport_size({"width": width, "height": height})
    rows = page.locator(".lead tbody tr")
    assert rows.count() == 5
    words = page.locator(".answer .word")
    assert words.all_inner_texts() == ["Yes", "Test the values on another log"]
    ends = [*rows.all(), *words.all(), page.locator(".answer pre").last]
    for element in ends:
        box = element.bounding_box()
        assert box["y"] >= 0.0
        assert box["y"] + box["height"] <= height
        assert box["x"] + box["width"] <= width
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    heights = [one.bounding_box()["height"] for one in page.locator(".chart text").all()[:20]]
    assert min(heights) > 8.0


@pytest.mark.thorough
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_serious_fault(page, scheme):
    """Assert that axe-core finds no serious fault, in light and dark themes."""
    page.emulate_media(color_scheme=scheme)
    assert serious_faults(page) == []


@pytest.mark.thorough
def test_words_signs_and_colours(page):
    """Assert a word and a symbol of each verdict, and strokes light in the dark, dark on paper."""
    sign = "element => getComputedStyle(element, '::before').content"
    signs = set()
    for tone in ("good", "fair", "bad"):
        cell = page.locator(".lead td.tone").first
        assert cell.inner_text() == "determined"
        cell.evaluate("(element, tone) => element.className = `tone ${tone}`", tone)
        signs.add(cell.evaluate(sign))
    assert len(signs) == 3
    assert "none" not in signs
    by_day = page.evaluate(STROKE)
    page.emulate_media(color_scheme="dark")
    by_night = page.evaluate(STROKE)
    page.emulate_media(color_scheme="dark", media="print")
    assert by_day == page.evaluate(STROKE) != by_night
    assert "none" not in (by_day, by_night)
    assert page.pdf(format="A4").startswith(b"%PDF")
    assert page.watched.complaints == []
