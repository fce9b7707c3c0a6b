"""Requirements of every estimator, in batch and sample by sample."""

from dataclasses import replace

import numpy as np
import pytest
from oscillator import (
    ALL,
    BATCH,
    ONLINE,
    TRUE,
    Batch,
    BatchFit,
    Builder,
    Estimator,
    at_rest,
    oscillation,
    oscillator,
)

from flexid.estimators.online import Status
from flexid.estimators.unknowns import Unknowns
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.parametric_observer import ParametricObserver
from flexid.recording.recording import Hold

every = pytest.mark.parametrize("estimate", ALL.values(), ids=ALL.keys())
every_batch = pytest.mark.parametrize("batch", BATCH.values(), ids=BATCH.keys())
every_online = pytest.mark.parametrize("build", ONLINE.values(), ids=ONLINE.keys())

MODEL = oscillator()


@every
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_clean_data_give_the_truth(estimate: Estimator, hold: Hold):
    """Assert that informative data give the true values."""
    found = estimate(oscillation(80.0, hold), MODEL, hold)
    assert found == pytest.approx(TRUE, rel=2e-4)


@pytest.mark.thorough
@every
def test_same_bits_in_any_order_of_coefficients(estimate: Estimator):
    """Assert that estimators are deterministic, keep their data, and ignore the order of names."""
    samples = oscillation(20.0)
    before = [samples.positions.copy(), samples.inputs.copy()]
    values = estimate(samples, MODEL, "linear")
    assert estimate(samples, MODEL, "linear") == values
    assert np.array_equal(samples.positions, before[0])
    assert np.array_equal(samples.inputs, before[1])
    turned = estimate(samples, oscillator(("gain", "spring", "friction")), "linear")
    assert turned == pytest.approx(values, rel=1e-9)


@every_online
def test_replay_is_the_step(build: Builder):
    """Assert that replay equals stepping, bit for bit, also over bad samples and in two parts."""
    estimator = build(MODEL, "linear")
    samples = estimator.pack(oscillation(3.0, noise=1e-4))
    samples[700] = np.nan
    kept = samples.copy()
    start = state = estimator.init({"spring": 1.0})
    history = estimator.replay(state, samples)
    for place, sample in enumerate(samples):
        before = state.copy()
        after, info = estimator.step(state, sample)
        assert np.array_equal(state, before)
        state = after
        assert np.array_equal(estimator.coefficients(state), history.coefficients[place])
        assert np.array_equal(info[:-1], history.innovations[place], equal_nan=True)
        assert info[-1] == history.status[place]
    first = estimator.replay(start, samples[:777])
    second = estimator.replay(first.state, samples[777:])
    assert np.array_equal(second.state, history.state)
    assert np.array_equal(second.coefficients, history.coefficients[777:])
    assert np.array_equal(state, history.state)
    assert np.array_equal(samples, kept, equal_nan=True)


@every_online
@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("place", [0, -1], ids=["position", "input"])
def test_a_bad_sample_is_rejected(build: Builder, bad: float, place: int):
    """Assert that a sample with NaN or infinity is rejected, flagged, and changes no estimate."""
    estimator = build(MODEL, "linear")
    samples = estimator.pack(oscillation(80.0))
    samples[[1000, 9000, 9001], place] = bad
    history = estimator.replay(estimator.init(), samples)
    assert np.flatnonzero(history.status == Status.REJECTED).tolist() == [1000, 9000, 9001]
    for n in (1000, 9000, 9001):
        assert np.array_equal(history.coefficients[n], history.coefficients[n - 1])
        assert np.isnan(history.innovations[n]).all()
    assert history.coefficients[-1] == pytest.approx([*TRUE.values()], rel=5e-4)
    knows = not isinstance(estimator, ParametricObserver)  # whether it judges what is determined
    assert history.status[-1] == (Status.USED if knows else Status.STARTING)


@every_online
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_rest_teaches_nothing(build: Builder, noise: float):
    """Assert that a minute of rest changes no estimate, from the start or after a motion."""
    estimator = build(MODEL, "linear")
    history = estimator.replay(estimator.init(TRUE), estimator.pack(at_rest(60.0)))
    assert history.coefficients[-1] == pytest.approx([*TRUE.values()], rel=0.05)
    moved = estimator.replay(estimator.init(TRUE), estimator.pack(oscillation(20.0, noise=noise)))
    rest = estimator.pack(at_rest(60.0, noise))
    missing, _ = estimator.step(moved.state, np.full(rest.shape[1], np.nan))
    after = estimator.replay(missing, rest)
    assert after.coefficients[-1] == pytest.approx(moved.coefficients[-1], rel=0.05)


RUNS = [
    replace(oscillation(duration, noise=1e-4, seed=seed), velocities=None)
    for seed, duration in ((1, 30.0), (2, 20.0))
]
PER_RUN = Unknowns(MODEL, {}, ("spring",), (0, 1))


def covers(fit: BatchFit) -> bool:
    """Return whether all values are within five standard errors, or 0.01 % of quadrature error."""
    truth = np.array([TRUE[name] for name in fit.names])
    allowed = 5.0 * np.sqrt(np.diag(fit.covariance)) + 1e-4 * truth
    return bool(np.all(np.abs(fit.values - truth) < allowed))


@every_batch
def test_right_from_positions_alone(batch: Batch):
    """Assert that two runs give the truth within standard errors, also with a fixed gain."""
    free = batch(RUNS, Unknowns(MODEL))
    assert free.names == MODEL.coefficients
    assert free.values == pytest.approx([*TRUE.values()], rel=1e-3)
    assert covers(free)
    fixed = batch(RUNS, Unknowns(MODEL, {"gain": 2.0}))
    assert covers(fixed)
    known_gain = np.diag(np.linalg.inv(fixed.information))
    assert np.all(known_gain < np.diag(np.linalg.inv(free.information))[:2])
    # A fixed value is taken as exact: the spring follows a wrong gain.
    assert batch(RUNS, Unknowns(MODEL, {"gain": 2.2})).values[0] > 4.1


@every_batch
def test_recordings_in_any_order(batch: Batch):
    """Assert that the order of recordings does not matter, and three samples change nothing."""
    ordered = batch(RUNS, PER_RUN)
    turned = batch(RUNS[::-1], replace(PER_RUN, groups=(1, 0)))
    assert turned.values == pytest.approx(ordered.values, rel=1e-6)
    assert turned.covariance == pytest.approx(ordered.covariance, rel=1e-3)
    crumb = replace(RUNS[0], positions=RUNS[0].positions[:3], inputs=RUNS[0].inputs[:3])
    with_crumb = batch([RUNS[0], crumb, RUNS[1]], replace(PER_RUN, groups=(0, 0, 1)))
    assert np.array_equal(with_crumb.values, ordered.values)


@every_batch
def test_equal_columns_are_undetermined(batch: Batch):
    """Assert that two equal regressors have infinite variances, and that their sum is right."""
    regressors = {"spring": "-q", "friction": "-v", "a": "u", "b": "u"}
    twins = ParametricSystem("twins", (Row("mass", "q", "v", regressors),))
    fit = batch(RUNS, Unknowns(twins))
    assert np.isinf(np.diag(fit.covariance)).tolist() == [False, False, True, True]
    assert fit.values[2] + fit.values[3] == pytest.approx(TRUE["gain"], rel=1e-3)
    assert fit.values[:2] == pytest.approx([4.0, 0.5], rel=1e-3)
