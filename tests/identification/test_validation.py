"""Validation by free run over held-out data."""

import numpy as np
import pytest

from flexid.identification.joint import flexible
from flexid.identification.preparation import Pieces
from flexid.identification.validation import free_run_error, validate
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.recording import Recording
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 333.0, "alpha2": 0.3, "beta1": 3.3}

JOINT = flexible()


def pieces(*cuts) -> Pieces:
    """Recordings, each with the index at which its held-out end begins."""
    recordings, starts = zip(*cuts, strict=True)
    return Pieces(recordings, starts, tuple(range(len(cuts))))


def coefficients(values, count=1):
    """All of the full model's coefficients, those of terms that are off being zero."""
    return [np.array([values.get(c, 0.0) for c in JOINT.system.coefficients])] * count


@pytest.fixture(scope="module")
def recording():
    """Six seconds of a joint that is already moving, without noise."""
    t = np.arange(6001) * 1e-3
    u = 5 * np.sin(5.3 * t) + 4 * np.sin(17 * t)
    x = free_run(flexible_joint(), TRUE, [0.2, 0.5, 0.1, -0.3], u, 1e-3)
    return Recording(1e-3, 0.0, x[:, 0].copy(), x[:, 2].copy(), u, "N m")


def test_true_model_repeats_the_held_out_data(recording):
    """Assert that the true coefficients give a fit of 100 % although no state was measured."""
    validation = validate(JOINT, pieces((recording, 4000)), coefficients(TRUE), "linear")
    assert all(fit > 99.999 for fit in validation.fit_percent.values())


def test_wrong_model_is_found_out(recording):
    """Assert that a stiffness half as large shows in the deflection above all."""
    wrong = {**TRUE, "theta2": 50.0, "alpha1": 166.0}
    fit = validate(JOINT, pieces((recording, 4000)), coefficients(wrong), "linear").fit_percent
    assert fit["deflection"] < 50
    assert fit["link_position"] < 95
    assert fit["motor_position"] < 95


def test_held_out_measurements_do_not_leak(recording):
    """Assert that the free run does not change when the held-out positions do."""
    spoilt = Recording(
        1e-3,
        0.0,
        np.where(np.arange(6001) < 4000, recording.link_position, 7.0),
        np.where(np.arange(6001) < 4000, recording.motor_position, -7.0),
        recording.input,
        "N m",
    )
    clean = validate(JOINT, pieces((recording, 4000)), coefficients(TRUE), "linear").runs[0]
    other = validate(JOINT, pieces((spoilt, 4000)), coefficients(TRUE), "linear").runs[0]
    np.testing.assert_array_equal(clean.simulated, other.simulated)


def test_fit_of_a_known_error(recording):
    """Assert that the fit is one minus the error's norm over the spread's, in per cent."""
    validation = validate(
        JOINT, pieces((recording, 4000)), coefficients({**TRUE, "beta1": 3.2}), "linear"
    )
    run = validation.runs[0]
    error = np.linalg.norm(run.measured[:, 0] - run.simulated[:, 0])
    spread = np.linalg.norm(run.measured[:, 0] - run.measured[:, 0].mean())
    assert validation.fit_percent["link_position"] == pytest.approx(100 * (1 - error / spread))


def test_diverging_model_has_no_fit(recording):
    """Assert that a diverging free run is reported as no fit at all, without an exception."""
    unstable = {**TRUE, "alpha2": -300.0}
    validation = validate(JOINT, pieces((recording, 1000)), coefficients(unstable), "linear")
    assert all(fit < -1e3 for fit in validation.fit_percent.values())


def test_several_pieces_are_pooled(recording):
    """Assert that a piece validated twice has the fit of the piece validated once."""
    wrong = {**TRUE, "beta1": 3.2}
    once = validate(JOINT, pieces((recording, 4000)), coefficients(wrong), "linear")
    twice = validate(JOINT, pieces(*[(recording, 4000)] * 2), coefficients(wrong, 2), "linear")
    assert twice.fit_percent == pytest.approx(dict(once.fit_percent))
    assert len(twice.runs) == 2


def test_rest_is_not_tested(recording):
    """Assert that a joint that stands still while it is held out gives no fit, good or bad."""
    standing = np.minimum(np.arange(6001), 3000)
    noise = 1e-5 * np.random.default_rng(3).standard_normal((2, 6001))
    rested = Recording(
        1e-3,
        0.0,
        recording.link_position[standing] + noise[0],
        recording.motor_position[standing] + noise[1],
        recording.input,
        "N m",
    )
    fit = validate(JOINT, pieces((rested, 4000)), coefficients(TRUE), "linear").fit_percent
    assert all(np.isnan(value) for value in fit.values())


def test_error_of_choices_is_that_of_several_runs(recording):
    """Assert that a choice looks at the mean error of the channels, over runs from several starts.

    A small constant step of the input's gain gives every run nearly the same relative error.
    """
    wrong = coefficients({**TRUE, "beta1": 3.2})
    one = validate(JOINT, pieces((recording, 4000)), wrong, "linear").fit_percent
    error = free_run_error(JOINT, pieces((recording, 4000)), wrong, "linear")
    assert error == pytest.approx(1 - np.mean(list(one.values())) / 100, rel=0.5)
    assert free_run_error(JOINT, pieces((recording, 4000)), coefficients(TRUE), "linear") < 1e-6
