"""What is said of a comparison, of one number and of several."""

from dataclasses import replace

import numpy as np

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


def test_what_may_hide_is_rounded_up():
    """Assert that the sentence promises no less than the interval."""
    found = judged(("joint_stiffness",), "no change")
    d = replace(found.parameters["joint_stiffness"], percent_interval=(-1.0, 2.11))
    (line,) = comparison_summary(replace(found, parameters={d.name: d}))
    assert line.endswith("the largest that may hide is one of 2.2 % of joint_stiffness.")
