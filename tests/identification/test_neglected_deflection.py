"""Doubt about the inertia of a drive that was taken as rigid though its joint bends."""

from dataclasses import replace

import numpy as np
import pytest
from made_joint import log, made, recording

from flexid.identification.estimation.neglected_deflection import (
    excess_of_link,
    with_neglected_deflection,
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


def test_all_coefficients_change_alike():
    """Assert that the doubt widens coefficients and not delays, nor their ratios."""
    log_of = made(1, 6.0, joint_stiffness=1e4, noise=0.0)
    names = ("gamma1", "beta1", "input_delay")
    before = Estimate(names, np.array([4.0, 0.8, 1e-3]), 1e-8 * np.eye(3), (50.0,) * 3)
    after = with_neglected_deflection(before, [log_of])
    share = 0.5 * excess_of_link([log_of]) / np.sqrt(3.0)
    assert share == pytest.approx(0.015, abs=0.005)
    assert after.deviations[:2] == pytest.approx(share * before.values[:2], rel=1e-3)
    assert after.deviations[2] == pytest.approx(1e-4)
    slopes = np.array([1.0 / 0.8, -4.0 / 0.8**2, 0.0])  # of gravity, the ratio
    assert slopes @ after.covariance @ slopes == pytest.approx(slopes @ before.covariance @ slopes)


def test_a_rigid_drive_moves_as_the_mean_of_both_sides():
    """Assert that the mean of both motions has the right inertia; the motor's has 3.5 % more."""
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


def test_speeds_of_both_sides_are_averaged_too():
    """Assert that the mean of two logged speeds is used, and a single one is not."""
    soft = made(1, 6.0, joint_stiffness=1e4, noise=1e-3)
    speeds = {"motor_velocity": np.full(len(soft), 3.0), "link_velocity": np.full(len(soft), 1.0)}
    (both,) = prepare([log(replace(soft, **speeds))], 0.3, "rigid")[0].recorded
    assert both.motor_velocity == pytest.approx(2.0)
    del speeds["link_velocity"]
    (both,) = prepare([log(replace(soft, **speeds))], 0.3, "rigid")[0].recorded
    assert both.motor_velocity is None
