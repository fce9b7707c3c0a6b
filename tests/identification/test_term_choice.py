"""Which terms are chosen, and which are not."""

import numpy as np
import pytest

from flexid.identification.candidate import Candidate, attempt
from flexid.identification.joint import flexible
from flexid.identification.preparation import Pieces
from flexid.identification.term_choice import (
    choose_coulomb_velocity,
    choose_stiction,
    choose_terms,
    with_stiction,
    with_stopping_time,
    without_idle_terms,
)
from flexid.recording.recording import Recording
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
SAMPLE_TIME = 0.002  # s
JOINT = flexible()


def silent(_):
    """Ignore the progress."""


def cuts(truth, seed=1, noise=1e-5):
    """Ten seconds under a multisine, cut once. Least squares alone is tried, for it is fast."""
    rng = np.random.default_rng(seed)
    time = SAMPLE_TIME * np.arange(5000)
    torque = np.sin(np.outer(time, [0.7, 5.3, 17.0, 25.0])) @ np.array([4.0, 6.0, 5.0, 6.0])
    values = {c: truth.get(c, 0.0) for c in JOINT.system.coefficients}
    states = free_run(JOINT.system, values, np.zeros(4), torque, SAMPLE_TIME)
    link, motor = (states[:, ::2] + noise * rng.standard_normal((5000, 2))).T.copy()
    piece = Recording(SAMPLE_TIME, 0.0, link, motor, torque, "N m")
    return [Pieces((piece,), (3333,), (0,))]


def candidate(*terms):
    """Return the joint with some terms, fitted by least squares."""
    return Candidate(JOINT, terms, "linear", 20.0, 0.0)


@pytest.fixture(scope="module")
def paper():
    """A log of the paper's joint."""
    return cuts(TRUE)


def test_terms_that_matter_are_chosen(paper):
    """Assert that gravity and friction are found from the spring alone."""
    best, _ = choose_terms(candidate(), paper, silent)
    assert {"gravity", "motor_viscous"} <= set(best.candidate.terms)


def test_friction_that_feeds_energy_is_no_candidate():
    """Assert that a negative friction is not taken, though the free run would be better with it."""
    active = cuts({**TRUE, "alpha2": -0.2})
    with_it = attempt(candidate("gravity", "motor_viscous"), active)
    assert with_it.error < 0.5 * attempt(candidate("gravity"), active).error
    best, _ = choose_terms(candidate("gravity"), active, silent)
    assert "motor_viscous" not in best.candidate.terms


def test_idle_term_goes(paper):
    """Assert that a term without an effect is left out, and that what stays saves something."""
    best = attempt(candidate("gravity", "motor_viscous", "cubic_stiffness"), paper)
    left, evidence = without_idle_terms(best, (), paper, silent)
    assert left.candidate.terms == ("gravity", "motor_viscous")
    assert [e.term for e in evidence if e.chosen] == ["gravity", "motor_viscous"]
    assert all(e.without_term > e.with_term for e in evidence)


def test_given_term_stays(paper):
    """Assert that a term that was asked for stays, idle or not."""
    best = attempt(candidate("gravity", "motor_viscous", "cubic_stiffness"), paper)
    left, _ = without_idle_terms(best, ("cubic_stiffness",), paper, silent)
    assert "cubic_stiffness" in left.candidate.terms


def test_friction_is_left_smooth_where_there_is_none(paper):
    """Assert that neither smoothing nor stiction is tried without Coulomb friction."""
    best = attempt(candidate("gravity", "motor_viscous"), paper)
    assert choose_coulomb_velocity(best, paper, silent) is best
    assert choose_stiction(best, paper, "auto", silent) is best


def test_given_stopping_time_is_kept(paper):
    """Assert that a given stopping time is the friction's, and is not fitted any more."""
    best = attempt(candidate("gravity", "motor_viscous", "motor_coulomb"), paper)
    held = with_stiction(best, paper, 0.004)
    assert held.joint.system.constants["stopping_time"] == 0.004
    assert "alpha_holding" not in held.unknowns(paper[0].groups).names
    assert with_stopping_time(held, paper[0].fitted, paper[0].groups) is held


def test_sharper_friction_is_found():
    """Assert that friction that changes sign over 0.01 rad/s is not taken for a wider one."""
    sharp = JOINT.with_coulomb_velocity(0.01)
    time = SAMPLE_TIME * np.arange(5000)
    torque = np.sin(np.outer(time, [0.7, 5.3, 17.0])) @ np.array([4.0, 6.0, 5.0])
    values = {c: {**TRUE, "alpha_coulomb": 5.0}.get(c, 0.0) for c in JOINT.system.coefficients}
    states = free_run(sharp.system, values, np.zeros(4), torque, SAMPLE_TIME)
    noise = 1e-6 * np.random.default_rng(2).standard_normal((5000, 2))
    link, motor = (states[:, ::2] + noise).T.copy()
    piece = Recording(SAMPLE_TIME, 0.0, link, motor, torque, "N m")
    log = [Pieces((piece,), (3333,), (0,))]
    best = attempt(candidate("gravity", "motor_viscous", "motor_coulomb"), log)
    found = choose_coulomb_velocity(best, log, silent).candidate.joint.system.constants
    assert found["coulomb_velocity"] <= 0.03
