"""The page of an identification: what its first screen answers, and that nothing in it is lost."""

from __future__ import annotations

import pytest

import flexid

HOSTILE = "<script>alert(1)<"
FILE = '"><img src=x onerror=alert(2)>.csv'
COLUMNS = {
    name: {"column": f"{HOSTILE}{name}", "unit": unit}
    for name, unit in (
        ("time", "s"),
        ("link_position", "rad"),
        ("motor_position", "rad"),
        ("motor_torque", "N m"),
    )
}


@pytest.fixture(scope="module")
def estimate(examples, tmp_path_factory):
    """Return what is found in the example log, whose file and columns have hostile names."""
    text = (examples / "flexible_joint.csv").read_text()
    header = ",".join(column["column"] for column in COLUMNS.values())
    log = tmp_path_factory.mktemp("log") / FILE
    log.write_text(header + text[text.index("\n") :])
    return flexid.identify(
        log, columns=COLUMNS, terms=["gravity", "motor_viscous"], hold="zero", segment_duration=2.0
    )


@pytest.fixture(scope="module")
def path(estimate, tmp_path_factory):
    """Return its page, alone in a folder."""
    path = tmp_path_factory.mktemp("alone") / "report.html"
    estimate.report(path)
    return path


def test_one_file_that_can_be_sent(path):
    """Assert that the page of 30 s at 1 kHz is below 1 MB."""
    assert path.stat().st_size < 1_000_000


@pytest.mark.thorough
def test_hostile_names_are_text(page):
    """Assert that a file and columns with markup for names are shown so, and do nothing."""
    assert FILE in page.locator(".subject").inner_text()
    assert FILE in page.title()
    origin = page.locator("#origin").inner_text()
    assert f"{HOSTILE}motor_torque" in origin
    assert FILE in origin
    assert page.locator("img, script").count() == 0
    assert (page.watched.requests, page.watched.complaints) == ([page.url], [])


@pytest.mark.thorough
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_the_first_screen_answers(page, width, height):
    """Assert that all parameters, the trust and the next step are seen without scrolling."""
    page.set_viewport_size({"width": width, "height": height})
    rows = page.locator(".lead tbody tr")
    assert rows.count() == 5
    words = page.locator(".answer .word")
    assert words.all_inner_texts() == ["Yes", "Test it on another log"]
    ends = [*rows.all(), *words.all(), page.locator(".answer pre").last]
    for element in ends:
        box = element.bounding_box()
        assert box["y"] >= 0.0
        assert box["y"] + box["height"] <= height
        assert box["x"] + box["width"] <= width
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_a_loaded_estimate_has_a_page(estimate, tmp_path):
    """Assert that without time series the page leaves out their figures, and nothing else."""
    estimate.save(tmp_path / "estimate.json")
    page, loaded = estimate._page(), flexid.load(tmp_path / "estimate.json")._page()
    names = [[section.name for section in each.sections] for each in (page, loaded)]
    assert {*names[0]} - {*names[1]} == {"fit", "residuals"}
    assert loaded.lead == page.lead
