"""Is the compliance visible in this log?"""

from functools import cache
from math import nan

import numpy as np
import pytest
from made_joint import COEFFICIENTS, PAPER, data, made

from flexid.identification.full_model.fitting import fit_to
from flexid.identification.judgement.compliance import (
    compare_with_rigid,
    of_link_alone,
    one_encoder,
)
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.structure.validation import validate
from flexid.identification.vocabulary.evidence import CoefficientEstimate, Validation, Verdict

STIFF = 10_000.0  # N m/rad
START = 3333


@cache
def recordings(stiffness: float, noise: float) -> SplitRecordings:
    """Ten seconds of a joint of so much stiffness, the last third held out."""
    recording = made(41, noise=noise, joint_stiffness=stiffness, size=0.6)
    return SplitRecordings((recording,), (START,), (0,))


def compared(log: SplitRecordings, shown: float):
    """Answer where a free run is claimed to show so much of the deflection, in per cent."""
    return compare_with_rigid(PAPER, log, Validation({"deflection": shown}, ()))


def test_spring_that_bends_is_seen():
    """Assert that a deflection far beyond noise is explained, and a rigid joint predicts less."""
    log = recordings(100.0, 1e-5)
    fitted, _ = fit_to(PAPER, data(*log.fitted), COEFFICIENTS, 1.0)
    validation = validate(fitted, data(*log.whole), log.starts)
    compliance = compare_with_rigid(PAPER, log, validation)
    assert compliance.visible
    assert compliance.deflection > 1000 * compliance.deflection_noise
    assert validation.fit_percent["motor_position"] > 99.9
    assert compliance.rigid_fit_percent["motor_position"] < 95


def test_deflection_that_is_noise_is_not_seen():
    """Assert that a stiff joint behind coarse encoders shows none, and the size says why."""
    compliance = compared(recordings(STIFF, 3e-3), 5.0)
    assert not compliance.visible
    assert "hardly more than its noise" in compliance.reason
    assert compliance.deflection_noise == pytest.approx(3e-3 * 2**0.5, rel=0.1)
    assert compliance.rigid_fit_percent["motor_position"] > 90


def test_what_the_spring_does_not_explain_is_no_compliance():
    """Assert that a deflection far beyond noise that the model does not repeat is none."""
    log = recordings(100.0, 1e-5)
    compliance = compared(log, 49.0)
    assert not compliance.visible
    assert "explains only 49 %" in compliance.reason
    assert compared(log, 51.0).visible


def test_spring_that_rests_is_not_seen():
    """Assert that held-out data without motion say nothing."""
    assert "too little to be tested" in compared(recordings(100.0, 1e-5), nan).reason


@pytest.mark.parametrize(("shown", "seen"), [(65.0, False), (68.0, True)])
def test_spring_that_explains_the_deflection_is_seen_whatever_passes_for_noise(shown, seen):
    """Assert that two thirds explained are no noise, be the motion so sparse that it looks so."""
    assert compared(recordings(STIFF, 3e-3), shown).visible == seen


def test_deflection_moves_by_its_root_mean_square():
    """Assert that the size of the held-out deflection is told about its mean."""
    log = recordings(100.0, 1e-5)
    expected = np.std(log.recorded[0].deflection[START:])
    assert compared(log, 90.0).deflection == pytest.approx(expected)


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
    assert compliance.rigid_fit_percent == {}


def test_one_encoder_shows_none():
    """Assert that without a second encoder the answer is no, and that it says why."""
    assert not one_encoder().visible
    assert "taken as rigid" in one_encoder().reason
