"""A dead zone and a limit of an amplifier whose commanded voltage was logged."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from benchmarks.trials.integrator import Law
from benchmarks.trials.realistic.drive import Plant, simulate

from flexid.identification.full_model.amplifier import IDEAL, Amplifier, _is_crossed
from flexid.identification.identify import identify
from flexid.identification.result import Identification
from flexid.recording.recording import Log, Recording

PLANT = Plant(1.0, 0.3, 100.0, motor_viscous=0.2, back_emf=1.0, coulomb=0.3, friction_width=1e-2)
GAIN = 1.0 / 0.3  # rad/s^2 for each unit of the input
STEP = 2e-3  # s
TONES = np.array([0.7, 3.3, 5.3, 8.1, 12.0, 17.0, 21.0, 25.0])  # rad/s
NOISE = 2e-5  # rad
REST = 1.5  # s
STICKING = 0.25  # V, which friction holds


def recorded(
    dead_zone: float, limit: float, unit: str = "V", *, square: bool = False, rests: bool = False
) -> Recording:
    """A log of the commanded input, made by an integrator that is not flexid's."""
    rng = np.random.default_rng(20261124)
    times = STEP * np.arange(6000)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(TONES))
    command = 2.5 * np.sin(np.outer(times, TONES) + phases).sum(axis=1)
    if square:
        command = 4.0 * np.sign(np.sin(2.0 * times))
    if rests:  # with a voltage that friction holds, as an integral control leaves it
        held = STICKING * np.sign(np.sin(np.pi * times / REST + 0.3))
        command = np.where(times % (2.0 * REST) < REST, 0.4 * command, held)
    plant = PLANT._replace(dead_zone=dead_zone, saturation=limit - dead_zone)
    nothing = np.zeros((len(times), 3))
    run = simulate(plant, times, command, Law(), nothing, nothing[:, 1:], 0.0, 5e-4)
    link, motor = run[:, 0], run[:, 2]
    errors = NOISE * rng.standard_normal((2, len(times)))
    return Recording(STEP, 0.0, link + errors[0], motor + errors[1], command, unit, source="made")


def identified(recording: Recording) -> Identification:
    """What one recording gives."""
    return identify([Log((recording,), (), "made", "made")])


@pytest.mark.parametrize(
    ("dead_zone", "limit", "passed"),
    [
        (0.0, None, [-5.0, -0.2, 0.0, 0.7, 5.0]),
        (0.5, None, [-4.5, 0.0, 0.0, 0.2, 4.5]),
        (0.5, 3.0, [-2.5, 0.0, 0.0, 0.2, 2.5]),
    ],
)
def test_what_an_amplifier_passes_on(dead_zone: float, limit: float | None, passed: list[float]):
    """Assert the characteristic, point by point."""
    commanded = np.array([-5.0, -0.2, 0.0, 0.7, 5.0])
    np.testing.assert_allclose(Amplifier(dead_zone, limit).passed(commanded), passed, atol=1e-15)


@pytest.mark.parametrize(("dead_zone", "limit"), [(0.0, 6.0), (0.4, 6.0)])
def test_an_amplifier_is_found(dead_zone: float, limit: float):
    """Assert both constants, and a gain that is right; uncorrected it is not within 4 %."""
    recording = recorded(dead_zone, limit)
    assert np.abs(recording.needed_input).max() > 8.0
    found = identified(recording)
    amplifier = found.choices.amplifier
    assert amplifier.dead_zone == pytest.approx(dead_zone, abs=0.05)
    assert amplifier.limit == pytest.approx(limit, rel=0.02)
    gain = found.parameters["input_gain_per_motor_inertia"]
    assert gain.value == pytest.approx(GAIN, rel=0.01)
    assert any("amplifier" in warning for warning in found.warnings)
    np.testing.assert_array_equal(
        found.recordings[0].input, amplifier.passed(recording.needed_input), strict=True
    )


@pytest.mark.parametrize(
    ("dead_zone", "limit", "unit", "square"),
    [(0.0, np.inf, "V", False), (0.4, np.inf, "V", True), (0.4, 6.0, "N m", False)],
)
def test_what_cannot_be_seen_is_not_corrected(dead_zone, limit, unit, square):
    """Assert that neither a linear amplifier, a square wave, nor a torque gives a correction."""
    recording = recorded(dead_zone, limit, unit, square=square)
    found = identified(recording)
    assert found.choices.amplifier == IDEAL
    assert not any("amplifier" in warning for warning in found.warnings)
    np.testing.assert_array_equal(found.recordings[0].input, recording.input)
    nothing = replace(recording, input=None, input_unit="")
    assert Amplifier(0.4, 6.0).behind(nothing) is nothing


@pytest.mark.parametrize("dead_zone", [0.0, 0.15])
def test_a_motor_that_sticks_shows_no_dead_zone(dead_zone: float):
    """Assert that what friction holds at rest is not taken for a dead zone, nor hides one."""
    recording = recorded(dead_zone, np.inf, rests=True)
    found = identified(recording)
    assert found.choices.amplifier.dead_zone == pytest.approx(dead_zone, abs=0.03)
    gain = found.parameters["input_gain_per_motor_inertia"]
    assert gain.value == pytest.approx(GAIN, rel=0.02)


@pytest.mark.parametrize(("limit", "crossed"), [(0.5, False), (1.0, False), (1.7, True)])
def test_square_waves_cross_no_limit(limit: float, crossed: bool):
    """Assert that those of one size each lie on one side of it, and that peaks beyond it count."""
    waves: Any = [SimpleNamespace(inputs=np.full((50, 1), size)) for size in (0.75, -1.5)]
    waves[1].inputs[:1] = 1.8
    assert _is_crossed(cast(Any, SimpleNamespace(samples=waves)), Amplifier(limit=limit)) == crossed
