"""A page that was written to a file, in a browser."""

import pytest

from browser import Watched


@pytest.fixture
def page(browser, path):
    """Return the page at the path of a file of tests in a browser, and what was seen of it."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.watched = Watched(page)
    page.goto(path.as_uri())
    page.wait_for_selector(".chart svg")
    yield page
    page.close()
