"""Excitation of coefficients, on Gram matrices with a known condition number."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import RowFit
from flexid.identification.estimation.excitations import (
    directions,
    one_way_frictions,
    row_excitation,
    unexcited,
    without_noise,
)
from flexid.identification.full_model.model import Data
from flexid.identification.vocabulary.thresholds import THRESHOLDS

SPRING = ("theta_cubic", "alpha_cubic", "theta_damping", "alpha_damping")


def row_of(columns: dict[str, np.ndarray], acceleration: np.ndarray) -> Any:
    """Return the sums of a row with these regressors."""
    regressors = np.array([*columns.values()])
    total = float(acceleration @ acceleration)
    return SimpleNamespace(
        name="link",
        coefficients=tuple(columns),
        gram=regressors @ regressors.T,
        count=len(acceleration),
        total_sum=total,
    )


def made_row(moved: float) -> Any:
    """Return the sums of a row over two logs with offsets, and a shifted zero of its deflection."""
    rng = np.random.default_rng(8)
    gravity, deflection, viscous = rng.standard_normal((3, 400))
    first = np.arange(400) < 150
    columns = {"theta1": gravity, "theta2": moved * deflection + 0.3, "theta_viscous": viscous}
    columns |= {"theta_offset[0]": 1.0 * first, "theta_offset[1]": 1.0 * ~first}
    return row_of(columns, gravity + deflection)


# Two regressors as large as the acceleration, of correlation c, can form 1 - c of its square.
@pytest.mark.parametrize(("share", "lost"), [(0.0071, False), (0.0069, True)])
def test_seven_thousandths_of_the_acceleration_are_the_edge(share, lost):
    """Assert that below the limit the confounded pair is lost, with all terms of the spring."""
    correlation = 1.0 - share**2
    one, other, third = np.sqrt(3.0) * np.eye(3)
    second = correlation * one + np.sqrt(1.0 - correlation**2) * other
    row = row_of({"theta1": one, "theta2": second, "theta_viscous": third}, one)
    empty: Any = SimpleNamespace(coefficients=())
    found = unexcited([row, empty], {"theta1": 1.0}, THRESHOLDS.lost_share)
    everything = {"theta1", "theta2", "alpha1", "beta1", *SPRING}
    assert found == (everything if lost else frozenset())


@pytest.mark.parametrize("moved", [1e-2, 1e-6, 1e-7, 1e-12, 1e-16, 0.0])
def test_a_joint_that_does_not_bend_is_not_excited(moved: float):
    """Assert that a deflection excites beyond noise and rounding, even with unknown offsets.

    Zeros of the encoders that are 0.3 million times as far apart do not hide a deflection.
    """
    row, bends = made_row(moved), moved > 5e-7
    stiffness = 1.0 / moved if bends else 1e5
    for zero in (0.3 * stiffness, 0.0, -0.3 * stiffness):
        offsets = dict.fromkeys(("theta_offset[0]", "theta_offset[1]"), zero)
        values = {"theta1": 1.0, "theta2": stiffness, **offsets}
        lost = unexcited([row], values, THRESHOLDS.lost_share)
        assert lost == frozenset() if bends else "theta2" in lost
    assert bends or row_excitation(row).condition_number > 1e9


@pytest.mark.parametrize(("apart", "lost"), [(0.5, False), (1e-3, True)])
def test_gravity_that_looks_like_a_constant_leaves_the_spring(apart, lost):
    """Assert that a spring can be lost by a direction other than the worst one."""
    rng = np.random.default_rng(9)
    swing, motion, speed = rng.standard_normal((3, 400))
    columns = {"theta1": 1.0 + 1e-4 * swing, "theta_offset": np.ones(400)}
    columns |= {"theta2": motion, "theta_viscous": motion + apart * speed}
    found = unexcited([row_of(columns, motion)], {"theta2": 1.0}, THRESHOLDS.lost_share)
    assert {"theta1", "theta_offset"} <= found
    assert ("theta2" in found) == lost


@pytest.mark.parametrize("light", [200.0, 1000.0])
def test_torques_that_all_but_cancel_say_what_they_leave(light):
    """Assert that a row is excited if its acceleration is a small difference of large torques."""
    rng = np.random.default_rng(5)
    torque, left = rng.standard_normal((2, 400))
    columns = {"alpha1": torque - left / light, "beta1": torque}
    row = row_of(columns, left)
    values = {"alpha1": -light, "beta1": light}
    share = directions(row, values)[0][0]
    assert 0.5 < share < 1.0
    weaker, parts = directions(row, {name: 0.01 * c for name, c in values.items()})
    assert weaker[0] == pytest.approx(0.01 * share, rel=1e-6)
    assert parts[0] == {"alpha1", "beta1"}


def noisy_sine(noise: np.ndarray) -> RowFit:
    """Return the sums of a link's row on a noisy sine, with a deflection of 3 %."""
    sine = np.sin(0.01 * np.arange(4000))
    link, deflection = sine + noise[0], 0.03 * sine + noise[1]
    row = row_of({"theta1": link, "theta2": deflection}, sine)
    empty = np.empty((0, 0))
    return RowFit(
        "link", row.coefficients, row.gram, empty, row.total_sum, (), empty, sine, sine, empty
    )


@pytest.mark.parametrize(("count", "lost"), [(100, True), (4000, False)])
def test_noise_is_no_motion(count: int, lost: bool):
    """Assert that the part of an excitation due to noise is subtracted, if samples suffice."""
    rng = np.random.default_rng(6)
    noise, added = 1e-3 * rng.standard_normal((2, 2, 4000))
    noise[1] += 5e-4 * np.sqrt(2.0) * np.sin(0.03 * np.arange(4000))
    row = noisy_sine(noise)
    values = {"theta1": 10.0, "theta2": 300.0}
    assert directions(row, values)[0][0] > 20.0 * THRESHOLDS.lost_share
    motion = without_noise(row, noisy_sine(noise + added), count)
    shares, parts = directions(motion, values)
    assert (shares[0] < THRESHOLDS.lost_share) == lost
    assert parts[0] == {"theta1", "theta2"}


@pytest.mark.parametrize("relative", [False, True])
def test_noise_is_added_as_the_sensors_have_it(relative: bool):
    """Assert that noise is added to a measured deflection, or else to each encoder."""
    rng = np.random.default_rng(7)
    motor = 1e-3 * rng.standard_normal(4000)
    link = motor + 1e-5 * rng.standard_normal(4000) if relative else motor[::-1]
    positions = np.column_stack((link, motor))
    samples = Samples(positions, None, np.zeros((4000, 1)), 1e-3)
    relative_to = {"link": "motor"} if relative else {}
    data = Data((samples,), (0,), np.array([1e-3, 1e-3]), relative_to)
    (noisier,) = data.with_noise(1).samples
    added = noisier.positions - positions
    deflection = 1e-5 if relative else np.sqrt(2.0) * 1e-3
    assert added.std(axis=0) == pytest.approx(1e-3, rel=0.05)
    assert (added[:, 0] - added[:, 1]).std() == pytest.approx(deflection, rel=0.15)


WAYS = np.repeat([0.0, 1.0], [100, 300])
TORQUE = np.where(WAYS, 8.0, 0.0)
SPEED = np.linspace(-1.0, 5.0, 400)
RIPPLE = np.sin(np.arange(400))


@pytest.mark.parametrize(
    ("ways", "torque", "parts"),
    [
        (WAYS, TORQUE, {"alpha2": 0.0, "beta1": 0.125}),
        (-WAYS, TORQUE, {"alpha2": 0.0, "beta1": -0.125}),
        (WAYS, TORQUE + 0.05 * RIPPLE, {"alpha2": 0.0, "beta1": 0.125}),
        (WAYS, TORQUE + 0.5 * RIPPLE, None),
        (np.where(np.arange(400) > 390, -1.0, WAYS), TORQUE, None),
        (np.zeros(400), TORQUE, None),
        (np.where(np.arange(400) < 205, 0.98, 1.0), TORQUE, None),
        (np.where(np.arange(400) < 195, 0.98, 1.0), TORQUE, {"alpha2": 0.0, "beta1": 0.125}),
    ],
    ids=["step", "back", "hardly varies", "varies", "both ways", "rest", "seldom", "mostly"],
)
def test_a_friction_one_way_is_part_of_a_constant_torque(ways, torque, parts):
    """Assert that one-way friction counts as part of the torque if nothing else varies."""
    row = SimpleNamespace(
        coefficients=("alpha2", "alpha_coulomb", "beta1"),
        regressors=np.array([SPEED, ways, torque]),
    )
    rows: Any = [row]
    found = one_way_frictions(rows, ("alpha2", "beta1"), THRESHOLDS.lost_share)
    assert set(found) == ({"alpha_coulomb"} if parts else set())
    if parts:
        assert found["alpha_coulomb"] == pytest.approx(parts, abs=2e-3)
    assert not one_way_frictions(rows, row.coefficients, THRESHOLDS.lost_share)
