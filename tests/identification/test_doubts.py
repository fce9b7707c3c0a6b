"""What a rig may do unseen, and by how much it may move each value."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.estimation.doubts import (
    DOUBTS,
    Doubted,
    calibration,
    coil_lag,
    covariance_of,
    dead_zone,
    eccentric_encoders,
    further_modes,
    gauge_scale,
    lag,
    looks_like_a_term,
    looks_like_the_acceleration,
    noise_of_the_input,
    play,
    scales_apart,
    widened,
)
from flexid.identification.vocabulary.estimate import Estimate

VALUES = {"theta1": 5.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 20.0, "beta1": 3.0}
DELAY = 5e-4  # s
NAMES = (*VALUES, INPUT)


def doubted(unit: str = "N m", by_gauge: Any = None, apart: float = 0.0) -> Doubted:
    """A fit of a joint with a late input, of whose accelerations a tenth is unexplained."""
    values = np.array([*VALUES.values(), DELAY])
    structure = SimpleNamespace(timing=Timing("zero", sought=(INPUT,)))
    fitted = SimpleNamespace(
        names=NAMES,
        values=values,
        data=SimpleNamespace(scales_apart=apart),
        structure=structure,
        by_name=dict(zip(NAMES, values.tolist(), strict=True)),
    )
    sizes = {name: 0.5 / value for name, value in VALUES.items()}
    return Doubted(cast(Any, fitted), sizes, {"link": 0.1, "motor": 0.2}, unit, by_gauge)


def deviation(of: Any, name: str, found: Doubted) -> float:
    """How far one doubt may move a value."""
    directions = of(found)
    return float(np.sqrt(np.sum(directions[NAMES.index(name)] ** 2)))


def test_a_heavier_link_moves_its_whole_balance():
    """Assert that a further mode moves the link's coefficients together, and no others."""
    directions = further_modes(doubted())
    assert directions.shape == (len(NAMES), 1)
    share = directions[:, 0] / np.array([*VALUES.values(), DELAY])
    assert share[0] == share[1] > 0.0
    assert not share[2:].any()


@pytest.mark.parametrize("part", [0.3, 1.0])
def test_a_lag_in_place_of_a_delay(part: float):
    """Assert that the allowance is what a coil does to the inertia that a delay shows.

    With lag T, back-EMF e and friction f, u -> v is 1 / ((1 + T s)(s + f) + e); the model has
    1 / ((a s + b) exp(T s)). Equal to first order in s where a / b = (1 - T e) / (f + e).
    """
    viscous = VALUES["alpha2"]
    emf, friction = part * viscous, (1.0 - part) * viscous
    true = np.polynomial.Polynomial([1.0, DELAY]) * np.polynomial.Polynomial([friction, 1.0]) + emf
    delayed = true * np.polynomial.Polynomial([1.0, -DELAY])  # exp(-T s), to first order
    inertia = delayed.coef[1] / delayed.coef[0] * viscous
    apart = deviation(coil_lag, "alpha1", doubted("V")) / VALUES["alpha1"]
    assert 1.0 - inertia == pytest.approx(part * DELAY * viscous, rel=1e-9)
    assert 1.0 - inertia <= 1.96 * apart < 1.2 * DELAY * viscous
    assert deviation(coil_lag, "theta2", doubted("V")) == 0.0


def test_a_lag_passes_less_than_a_delay():
    """Assert that the gain is doubted by what lags take away at the resonance, root mean square.

    Half of the delays are delays; of the others the lag is anything between none and all.
    """
    resonance = np.sqrt(VALUES["theta2"] + VALUES["alpha1"])  # rad/s
    lags = np.linspace(0.0, DELAY, 1001)
    lost = 1.0 - 1.0 / np.hypot(1.0, resonance * lags)
    apart = deviation(lag, "beta1", doubted()) / VALUES["beta1"]
    assert apart == pytest.approx(np.sqrt(0.5 * np.mean(lost**2)), rel=0.05)
    assert deviation(lag, "alpha1", doubted()) == 0.0


def test_an_input_that_was_low_passed_acts_early():
    """Assert that a lead is doubted as a lag is, and that no coil makes one."""
    early = doubted("V")
    early.fitted.by_name[INPUT] = -DELAY
    assert deviation(lag, "beta1", early) == deviation(lag, "beta1", doubted("V")) > 0.0
    assert not np.any(coil_lag(early))


def test_play_in_place_of_a_hardening_spring_makes_it_stiffer():
    """Assert that both springs are doubted together, up to all of what play makes of them."""
    directions = play(replace(doubted(), by_play=0.3))
    share = directions[:, 0] / np.array([*VALUES.values(), DELAY])
    assert np.sqrt(3.0) * share[1:3] == pytest.approx(0.3)
    assert not share[[0, 3, 4, 5]].any()
    assert not np.any(play(doubted()))


@pytest.mark.parametrize("of", [coil_lag, dead_zone])
def test_a_torque_has_neither_coil_nor_amplifier(of: Any):
    """Assert that these doubts are of a voltage alone."""
    assert np.any(of(doubted("V")))
    assert not np.any(of(doubted("N m")))


def test_a_gauge_that_moves_no_spring_is_doubted_all_the_same():
    """Assert that a spring is never known better than the scale of the deflection's sensor."""
    change = np.zeros(len(NAMES))
    change[NAMES.index("alpha1")] = -0.03 * VALUES["alpha1"]  # by 1 % of the scale
    found = doubted(by_gauge=change)
    for name, factor in (("theta2", 1.0), ("alpha1", 3.0)):
        own = deviation(gauge_scale, name, found) / VALUES[name]
        assert own == pytest.approx(0.02 * factor)
    assert deviation(gauge_scale, "beta1", found) == 0.0
    assert not np.any(eccentric_encoders(found))


def test_two_encoders_err_once_per_turn():
    """Assert that gravity is doubted by what 0.5 mrad of deflection pulls."""
    assert deviation(eccentric_encoders, "theta1", doubted()) == pytest.approx(5e-4 * 100.0)
    assert not np.any(gauge_scale(doubted()))


def test_scales_that_differ_pull_like_gravity():
    """Assert that gravity is doubted by what the spring makes of the share, the rest by it."""
    found = doubted(apart=0.02)
    assert deviation(scales_apart, "theta1", found) == pytest.approx(0.02 * (5.0 + 100.0))
    assert deviation(scales_apart, "theta2", found) == pytest.approx(0.02 * 100.0)
    assert not np.any(scales_apart(doubted()))


def test_what_is_unexplained_may_look_like_a_term():
    """Assert that a term that moves its balance less is doubted more, and friction most."""
    found = doubted()
    for name, share, part in (("theta2", 0.1, 0.04), ("alpha1", 0.2, 0.08), ("alpha2", 0.2, 0.7)):
        own = deviation(looks_like_a_term, name, found) / VALUES[name]
        assert own == pytest.approx(part * share / 0.5)
    assert deviation(looks_like_a_term, INPUT, found) == 0.0


def test_what_is_unexplained_makes_a_balance_heavier():
    """Assert that each balance may be off by the square of its share, all of it in one."""
    link, motor = looks_like_the_acceleration(doubted()).T
    assert link[NAMES.index("theta2")] == pytest.approx(0.1**2 * VALUES["theta2"])
    assert motor[NAMES.index("alpha2")] == pytest.approx(0.2**2 * VALUES["alpha2"])
    assert motor[NAMES.index("beta1")] == pytest.approx(0.2**2 * VALUES["beta1"])
    assert link[NAMES.index("beta1")] == motor[NAMES.index("theta2")] == 0.0
    assert motor[NAMES.index(INPUT)] == 0.0


def test_the_inputs_noise_may_be_its_sensors():
    """Assert that values may be off by all that it would change, evenly, and by nothing unless."""
    change = np.array([0.0, 0.0, -30.0, 0.0, -0.3, 0.0])
    assert noise_of_the_input(doubted()).shape == (len(NAMES), 0)
    (found,) = noise_of_the_input(replace(doubted(), by_noise=change)).T
    np.testing.assert_allclose(found, change / np.sqrt(3.0))


def test_covariances_add():
    """Assert that all doubts together add their covariances, and that each value has some."""
    found = doubted("V")
    known = Estimate(NAMES, found.fitted.values, np.zeros((6, 6)), (10.0,) * 6)
    every = [(covariance_of(doubt(found)), words) for doubt, words in DOUBTS.items()]
    estimate, widest = widened(known, every)
    np.testing.assert_allclose(estimate.covariance, sum(part for part, _ in every))
    assert np.all(np.diag(covariance_of(calibration(found))) > 0.0)
    assert widest["beta1"] == DOUBTS[looks_like_the_acceleration]
    assert widest[INPUT] == ""
