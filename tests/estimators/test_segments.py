"""Segments of recordings, shared among threads."""

import threading

import numpy as np
import pytest

import flexid.estimators.samples as sharing
from flexid.estimators.samples import FEWEST_SAMPLES, Samples, divide, first_states, in_threads


def record(n: int, sample_time: float = 0.01, start_time: float = 0.0) -> Samples:
    """Return a recording with one row, whose position is the sample's number."""
    position = np.arange(n, dtype=np.float64)[:, None]
    return Samples(position, 10.0 * position, np.zeros((n, 1)), sample_time, start_time)


def test_segments_cover_every_recording_and_cross_none():
    """Assert that segments are contiguous, and that none crosses from one recording to the next."""
    segments = divide([record(1050), record(250, start_time=100.0)], 3.0)
    assert segments.lengths.sum() == 1300
    assert np.array_equal(segments.starts[1:], np.cumsum(segments.lengths)[:-1])
    assert 1050 in segments.starts
    assert segments.places.tolist() == [0, 0, 0, 0, 1]
    assert segments.start_times[-1] == 100.0
    assert divide([record(40)], 1.0).outputs[3].tolist() == [3.0]


def test_halves_start_where_the_whole_did():
    """Assert that halving keeps all samples, and that merged halves are the original segments."""
    segments = divide([record(1001, start_time=5.0)], 2.5)
    halves = segments.halved()
    assert np.array_equal(halves.starts[::2], segments.starts)
    assert np.array_equal(halves.start_times[::2], segments.start_times)
    assert halves.lengths.sum() == segments.lengths.sum()
    assert np.abs(np.diff(halves.lengths.reshape(-1, 2))).max() <= 1
    assert halves.start_times[1] == pytest.approx(5.0 + 0.01 * halves.starts[1])
    segments = divide([record(400), record(250, start_time=9.0)], 1.0, margin=0.05)
    whole = segments.halved().merged()
    assert whole is not None
    for name in ("starts", "lengths", "sample_times", "start_times", "recordings"):
        assert np.array_equal(getattr(whole, name), getattr(segments, name))
    assert divide([record(400), record(300)], 1.0).merged() is None


@pytest.mark.parametrize(("frequency", "error"), [(0.5, 0.15), (40.0, 0.2)])
def test_first_velocities_follow_a_vibration(frequency, error):
    """Assert that initial velocities fit a fast motion in few samples, and a slow one in many.

    A cubic over 30 ms cannot follow 40 Hz. Over six samples it would estimate the slow velocity
    with an error of 0.3 of its amplitude.
    """
    time = 2e-3 * np.arange(2000)
    size = 1e-3 / frequency
    noise = size * 1e-3 * np.random.default_rng(5).standard_normal(len(time))
    positions = size * np.sin(2.0 * np.pi * frequency * time) + noise
    samples = Samples(np.column_stack((positions, positions)), None, np.zeros((2000, 1)), 2e-3)
    segments = divide([samples], 0.1)
    omega = 2.0 * np.pi * frequency
    velocities = omega * size * np.cos(omega * segments.start_times)
    found = first_states(segments)[:, 1]
    assert np.sqrt(np.mean((found - velocities) ** 2)) < error * omega * size


def test_some_segments_are_of_every_recording():
    """Assert that a subset is spread evenly, with segments of every recording."""
    segments = divide([record(1000), record(60), record(1000)], 0.3)
    some = segments.some(20)
    assert 18 <= len(some) <= 26
    assert {*some.recordings.tolist()} == {0, 1, 2}
    assert np.isin(some.starts, segments.starts).all()
    spacing = np.diff(some.starts[some.recordings == 0])
    assert spacing.max() - spacing.min() <= 2
    assert len(segments.some(10_000)) == len(segments)


def test_margins_belong_to_no_segment():
    """Assert that margins of every recording are outside the segments, but kept as data."""
    segments = divide([record(300), record(200, start_time=50.0)], 1.0, margin=0.05)
    assert len(segments.outputs) == 500
    expected = np.ones(500, dtype=bool)
    expected[[*range(5), *range(295, 305), *range(495, 500)]] = False
    assert np.array_equal(segments.within, expected)
    assert np.array_equal(segments.halved().within, expected)
    edges = [(5, 295), (305, 495)]
    for (first, stop), recording in zip(edges, (0, 1), strict=True):
        own = segments.recordings == recording
        assert segments.starts[own].min() == first
        assert (segments.starts + segments.lengths)[own].max() == stop
    assert segments.lengths.sum() == 480
    assert segments.start_times[segments.recordings == 1].min() == pytest.approx(50.05)


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_what_is_too_short_is_left_out(margin):
    """Assert that a recording too short for a segment, without its margins, is left out."""
    more = round(2.0 * margin / 0.01)
    segments = divide(
        [record(FEWEST_SAMPLES - 1 + more), record(FEWEST_SAMPLES + more)], 1.0, margin=margin
    )
    assert segments.recordings.tolist() == [1]
    assert segments.lengths.tolist() == [FEWEST_SAMPLES]
    assert divide([record(400)], 0.01).lengths.min() >= FEWEST_SAMPLES
    twice = 2 * FEWEST_SAMPLES
    cut = [divide([record(2 * n)], 0.01 * n).can_be_halved for n in (twice, twice - 1)]
    assert cut == [True, False]


@pytest.mark.parametrize("lengths", [[30_000], [20] * 3, [1_000] * 37, [50_000, 20, 20, 9_000]])
@pytest.mark.parametrize("cores", [1, 2, 7])
def test_every_segment_is_done_once(
    monkeypatch: pytest.MonkeyPatch, lengths: list[int], cores: int
):
    """Assert that ranges cover all segments exactly once."""
    monkeypatch.setattr(sharing, "cores", lambda: cores)
    done = np.zeros(len(lengths), dtype=int)

    def run(first: int, stop: int) -> None:
        done[first:stop] += 1

    in_threads(run, np.array(lengths, dtype=np.int64))
    np.testing.assert_array_equal(done, 1)


def test_long_records_have_several_threads(monkeypatch: pytest.MonkeyPatch):
    """Assert that two cores work at the same time: each waits for the other."""
    monkeypatch.setattr(sharing, "cores", lambda: 2)
    together = threading.Barrier(2, timeout=30.0)

    def run(_first: int, _stop: int) -> None:
        together.wait()

    in_threads(run, np.full(100, 1_000))
