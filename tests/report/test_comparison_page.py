"""The page of a comparison: its first screen answers, and hostile names do nothing."""

from __future__ import annotations

import shlex
from dataclasses import replace

from flexid.comparisons.comparison import compare_estimates
from flexid.report.comparison import charts
from flexid.report.comparison import page as comparison_page
from flexid.report.page import Bullets, Command
from made_estimates import STIFFER, TRUE, exact, with_parameter


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
