"""Is the compliance visible in this log?"""

from math import nan

import numpy as np
import pytest

from flexid.identification.candidate import Candidate
from flexid.identification.compliance import compare_with_rigid, one_encoder
from flexid.identification.joint import flexible
from flexid.identification.preparation import Pieces
from flexid.identification.result import Validation
from flexid.identification.validation import validate
from flexid.recording.recording import Recording
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
STIFF = {**TRUE, "theta2": 10_000.0, "alpha1": 100_000 / 3}
SAMPLE_TIME = 0.002  # s
JOINT = flexible()
CANDIDATE = Candidate(JOINT, ("gravity", "motor_viscous"), "linear", 20.0, 0.0)


def compared(truth, noise, shown=None):
    """Answer for a joint whose coefficients are known, or for what is claimed of its free run."""
    time = SAMPLE_TIME * np.arange(5000)
    torque = np.sin(np.outer(time, [0.7, 5.3, 8.0])) @ np.array([4.0, 6.0, 5.0])
    values = {c: truth.get(c, 0.0) for c in JOINT.system.coefficients}
    states = free_run(JOINT.system, values, np.zeros(4), torque, SAMPLE_TIME)
    rng = np.random.default_rng(1)
    link, motor = (states[:, ::2] + noise * rng.standard_normal((5000, 2))).T.copy()
    piece = Recording(SAMPLE_TIME, 0.0, link, motor, torque, "N m")
    pieces = Pieces((piece,), (3333,), (0,))
    if shown is None:
        validation = validate(JOINT, pieces, [np.array(list(values.values()))], "linear")
    else:
        validation = Validation({"deflection": shown}, ())
    return compare_with_rigid(CANDIDATE, pieces, validation)


def test_spring_that_bends_is_seen():
    """Assert that a flexible joint's deflection is explained, and that the rigid one falls back."""
    compliance = compared(TRUE, 1e-5)
    assert compliance.visible
    assert compliance.deflection > 1000 * compliance.deflection_noise
    assert compliance.rigid_fit_percent["motor_position"] < 95


def test_deflection_that_is_noise_is_not_seen():
    """Assert that a stiff joint behind coarse encoders shows none, and the size says why."""
    compliance = compared(STIFF, 3e-3)
    assert not compliance.visible
    assert "hardly more than its noise" in compliance.reason
    assert compliance.deflection_noise == pytest.approx(3e-3 * 2**0.5, rel=0.1)
    assert compliance.rigid_fit_percent["motor_position"] > 90


def test_what_the_spring_does_not_explain_is_no_compliance():
    """Assert that a deflection far beyond noise that the model does not repeat is none."""
    compliance = compared(TRUE, 1e-5, shown=20.0)
    assert not compliance.visible
    assert "explains only 20 %" in compliance.reason


def test_spring_that_rests_is_not_seen():
    """Assert that held-out data without motion say nothing."""
    assert "too little to be tested" in compared(TRUE, 1e-5, shown=nan).reason


def test_spring_that_explains_the_deflection_is_seen_whatever_passes_for_noise():
    """Assert that a motion so sparsely sampled that it looks like noise is no noise if repeated."""
    assert compared(STIFF, 3e-3, shown=99.0).visible


def test_one_encoder_shows_none():
    """Assert that without a second encoder the answer is no, and that it says why."""
    assert not one_encoder().visible
    assert "one encoder" in one_encoder().reason
