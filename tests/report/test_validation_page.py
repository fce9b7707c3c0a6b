"""The page of a validation."""

from dataclasses import replace

import numpy as np
import pytest

from flexid.identification.vocabulary.evidence import FreeRun
from flexid.report.free_run_chart import residual_chart
from flexid.report.page import Command, page_html
from flexid.report.validation import fit_chart, page
from flexid.stored_estimates.validate_estimate import EstimateValidation

TIME = np.linspace(0.0, 1.0, 101)
SEEN = np.sin(7.0 * TIME)[:, None]
MADE = EstimateValidation(
    fit_percent={"motor_position": 97.53},
    runs=(FreeRun(TIME, SEEN, SEEN + 1e-3 * np.cos(50.0 * TIME)[:, None]),),
    horizons={0.05: {"motor_position": 99.1}},
    model="rigid",
    residuals={0.05: {"motor_position": 5e-4}, float("inf"): {"motor_position": 1e-3}},
    noise={"motor_position": 4e-4},
    provenance={"flexid_version": "0", "inputs": [{"file": "runs/my log.csv", "sha256": "ab"}]},
)


def with_fit(fit: float, *warnings: str) -> EstimateValidation:
    """Return a validation with this free run."""
    return replace(MADE, fit_percent={"motor_position": fit}, warnings=warnings)


@pytest.mark.parametrize(
    ("result", "word", "tone", "then"),
    [
        (MADE, "97.53 %", "good", "Use the estimate"),
        (with_fit(97.53, "short"), "97.53 %", "fair", "Use the estimate"),
        (with_fit(49.0), "49.00 %", "bad", "Identify these logs as well"),
        (with_fit(-20.0), "Nothing", "bad", "Identify these logs as well"),
        (with_fit(-np.inf), "Nothing", "bad", "Identify these logs as well"),
        (with_fit(np.nan), "Nothing moves", "bad", "Identify these logs as well"),
    ],
)
def test_the_first_screen_says_how_much_is_predicted(result, word, tone, then):
    """Assert that the answer is the free run's worst fit, and what to do follows from it."""
    first, second = page(result, ()).answers
    assert (first.word, first.tone) == (word, tone)
    assert second.word == then


def test_what_the_first_answer_rests_on():
    """Assert that one channel has no rest, and that an error is a multiple of the noise."""
    (first, _) = page(MADE, ()).answers
    assert str(first.content[0]) == "Of the motor position in a free run."
    both = replace(MADE, fit_percent={"motor_position": 97.53, "link_position": 98.0}, horizons={})
    (first, _) = page(both, ()).answers
    assert str(first.content[0]) == "Of the motor position in a free run, and more of the rest."
    (first, _) = page(MADE, ()).answers
    assert str(first.content[-1]) == "The error is at most 2.5 times the sensor noise."


def test_a_command_can_be_pasted():
    """Assert that a file with a blank in its name is quoted."""
    _, then = page(with_fit(0.0), ()).answers
    assert then.content[-1] == Command("flexid identify 'runs/my log.csv'")


def test_all_of_it_is_on_the_page():
    """Assert that figures, tables, warnings, the command and the log's hash are in the HTML."""
    charts = (fit_chart(MADE), residual_chart(MADE))
    made = page_html(page(with_fit(97.53, "beware"), charts, "flexid validate e.json"))
    for text in ("my log.csv", "97.53", ">beware<", "flexid validate e.json", ">ab<"):
        assert text in made
    assert made.count('class="chart wide"') == 2
