"""Delays undone row by row: what the alignment of a recording does, however a stream is cut."""

from dataclasses import replace

import numpy as np
import pytest
from moving_joint import LINK, MOTOR, OPTIONS, TORQUE, H, stream

from flexid.identification.preparation.alignment import Alignment, Delay, aligned
from flexid.recording.recording import Recording
from flexid.recording.shift import SETTLING
from flexid.streaming.learner import Delays

LATE = [(0.0, 2.4), (0.6, -1.3), (-2.0, 3.0), (1.5, 0.0), (-0.3, 0.25)]
"""Delays of the input and of the link, in samples."""


def delay(samples: float) -> Delay:
    """A delay that is given."""
    return Delay(H * samples, 0.0, (0.0, 0.0), "given")


@pytest.mark.parametrize("from_deflection", [False, True])
@pytest.mark.parametrize(("drive", "link"), LATE)
def test_rows_are_those_of_the_aligned_recording(drive: float, link: float, from_deflection: bool):
    """Assert the same rows beyond the filter's beginning, in one block and in many."""
    samples = stream(2.0)
    recording = Recording(
        H, 0.0, samples[:, LINK].copy(), samples[:, MOTOR].copy(), samples[:, TORQUE].copy(), "N m",
        link_from_deflection=from_deflection,
    )  # fmt: skip
    right = aligned(recording, Alignment("linear", delay(drive), delay(link), ""))
    assert right.link_position is not None
    assert right.input is not None
    expected = np.column_stack((right.link_position, right.motor_position, right.input))
    options = replace(
        OPTIONS, input_delay=H * drive, link_delay=H * link, from_deflection=from_deflection
    )
    delays = Delays(options)
    for cuts in ([], [1, 2, 7, 40, 41, 300]):
        state, found = delays.first_state(), []
        for part in np.split(samples[:, 1:], cuts):
            state, rows = delays.undone(state, part)
            found.append(rows)
        rows = np.concatenate(found)
        n = min(len(rows), len(expected)) - SETTLING
        assert n > 900
        np.testing.assert_allclose(rows[-n - 3 : -3], expected[-n - 3 : -3], rtol=0.0, atol=1e-12)


def test_a_break_begins_a_run():
    """Assert that a row of NaN is kept, and that nothing of the rows before passes it."""
    delays = Delays(replace(OPTIONS, link_delay=2.4 * H))
    rows = stream(2.0)[:, 1:]
    broken = np.vstack((rows[:400], np.full((1, 3), np.nan), rows[400:]))
    _, found = delays.undone(delays.first_state(), broken)
    (place,) = np.flatnonzero(np.isnan(found).any(axis=1))
    alone = [delays.undone(delays.first_state(), part)[1] for part in (rows[:400], rows[400:])]
    np.testing.assert_array_equal(found[:place], alone[0])
    np.testing.assert_array_equal(found[place + 1 :], alone[1])
