"""The page of a comparison: its first screen answers, and hostile names do nothing."""

from __future__ import annotations

import shlex
from dataclasses import replace

import pytest

import flexid
from browser import serious_faults
from flexid.comparisons.comparison import compare_estimates
from flexid.report.comparison import charts
from flexid.report.comparison import page as comparison_page
from flexid.report.page.page import Bullets, Command
from made_estimates import STIFFER, TRUE, exact, with_parameter

HOSTILE = '"></script><img src=x onerror=alert(1)>'


def hostile():
    """An estimate in which every text from outside is markup."""
    b = replace(exact(STIFFER, "b"), warnings=(HOSTILE,))
    b = with_parameter(b, "motor_inertia", verdict="undetermined", reason=HOSTILE)
    log = {"file": HOSTILE, "sha256": HOSTILE}
    return replace(
        b, provenance={"flexid_version": HOSTILE, "settings": {HOSTILE: HOSTILE}, "inputs": [log]}
    )


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """The page of a drive that has become stiffer, whose log has a hostile name, alone."""
    path = tmp_path_factory.mktemp("alone") / "report.html"
    a, b = flexid.JointEstimate(exact(TRUE, "a")), flexid.JointEstimate(hostile())
    flexid.compare(a, b).report(path)
    return path


@pytest.mark.thorough
def test_it_asks_for_nothing_and_runs_nothing(page):
    """Assert that markup from outside is text, and that no request is made but for the page."""
    page.wait_for_timeout(200)
    assert (page.watched.requests, page.watched.complaints) == ([page.url], [])
    assert page.locator("img").count() == 0
    for section in ("warnings", "origin", "settings", "values"):
        assert HOSTILE in page.locator(f"#{section}").inner_text()


@pytest.mark.thorough
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_the_first_screen_answers(page, width, height):
    """Assert that what has changed, and what to do, are seen without scrolling."""
    page.set_viewport_size({"width": width, "height": height})
    words = page.locator(".answer .word")
    assert words.all_inner_texts() == ["Yes", "Record B once more"]
    for word in words.all():
        box = word.bounding_box()
        assert 0.0 <= box["y"] <= height - box["height"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.thorough
def test_no_serious_fault(page):
    """Assert that axe-core finds no serious fault, light and dark, wide and narrow."""
    for scheme, width in (("light", 1280), ("dark", 390)):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": 800})
        assert serious_faults(page) == []


def word(a, b):
    """The answer to whether anything has changed, with what it means."""
    answer = comparison_page(compare_estimates(a, b), ()).answers[0]
    return answer.word, answer.tone


def test_each_outcome_has_its_word():
    """Assert that change, none, doubt, lack and contradiction are told apart at a glance."""
    a, same, stiffer = exact(TRUE, "a"), exact(TRUE, "b"), exact(STIFFER, "b")
    assert word(a, same) == ("Nothing is seen", "good")
    assert word(a, stiffer) == ("Yes", "bad")
    p = same.parameters["gravity_torque"]
    doubtful = with_parameter(same, p.name, value=p.value + 2.2 * 2**0.5 * p.std)
    assert word(a, doubtful) == ("Perhaps", "fair")
    unknown = with_parameter(same, p.name, verdict="undetermined", reason="contradicted")
    assert word(a, unknown) == ("Not all of it is known", "fair")
    assert word(a, exact(STIFFER, "a")) == ("No", "bad")
    again = replace(exact(TRUE, "a"), provenance={**a.provenance, "settings": {"hold": "zero"}})
    assert word(a, again) == ("Yes", "good")


def test_the_command_repeats_it():
    """Assert that files are named so that a shell takes them, and that memory has no command."""
    a, b = exact(TRUE, "a"), exact(STIFFER, "b")

    def commands(*labels):
        page = comparison_page(compare_estimates(a, b, *labels), ())
        (origin,) = [section for section in page.sections if section.name == "origin"]
        return [item.text for item in origin.content if isinstance(item, Command)]

    assert commands() == []
    (command,) = commands(("my drive/estimate.json", "b.json"))
    assert shlex.split(command) == ["flexid", "compare", "my drive/estimate.json", "b.json"]


def test_what_is_not_compared_is_explained():
    """Assert that the reason stands below both values."""
    b = with_parameter(exact(TRUE, "b"), "joint_stiffness", verdict="undetermined", reason="odd")
    page = comparison_page((found := compare_estimates(exact(TRUE, "a"), b)), charts(found))
    (values,) = [section for section in page.sections if section.name == "values"]
    (said,) = [item for item in values.content if isinstance(item, Bullets)]
    assert [*said.lines] == ["joint_stiffness: in B odd"]
