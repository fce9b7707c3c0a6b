"""What is said of a comparison, of one number and of several."""

from dataclasses import replace

import numpy as np
import pytest

from flexid.comparisons.comparison import Comparison, compare_estimates
from flexid.comparisons.differences import Outcome
from flexid.report.comparison_summary import comparison_summary
from made_estimates import drawn


def judged(names: tuple[str, ...], outcome: Outcome, log: str = "b") -> Comparison:
    """A comparison of some parameters, all with one outcome."""
    rng = np.random.default_rng(3)
    found = compare_estimates(drawn(rng, log="a"), drawn(rng, log=log, hold="linear"))
    parameters = {name: replace(found.parameters[name], outcome=outcome) for name in names}
    return replace(found, parameters=parameters, together=None)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("joint_stiffness",), "1 number differs by no more"),
        (("joint_stiffness", "link_inertia"), "2 numbers differ by no more"),
    ],
)
def test_of_one_log(names, said):
    """Assert that one number differs, and two differ."""
    (line,) = comparison_summary(judged(names, "compatible", log="a"))
    assert said in line
    verb = "differs" if len(names) == 1 else "differ"
    (line,) = comparison_summary(judged(names, "contradictory", log="a"))
    assert f"{' and '.join(names)} {verb} by more than" in line


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (
            ("joint_stiffness",),
            "An interval that holds 95 % misses by chance in up to about 5 % of comparisons",
        ),
        (
            ("joint_stiffness", "link_inertia"),
            "With 2 intervals that hold 95 % each, one or more misses by chance in up to about 10",
        ),
    ],
)
def test_perhaps(names, said):
    """Assert that chance is given as the most that it may be, of one interval or several."""
    assert said in " ".join(comparison_summary(judged(names, "perhaps changed")))


def test_what_may_hide_is_rounded_up():
    """Assert that the sentence promises no less than the interval."""
    found = judged(("joint_stiffness",), "no change")
    d = replace(found.parameters["joint_stiffness"], percent_interval=(-1.0, 2.11))
    (line,) = comparison_summary(replace(found, parameters={d.name: d}))
    assert line.endswith("the largest that may hide is one of 2.2 % of joint_stiffness.")
