"""Is the compliance visible in this log?"""

from functools import cache
from math import nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_joint import data, made

import flexid.identification.estimation.answers as answers
from flexid.identification.judgement import of_joint, of_link_alone
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.vocabulary.evidence import CoefficientEstimate, Validation, Verdict

STIFF = 10_000.0  # N m/rad
START = 3333


@cache
def recordings(stiffness: float, noise: float) -> SplitRecordings:
    """Ten seconds of a joint of so much stiffness, the last third held out."""
    recording = made(41, noise=noise, joint_stiffness=stiffness, size=0.6)
    return SplitRecordings((recording,), (START,), (0,))


@pytest.mark.parametrize(
    ("verdict", "seen"), [("determined", True), ("weak", True), ("undetermined", False)]
)
def test_spring_that_the_log_leaves_open_explains_nothing(verdict: Verdict, seen):
    """Assert that without a torque a deflection is no compliance if any stiffness would do."""
    stiffness = CoefficientEstimate("theta2", "1/s^2", 100.0, 1.0, (0.0, 1e3), verdict)
    driven = Validation({"deflection": 90.0}, ())
    compliance = of_link_alone(recordings(100.0, 1e-5), driven, stiffness)
    assert compliance.visible == seen
    assert ("another stiffness" in compliance.reason) != seen


@pytest.mark.parametrize(
    ("stiffness", "noise", "shown", "reason"),
    [
        (100.0, 1e-5, 51.0, ""),
        (100.0, 1e-5, 49.0, "explains only 49 %"),
        (100.0, 1e-5, nan, "too little to be tested"),
        (STIFF, 3e-3, 5.0, "hardly more than its noise"),
        (STIFF, 3e-3, 65.0, "hardly more than its noise"),
        (STIFF, 3e-3, 68.0, ""),  # two thirds explained are no noise, whatever passes for it
    ],
)
def test_what_is_seen(stiffness, noise, shown, reason):
    """Assert that a deflection beyond noise has to be explained, and why it is not seen."""
    log = recordings(stiffness, noise)
    compliance = of_joint(log, Validation({"deflection": shown}, ()))
    assert compliance.visible == (reason == "")
    assert reason in compliance.reason
    assert compliance.deflection == pytest.approx(np.std(log.recorded[0].deflection[START:]))
    if stiffness == STIFF:
        assert compliance.deflection_noise == pytest.approx(3e-3 * 2**0.5, rel=0.1)


def test_a_period_is_predicted_from_the_one_before(monkeypatch):
    """Assert that what decides on a spring is a period, from a state that fits no more than one.

    On a drive whose friction falls off, states of half a second predict 15 % of the deflection over
    a period of 0.12 s, and those of a period 56 %; of two stages taken for one nothing.
    """
    asked = []

    def predicting(_, __, ___, horizons, warm_up):
        asked.append((*horizons, warm_up))
        return SimpleNamespace(horizons={horizons[0]: {"deflection": 56.0}})

    monkeypatch.setattr(answers, "validate", predicting)
    whole = data(made(5, 4.0))
    fitted: Any = SimpleNamespace(by_name={"theta2": 900.0, "alpha1": 1600.0})
    job: Any = SimpleNamespace(whole=whole, recordings=SimpleNamespace(starts=(0,)))
    period, share = answers._over_a_period(fitted, job)
    assert period == pytest.approx(2.0 * np.pi / 50.0)
    assert asked == [(period, period)]
    assert share == 56.0
