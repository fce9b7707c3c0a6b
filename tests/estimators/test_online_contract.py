"""What every online estimator must do: one protocol, one behaviour where data are bad."""

import numpy as np
import pytest
from online_estimators import ONLINE, TRUE, Builder, oscillator, oscillator_motion, with_rest

from flexid.errors import SettingError
from flexid.estimators.online import Status
from flexid.estimators.parametric_observer import ParametricObserver
from flexid.recording.recording import Hold

every = pytest.mark.parametrize("build", ONLINE.values(), ids=ONLINE.keys())


def as_values(system, coefficients) -> dict[str, float]:
    """Coefficients by name."""
    return dict(zip(system.coefficients, coefficients.tolist(), strict=True))


@every
def test_replay_is_the_step(build: Builder):
    """Assert that replay equals stepping, bit for bit, with its info, also over bad samples."""
    estimator = build(oscillator(), "linear")
    samples = estimator.pack(oscillator_motion(3.0, noise=1e-4))
    samples[700] = np.nan
    state = estimator.init({"spring": 1.0})
    history = estimator.replay(state, samples)
    for place, sample in enumerate(samples):
        state, info = estimator.step(state, sample)
        assert np.array_equal(estimator.coefficients(state), history.coefficients[place])
        assert np.array_equal(info[:-1], history.innovations[place], equal_nan=True)
        assert info[-1] == history.status[place]
    assert np.array_equal(state, history.state)


@every
def test_taken_up_in_the_middle(build: Builder):
    """Assert that a state is all there is: a replay in two parts gives the same bits."""
    estimator = build(oscillator(), "linear")
    samples = estimator.pack(oscillator_motion(4.0, noise=1e-4))
    whole = estimator.replay(estimator.init(), samples)
    first = estimator.replay(estimator.init(), samples[:777])
    second = estimator.replay(first.state, samples[777:])
    assert np.array_equal(second.state, whole.state)
    assert np.array_equal(second.coefficients, whole.coefficients[777:])


@every
def test_pure(build: Builder):
    """Assert that step and replay leave state and samples as they were."""
    estimator = build(oscillator(), "linear")
    samples = estimator.pack(oscillator_motion(3.0))
    state = estimator.replay(estimator.init(), samples[:1200]).state
    kept, kept_samples = state.copy(), samples.copy()
    estimator.step(state, samples[1200])
    estimator.replay(state, samples[1200:])
    assert np.array_equal(state, kept)
    assert np.array_equal(samples, kept_samples)


@every
@pytest.mark.parametrize("known", [None, TRUE["gain"]], ids=["unknown gain", "known gain"])
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_converges_on_clean_data(build: Builder, hold: Hold, known: float | None):
    """Assert that clean, exciting data give the truth, whether or not the input's gain is known."""
    system = oscillator(known=known)
    estimator = build(system, hold)
    history = estimator.replay(estimator.init(), estimator.pack(oscillator_motion(80.0, hold)))
    expected = {name: TRUE[name] for name in system.coefficients}
    assert as_values(system, history.coefficients[-1]) == pytest.approx(expected, rel=2e-4)
    knows = not isinstance(estimator, ParametricObserver)  # whether it can know what is determined
    assert history.status[-1] == (Status.USED if knows else Status.STARTING)


@every
def test_the_hold_matters(build: Builder):
    """Assert that a held input taken as held gives a gain ten times better than taken as linear."""
    errors = {}
    for hold in ("zero", "linear"):
        estimator = build(oscillator(), hold)
        samples = estimator.pack(oscillator_motion(80.0, "zero"))
        last = estimator.replay(estimator.init(), samples).coefficients[-1]
        errors[hold] = np.abs(last / list(TRUE.values()) - 1.0).max()
    assert errors["linear"] > 10.0 * errors["zero"]


@every
@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("place", [0, -1], ids=["position", "input"])
def test_a_bad_sample_is_rejected(build: Builder, bad: float, place: int):
    """Assert that a sample that is no number changes no estimate, is named, and does no harm."""
    system = oscillator()
    estimator = build(system, "linear")
    samples = estimator.pack(oscillator_motion(80.0))
    samples[[1000, 9000, 9001], place] = bad
    history = estimator.replay(estimator.init(), samples)
    assert np.flatnonzero(history.status == Status.REJECTED).tolist() == [1000, 9000, 9001]
    for n in (1000, 9000, 9001):
        assert np.array_equal(history.coefficients[n], history.coefficients[n - 1])
        assert np.isnan(history.innovations[n]).all()
    assert as_values(system, history.coefficients[-1]) == pytest.approx(TRUE, rel=5e-4)


@every
def test_a_start_ten_times_wrong(build: Builder):
    """Assert that a start ten times too high or low ends right, or is not called determined."""
    system = oscillator()
    for factor in (10.0, 0.1):
        estimator = build(system, "linear")
        start = {name: factor * value for name, value in TRUE.items()}
        samples = estimator.pack(oscillator_motion(60.0, noise=1e-4))
        history = estimator.replay(estimator.init(start), samples)
        wrong = as_values(system, history.coefficients[-1]) != pytest.approx(TRUE, rel=0.05)
        assert not wrong or history.status[-1] != Status.USED


@every
def test_rest_teaches_nothing(build: Builder):
    """Assert that a minute of standing still with noise, after a good motion, moves no estimate."""
    system = oscillator()
    estimator = build(system, "linear")
    moving = oscillator_motion(20.0, noise=1e-4)
    samples = estimator.pack(with_rest(moving, 60.0, 1e-4))
    history = estimator.replay(estimator.init(TRUE), samples)
    before = as_values(system, history.coefficients[len(moving) - 1])
    assert as_values(system, history.coefficients[-1]) == pytest.approx(before, rel=0.05)


@every
def test_constant_input_from_the_start(build: Builder):
    """Assert that a motion that excites nothing leaves the estimates near their start."""
    system = oscillator()
    estimator = build(system, "linear")
    samples = estimator.pack(with_rest(oscillator_motion(0.002), 60.0, 0.0))
    history = estimator.replay(estimator.init(TRUE), samples[1:])
    assert as_values(system, history.coefficients[-1]) == pytest.approx(TRUE, rel=0.05)


@every
def test_an_initial_estimate_of_nothing(build: Builder):
    """Assert that a start for no coefficient, or one that is no number, is refused."""
    estimator = build(oscillator(), "linear")
    with pytest.raises(SettingError, match="theta9"):
        estimator.init({"theta9": 1.0})
    with pytest.raises(SettingError, match="nan"):
        estimator.init({"gain": float("nan")})
