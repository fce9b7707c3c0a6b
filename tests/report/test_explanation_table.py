"""What ``--explain`` adds to the answer."""

from dataclasses import replace

import pytest
from made_result import made_result

from flexid.report.explanation_table import explanation
from flexid.report.terminal import USUAL, laid_out


@pytest.fixture(scope="module")
def lines():
    """Return the explanation as lines of text."""
    return [line.plain for line in laid_out(explanation(made_result()), USUAL)]


def line_with(lines, *words):
    """Return the one line that holds all the words."""
    (found,) = [line for line in lines if all(word in line for word in words)]
    return found


def test_no_line_is_wider_than_the_page(lines):
    """Assert that the explanation fits 80 columns and nothing is cut off."""
    assert max(map(len, lines)) <= USUAL
    assert not any("…" in line for line in lines)


def test_terms_are_shown_with_their_evidence(lines):
    """Assert that each term says value, deviation, probability and whether it is in."""
    assert line_with(lines, "alpha_cubic").split() == ["alpha_cubic", "0.5", "0.79", "0.57", "no"]
    free = line_with(lines, "theta_cosine").split()
    assert free == ["theta_cosine", "0", "unknown", "1", "no"]


def test_a_tiny_probability_is_a_bound(lines):
    """Assert that no probability is printed that rests on the far tail of a distribution."""
    assert line_with(lines, "5.012").split() == ["theta1", "5.012", "0.021", "<", "1e-06", "yes"]


def test_lengths_are_shown_and_the_chosen_one_is_marked(lines):
    """Assert that each length has its residual over noise and its deviation, one the mark."""
    assert line_with(lines, "chosen").split() == ["1.99", "s", "1.2", "1.2", "%", "chosen"]
    assert line_with(lines, "0.995").split() == ["0.995", "s", "1.1", "3.5", "%"]


def test_delays_are_shown_with_their_interval(lines):
    """Assert that both channels' delays stand with value, interval and where they come from."""
    assert line_with(lines, "input", "3.02 ms", "[2.87, 3.17] ms").split()[-1] == "found"
    assert line_with(lines, "link", "0.00 ms", "[-0.20, 0.30] ms").split()[-1] == "none"


@pytest.mark.parametrize(
    "words",
    [
        ("Input hold zero", "does not distinguish the holds"),
        ("filter rate", "31.4"),
        ("Coulomb friction", "0.0123"),
    ],
)
def test_every_other_choice_is_named(lines, words):
    """Assert that hold, filter rate and a given smoothing are said too."""
    page = " ".join(lines)
    assert all(word in page for word in words)


def test_what_no_term_describes_is_shown(lines):
    """Assert that the share of each balance stands there, and the band of the fit."""
    assert line_with(lines, "13 %").split() == ["motor", "13", "%"]
    assert any("one sample every 4 ms" in line for line in lines)


def test_an_exact_fit_has_no_disturbances():
    """Assert that nothing is said of disturbances where the model explains the log."""
    result = replace(made_result(), disturbances=None)
    page = " ".join(line.plain for line in laid_out(explanation(result), USUAL))
    assert "Unexplained" not in page


def test_least_squares_stands_beside_the_estimate(lines):
    """Assert that both values of a coefficient stand in one line."""
    assert line_with(lines, "5.0456").split() == ["theta1", "5.00", "5.0456"]
