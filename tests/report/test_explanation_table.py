"""What ``--explain`` adds to the answer."""

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

from flexid.identification.alignment import Alignment, Delay
from flexid.identification.result import Choices, SegmentEvidence, TermEvidence
from flexid.report.explanation_table import explanation
from flexid.report.terminal import WIDTH

LONG = (
    "the input acts 3.02 ms late (2.87 to 3.17 ms): without that the misfit is 12.3 times as large"
)
CHOICES = Choices(
    terms=("gravity", "motor_stiction"),
    alignment=Alignment(
        "zero",
        Delay(0.00302, 0.00302, 1e-4, (0.00287, 0.00317), "found", LONG),
        Delay(0.0, 0.0, 1e-4, (-2e-4, 3e-4), "none", "nothing shows that the link's encoder lags"),
        "only an input held over each sample explains the log without a delay",
        {"zero": 0.1, "linear": 0.2},
        0.0,
        20.0,
    ),
    hold="zero",
    coulomb_velocity=None,
    stopping_time=0.0123,
    filter_rate=31.4,
    estimator="prediction-error",
    segment_duration=2.0,
    term_evidence=(
        TermEvidence("gravity", True, 0.0123, 0.456),
        TermEvidence("cubic_stiffness", False, 0.0124, 0.0123),
    ),
    segment_evidence=(
        SegmentEvidence(0.0, 0.0234, True),
        SegmentEvidence(1.0, 0.0345, False),
        SegmentEvidence(2.0, 0.0123, True),
    ),
)


@pytest.fixture
def lines():
    """Return the explanation as lines of text."""
    estimates = {name: SimpleNamespace(value=value) for name, value in [("theta1", 5.0123)]}
    result = SimpleNamespace(
        choices=CHOICES, coefficients=estimates, least_squares={"theta1": 5.0456}
    )
    page = io.StringIO()
    for part in explanation(result):  # type: ignore[arg-type] - what the explanation needs of it
        Console(file=page, width=WIDTH).print(part)
    return [line.rstrip() for line in page.getvalue().splitlines()]


def line_with(lines, *words):
    """Return the one line that holds all the words."""
    (found,) = [line for line in lines if all(word in line for word in words)]
    return found


def test_no_line_is_wider_than_the_page(lines):
    """Assert that the explanation fits 100 columns and nothing is cut off."""
    assert max(map(len, lines)) <= WIDTH
    assert not any("…" in line for line in lines)


def test_terms_are_shown_with_what_they_buy(lines):
    """Assert that each term that was tried says whether it is in, and both errors."""
    assert line_with(lines, "gravity").split() == ["gravity", "yes", "1.23", "45.6"]
    assert line_with(lines, "cubic_stiffness").split() == ["cubic_stiffness", "no", "1.24", "1.23"]


def test_chosen_length_is_marked(lines):
    """Assert that of the lengths of a segment the chosen one is marked, and a failed one too."""
    assert line_with(lines, "chosen").split() == ["2", "s", "1.23", "chosen"]
    assert line_with(lines, "did not converge").split()[:2] == ["1", "s"]


def test_delays_are_shown_with_their_reason(lines):
    """Assert that both channels' delays stand with correction, interval and reason."""
    assert "3.02 ms" in line_with(lines, "input", "[2.87, 3.17] ms")
    assert "0 ms" in line_with(lines, "link", "[-0.2, 0.3] ms")
    assert "12.3" in " ".join(lines)


@pytest.mark.parametrize(
    "words",
    [
        ("Input hold zero", "only an input held"),
        ("Filter rate", "31.4"),
        ("estimator", "prediction-error"),
        ("stops the motor", "0.0123"),
    ],
)
def test_every_other_choice_is_named(lines, words):
    """Assert that hold, filter rate, estimator and stopping time are told too."""
    assert line_with(lines, *words)


def test_least_squares_stands_beside_the_estimate(lines):
    """Assert that both values of a coefficient stand in one line."""
    assert line_with(lines, "theta1").split() == ["theta1", "5.0123", "5.0456"]
