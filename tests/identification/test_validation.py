"""Predictions of held-out data, on simulated logs with known noise and model."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_joint import COEFFICIENTS, JOINT, NOISE, PAPER, SAMPLE_TIME, data, made, seen

from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import divide
from flexid.estimators.segmented_motion import segmented_motion
from flexid.identification.full_model.model import Data
from flexid.identification.structure.validation import (
    Follower,
    following_states,
    from_fitted_states,
    validate_with,
)
from flexid.identification.vocabulary.evidence import Validation

CHANNELS = ("link_position", "motor_position", "deflection")


@pytest.fixture(scope="module")
def recording():
    """Return ten seconds, of which the last 3.6 are held out."""
    return made(21, 10.0)


START = 3200  # samples


def predicted(
    whole: Data,
    starts=(START,),
    timing: Timing | None = None,
    warm_up=0.5,
    follow: Follower | None = None,
    **changed,
) -> Validation:
    """Return a validation with the true coefficients, or with some changed."""
    values = np.array([*{**COEFFICIENTS, **changed}.values()])
    unknowns, segments = PAPER.unknowns(whole.groups), divide(whole.samples, 1.0)
    motion = segmented_motion(unknowns.system, segments, timing or Timing("cubic"), unknowns)
    motion = replace(motion, weights=np.full(2, 1.0 / NOISE), substeps=2)
    rest = JOINT, motion, values, whole.samples, starts
    return validate_with(*rest, follow=follow, warm_up=warm_up)


def test_right_model_predicts_to_the_noise(recording):
    """Assert that errors of the true model are at the sensors' noise, over any horizon."""
    found = predicted(data(recording))
    (run,) = found.runs
    errors = (run.measured - run.simulated).std(axis=0)
    assert errors == pytest.approx([NOISE, NOISE, NOISE * 2**0.5], rel=0.15)
    assert len(run.time) == 5000 - START
    assert run.time[0] == pytest.approx(recording.start_time + SAMPLE_TIME * START)
    assert list(found.horizons) == [0.05, 0.2, 1.0]
    assert all(fit > 99.9 for fits in found.horizons.values() for fit in fits.values())


def test_a_long_end_is_predicted_in_part():
    """Assert that up to 20 000 samples, spread over a long end, are predicted."""
    whole = data(made(21, 120.0))
    begun: list[np.ndarray] = []

    def follow(model: Any, values: Any, windows: Any, warm: Any) -> Any:
        begun.append(windows.starts)
        assert 10_000 < windows.lengths.sum() <= 20_000 + windows.lengths[0]
        return from_fitted_states(model, values, windows, warm)

    found = predicted(whole, follow=follow)
    assert all(fit > 99.9 for fits in found.horizons.values() for fit in fits.values())
    assert [starts[-1] > 57_000 for starts in begun] == [True, True]
    assert len(found.runs[0].time) == 60_000 - START


def test_fit_is_one_minus_error_over_spread(recording):
    """Assert that the fit in per cent is computed from the free run, about the mean."""
    found = predicted(data(recording), beta1=3.2)
    (run,) = found.runs
    for place, channel in enumerate(CHANNELS):
        y, prediction = run.measured[:, place], run.simulated[:, place]
        expected = 100 * (1 - np.linalg.norm(y - prediction) / np.linalg.norm(y - y.mean()))
        assert found.fit_percent[channel] == pytest.approx(expected, rel=1e-9)
        assert found.fit_percent[channel] < 99.0
    twice = predicted(data(recording, recording), (START, START), beta1=3.2)
    assert twice.fit_percent == pytest.approx(dict(found.fit_percent))
    assert len(twice.runs) == 2


def test_a_horizon_within_a_sample_is_left_out(recording):
    """Assert that a horizon shorter than a sample is left out."""
    slow = replace(
        recording,
        sample_time=0.11,
        link_position=recording.link_position[::55],
        motor_position=recording.motor_position[::55],
        input=recording.input[::55],
    )
    found = predicted(data(slow), (len(slow.motor_position) // 2,))
    assert list(found.horizons) == [0.2, 1.0, 5.0]


def test_a_motion_that_diverges_explains_nothing(recording):
    """Assert a poor fit in every channel if the free run diverges."""
    fits = predicted(data(recording), (1000,), alpha2=-300.0).fit_percent
    assert all(fit < -1e3 for fit in fits.values())


@dataclass
class Places:
    """Stand-in for windows, identified by their indices."""

    which: Any

    def __len__(self) -> int:
        return len(self.which)

    def at(self, places: Any) -> "Places":
        """Return a subset of the windows."""
        return Places(self.which[places])


@dataclass
class Bent:
    """Two windows with one state each, residuals x - 3 and atan(x); the latter overshoots."""

    segments: Places
    start_states = np.array([[0.0], [2.0]])

    @property
    def first_blocks(self) -> Any:
        """One block in each window."""
        return np.arange(len(self.segments) + 1)

    def equations(self, point: Any, _: str) -> Any:
        """Return normal equations and sums of squares at a point."""
        state, is_bent = point.initial_states[:, 0], self.segments.which == 1
        left = np.where(is_bent, np.arctan(state), state - 3.0)
        slope = np.where(is_bent, 1.0 / (1.0 + state**2), 1.0)
        return SimpleNamespace(
            normal=(slope**2)[:, None, None],
            gradient=-(slope * left)[:, None],
            costs=left**2,
        )


def test_one_window_keeps_no_other_back():
    """Assert that each window finds its own state, though one of them needs shorter steps."""
    model: Any = Bent(Places(np.arange(2)))
    states = following_states(model, np.zeros(0), model.segments)
    assert states[:, 0] == pytest.approx([3.0, 0.0], abs=1e-3)


def test_held_out_measurements_do_not_leak(recording):
    """Assert that held-out positions do not affect the prediction of the whole end."""
    late = np.arange(5000) >= START
    spoilt = seen(recording, 7.0 * late, -7.0 * late)
    (clean,), (other,) = (predicted(data(recording)).runs for recording in (recording, spoilt))
    assert clean.simulated == pytest.approx(other.simulated, abs=1e-12)


def test_late_channels_are_predicted_where_they_were_true():
    """Assert that with the right delays errors are at the noise, and far above it without."""
    recording = made(22, 6.0, input_delay=2.6e-3, link_delay=3.7e-3)
    right = Timing("cubic", {"input_delay": 2.6e-3, "link_delay": 3.7e-3})
    (run,) = predicted(data(recording), (2000,), right).runs
    inside = slice(None, -5)  # the last samples lie beyond the shifted data
    assert (run.measured - run.simulated)[inside, :2].std(axis=0) == pytest.approx(NOISE, rel=0.2)
    (wrong,) = predicted(data(recording), (2000,)).runs
    assert (wrong.measured - wrong.simulated)[:, 0].std() > 20.0 * NOISE


def test_rest_is_not_tested(recording):
    """Assert that a joint at rest in the held-out data has fits of NaN."""
    standing = np.minimum(np.arange(5000), 2500)
    noise = NOISE * np.random.default_rng(3).standard_normal((2, 5000))
    link, motor = recording.needed_link_position[standing], recording.motor_position[standing]
    still = replace(recording, link_position=link + noise[0], motor_position=motor + noise[1])
    found = predicted(data(still))
    assert all(np.isnan(fit) for fit in found.fit_percent.values())
    assert all(np.isnan(fit) for fits in found.horizons.values() for fit in fits.values())
