"""A session does not depend on the division of its stream into blocks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from moving_joint import LINK, MOTOR, OPTIONS, TORQUE, H, same, stream, watched

from flexid.streaming.health import Health
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Session

FEW = settings(max_examples=25)


KINDS = {
    "two encoders": OPTIONS,
    "the link alone": WatchOptions(H, ("gravity", "joint_damping"), "link"),
    "a motor in front of a gear": replace(OPTIONS, motor_turn=2.0 * np.pi / 40.0),
}


def troubled(kind: str) -> tuple[WatchOptions, np.ndarray]:
    """Return options, and a stream with faults of every kind."""
    options, samples = KINDS[kind], stream(4.0)
    if options.motor_turn:
        samples[:, MOTOR] %= options.motor_turn
    samples[300, LINK] += 0.1
    samples[420] = np.nan
    samples[700:1000, LINK] = samples[700, LINK]
    samples[1300:1310] = samples[1299]
    samples = np.delete(samples, slice(1500, 1540), axis=0)
    samples[:, TORQUE] = np.clip(samples[:, TORQUE], -20.0, 20.0)
    return options, samples[:, : 1 + options.n_encoders + options.n_inputs]


@pytest.mark.parametrize("kind", KINDS)
@FEW
@example(cuts=list(range(1, 1961)))
@given(cuts=st.lists(st.integers(0, 1960), max_size=12).map(sorted))
def test_blocks_change_nothing(kind: str, cuts: list[int]):
    """Assert that a stream divided anywhere gives the same bits as the whole."""
    options, samples = troubled(kind)
    session = Session(options)
    for part in np.split(samples, cuts):
        session.feed(part)
    assert same(session, watched(samples, options))


# A resting link with huge jumps, after which sums consist of rounding errors.
SPIKES = np.zeros((34, 4))
SPIKES[[13, 15, 19, 33], LINK] = 1e10, 1449797.0, 1e10, 1.0
# A motion whose powers exceed the range of floating point.
FAINT = np.full((3, 4), 4.64249011e-187)
FAINT[0, MOTOR], FAINT[0, TORQUE] = 0.0, 1.0


@FEW
@example(samples=SPIKES.copy(), timed=True)
@example(samples=np.zeros((9, 4)), timed=True)
@example(samples=np.ones((300, 4)), timed=True)
@example(samples=np.array([[0.0, 0.0, 1.0, 2.5e-155], 4 * [0.0], 4 * [0.0]]), timed=True)
@example(samples=FAINT.copy(), timed=True)
@example(samples=2.5e-153 * np.arange(400.0).reshape(100, 4) ** 2, timed=True)
@given(
    arrays(
        np.float64,
        st.tuples(st.integers(1, 300), st.just(4)),
        elements=st.floats(allow_nan=True, allow_infinity=True),
        fill=st.floats(-10.0, 10.0),
    ),
    st.booleans(),
)
def test_any_samples_leave_a_state_that_is_finite_or_flagged(samples: np.ndarray, timed: bool):
    """Assert that any numbers give a finite estimate, or a sensor fault."""
    if timed:
        samples[:, 0] = H * np.arange(len(samples))
    session = watched(samples)
    values = session.learner.values(session.now.states)
    assert np.isfinite(values).all() or session.health.health is Health.SENSOR_FAULT
    assert session.health.reason
    assert session.counts.fed == len(samples)
    for found in session.parameters.values():
        assert found.verdict == "undetermined" or np.isfinite(found.interval).all()
    assert set(session.excitation) == {"link", "motor"}
