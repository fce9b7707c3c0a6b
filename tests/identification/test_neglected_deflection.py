"""Doubt about the inertia of a drive that was taken as rigid though its joint bends."""

from dataclasses import replace

import numpy as np
import pytest
from made_joint import log, made, recording

from flexid.identification.estimation.neglected_deflection import (
    by_hidden_spring,
    excess_of_link,
    like_a_spring,
    with_bending,
    with_hidden_spring,
)
from flexid.identification.identify import identify
from flexid.identification.preparation.recordings import prepare
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import Estimate

TIMES = 2e-3 * np.arange(5000)
RNG = np.random.default_rng(3)
NOISE = 1e-3 * RNG.standard_normal((2, len(TIMES)))  # rad


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_more_of_the_link_is_seen_through_noise(noise):
    """Assert the ratio of two tones with their own ratios, by the input's share at each."""
    rates, excesses, torques = (3.0, 20.0), (0.001, 0.04), (2.0, 5.0)
    angles = [-u / w**2 * np.sin(w * TIMES) for w, u in zip(rates, torques, strict=True)]
    motor = angles[0] + angles[1]
    link = motor + excesses[0] * angles[0] + excesses[1] * angles[1]
    drive = np.sin(np.outer(TIMES, rates)) @ torques
    made_of = recording(TIMES, link + noise * NOISE[0], motor + noise * NOISE[1], drive)
    expected = (4.0 * 0.001 + 25.0 * 0.04) / 29.0
    assert excess_of_link([made_of]) == pytest.approx(expected, rel=0.01 + 0.2 * noise)
    for unknown in (None, np.zeros(len(TIMES))):  # a link that is clamped tells nothing
        assert excess_of_link([replace(made_of, link_position=unknown)]) == 0.0


@pytest.mark.parametrize(("pull", "swing"), [(480.0, 0.2), (500.0, 0.6), (500.0, 0.2)])
def test_gravity_of_a_short_swing_may_be_a_spring(pull: float, swing: float):
    """Assert the doubt for a mass within two centimetres of the axis, whose sine is not seen."""
    estimate = Estimate(("gamma1", "beta1"), np.array([pull, 2.0]), np.eye(2), (50.0,) * 2)
    motor = 0.5 * swing * np.sin(TIMES)
    made_of = recording(TIMES, motor, motor, motor)
    doubt = like_a_spring(estimate, [replace(made_of, link_position=None)])
    assert (doubt is not None) == (pull > 490.0 and swing < 0.5)
    assert doubt is None or "within 20 mm of the axis" in doubt


def test_all_coefficients_change_alike():
    """Assert that the doubt widens coefficients and not delays, nor their ratios."""
    log_of = made(1, 6.0, joint_stiffness=1e4, noise=0.0)
    names = ("gamma1", "beta1", "input_delay")
    before = Estimate(names, np.array([4.0, 0.8, 1e-3]), 1e-8 * np.eye(3), (50.0,) * 3)
    after = with_bending(before, [log_of])
    share = 0.5 * excess_of_link([log_of]) / np.sqrt(3.0)
    assert share == pytest.approx(0.015, abs=0.005)
    assert after.deviations[:2] == pytest.approx(share * before.values[:2], rel=1e-3)
    assert after.deviations[2] == pytest.approx(1e-4)
    slopes = np.array([1.0 / 0.8, -4.0 / 0.8**2, 0.0])  # of gravity, the ratio
    assert slopes @ after.covariance @ slopes == pytest.approx(slopes @ before.covariance @ slopes)


def test_encoders_of_different_scales_leave_the_same_doubt():
    """Assert the doubt of a motor's encoder that reads half, of which the input shows less."""
    half = made(1, 6.0, joint_stiffness=70.0, motor_scale=0.5)
    assert excess_of_link([half]) < 0.6
    before = Estimate(("beta1",), np.array([0.8]), 1e-8 * np.eye(1), (50.0,))
    share = with_bending(before, [half]).deviations[0] / 0.8
    assert share == pytest.approx(0.5 / np.sqrt(3.0), rel=1e-3)


@pytest.mark.parametrize("more", [0.0, 0.2, -0.2])
def test_the_inertia_may_grow_with_the_frequency(more: float):
    """Assert that the change leads from least squares to an inertia J that grows to 1.2 J."""
    rates, sizes = np.array([3.0, 9.0, 20.0]), np.array([1.0, 0.2, 0.05])
    waves = sizes * np.sin(np.outer(TIMES, rates))
    position, inertias = waves.sum(axis=1), 2.0 * (1.0 + more * (rates / rates[-1]) ** 2)
    velocity = (sizes * rates * np.cos(np.outer(TIMES, rates))).sum(axis=1)
    torque = -waves @ (inertias * rates**2) + 3.0 * np.sin(position) + 0.5 * velocity
    columns = np.column_stack((-waves @ rates**2, np.sin(position), velocity))
    inertia, gravity, viscous = np.linalg.lstsq(columns, torque)[0]
    names = ("gamma1", "gamma_viscous", "beta1", "input_delay")
    values = np.array([gravity / inertia, viscous / inertia, 1.0 / inertia, 0.0])
    found = Estimate(names, values, 1e-8 * np.eye(4), (50.0,) * 4)
    noise = 1e-6 * RNG.standard_normal(len(TIMES))
    drive = replace(recording(TIMES, position, position + noise, torque), link_position=None)
    change = by_hidden_spring(found, [drive], {})
    widened, share = with_hidden_spring(found, [drive], {})
    if more <= 0.0:
        assert not change.any()
        assert (widened.covariance.tolist(), share) == (found.covariance.tolist(), 0.0)
        return
    truth = np.array([1.5, 0.25, 0.5, 0.0])
    assert np.abs(values - truth)[[0, 2]].min() > 0.05
    assert values + change == pytest.approx(truth, rel=0.05)
    assert widened.deviations[2] == pytest.approx(change[2] / np.sqrt(3.0), rel=0.01)
    assert share == pytest.approx(widened.deviations[2] / values[2], rel=0.01)
    # Terms with known values act as well.
    fewer = Estimate(names[1:3], values[1:3], 1e-8 * np.eye(2), (50.0,) * 2)
    known = by_hidden_spring(fewer, [drive], {"gamma1": values[0], "input_delay": 0.0})
    assert known == pytest.approx(change[1:3])
    assert by_hidden_spring(fewer, [drive], {}) != pytest.approx(change[1:3], rel=0.1)


def test_a_spring_behind_the_only_encoder_is_a_doubt():
    """Assert the warning, and an interval that holds the inertia of motor and link."""
    soft = made(1, 12.0, joint_stiffness=5e3)
    found = identify([log(replace(soft, link_position=None))])
    assert any("as if the joint bends" in warning for warning in found.warnings)
    inertia = found.parameters["inertia"]
    assert inertia.interval[0] < 1.3 < 0.95 * inertia.value
    about = Settings(known={"inertia": 1.3}, terms=("gravity", "viscous"))
    given = identify([log(replace(soft, link_position=None))], about)
    assert not any("as if the joint bends" in warning for warning in given.warnings)


def test_a_rigid_drive_moves_as_the_mean_of_both_sides():
    """Assert that the mean of both motions has the right inertia; the motor's has 3.5 % more.

    The mean of two logged speeds is used too, and a single one is not.
    """
    soft = made(1, 6.0, joint_stiffness=1e4, noise=1e-3)
    shifted = replace(soft, link_position=soft.needed_link_position + 1.0)
    (both,) = prepare([log(shifted)], 0.3, "rigid")[0].recorded
    mean = 0.5 * (soft.motor_position + soft.needed_link_position)
    np.testing.assert_allclose(both.motor_position - mean, 0.0, atol=2e-4)
    alone = identify([log(replace(soft, link_position=None))]).parameters["inertia"]
    assert alone.value > 1.02 * 1.3
    inertia = identify([log(soft)], Settings(model="rigid")).parameters["inertia"]
    assert inertia.value == pytest.approx(1.3, rel=5e-3)
    assert inertia.interval[0] < 1.3 < inertia.interval[1]
    assert 0.01 < inertia.half_width / inertia.value < 0.1
    speeds = {"motor_velocity": np.full(len(soft), 3.0), "link_velocity": np.full(len(soft), 1.0)}
    (both,) = prepare([log(replace(soft, **speeds))], 0.3, "rigid")[0].recorded
    assert both.motor_velocity == pytest.approx(2.0)
    del speeds["link_velocity"]
    (both,) = prepare([log(replace(soft, **speeds))], 0.3, "rigid")[0].recorded
    assert both.motor_velocity is None
