"""A log of MuJoCo, whose friction is a constraint: what the friction models make of it."""

import numpy as np
import pytest
from engine_log import TRUTH, engine_log

from flexid.estimators.samples import Samples, samples_of_recording
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.stopping_time import find_stopping_time, fit_stopping_time
from flexid.models.flexible_joint import STOPPING, flexible_joint
from flexid.models.physical import physical_parameters
from flexid.recording.velocities import with_velocities

TERMS = ("gravity", "motor_viscous", "joint_damping")
RATE = 20.0
STOPPING_TIME = 0.95 * 0.02 / 2  # s; MuJoCo's largest impedance times solref's time constant


@pytest.fixture(scope="module")
def log() -> Samples:
    """Ten seconds of the engine."""
    return samples_of_recording(with_velocities(engine_log(1, duration=10.0)))


@pytest.fixture(scope="module")
def plain(log: Samples) -> LeastSquaresFit:
    """Least squares with friction that depends on the velocity alone."""
    return filtered_least_squares([log], flexible_joint((*TERMS, "motor_coulomb")), RATE, "zero")


def values_of(names: tuple[str, ...], values: np.ndarray) -> dict[str, float]:
    """Physical parameters by name."""
    coefficients = dict(zip(names, map(float, values), strict=True))
    return {p.name: p.value(coefficients) for p in physical_parameters(coefficients, True)}


def test_friction_of_the_velocity_alone_biases_the_inertia(plain: LeastSquaresFit):
    """Assert that plain Coulomb friction takes part of the engine's friction for inertia."""
    place = plain.names.index("beta1")
    error = plain.values[place] * TRUTH["motor_inertia"] - 1
    assert 0.002 < -error < 0.01
    assert abs(error) * plain.values[place] > 4 * plain.standard_deviations[place]


def test_friction_that_holds_explains_the_engine(log: Samples, plain: LeastSquaresFit):
    """Assert that with a stopping time every parameter is within 0.5 % and residuals are white."""
    values = dict(zip(plain.names, map(float, plain.values), strict=True))
    joint = flexible_joint((*TERMS, "motor_stiction"))
    system, start = find_stopping_time([log], joint, values, RATE, "zero")
    system, fit = fit_stopping_time([log], system, start, 0.5, "zero")
    assert system.constants[STOPPING] == pytest.approx(STOPPING_TIME, rel=0.03)
    assert values_of(fit.names, fit.values) == pytest.approx(TRUTH, rel=5e-3)
    assert fit.whiteness > 1e-3
