"""Least squares of a stream is that of the same record in memory."""

import numpy as np
import pytest
from noisy_joint import joint_samples

from flexid.estimators.block_sandwich import block_size
from flexid.estimators.rowwise import RowSums
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.streamed_least_squares import (
    Products,
    StreamedFit,
    StreamedProblem,
    StreamedSums,
)
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import flexible_joint

JOINT = flexible_joint()
UNKNOWNS = Unknowns(JOINT)
RATE = 20.0


def problem(samples: Samples, reference: float = 0.0) -> StreamedProblem:
    """Least squares of all coefficients, from values that are so much of the right ones."""
    equations = len(samples) - 2
    size = block_size(equations * samples.sample_time, samples.sample_time, RATE, 3)
    right = np.array([5.0, 100.0, 333.0, 0.33, 3.33])
    return StreamedProblem(UNKNOWNS, reference * right, RATE, "linear", size)


def stretches(samples: Samples, of: StreamedProblem, blocks: int) -> list[Products]:
    """Products of the record, so many blocks at a time."""
    equations = len(samples) - 2
    found = []
    for first in range(0, equations, blocks * of.block):
        stop = first + blocks * of.block
        if equations - stop < of.block // 2:
            stop = equations
        begin = max(0, first - of.warm_up(samples.sample_time))
        part = Samples(
            samples.positions[begin : stop + 2],
            None,
            samples.inputs[begin : stop + 2],
            samples.sample_time,
        )
        found.append(of.products(part, first - begin, stop - first, first == 0))
        if stop == equations:
            break
    return found


def streamed(
    recordings: list[Samples], of: StreamedProblem, blocks: int, most: int = 32_768
) -> StreamedFit:
    """Fit of recordings, stretch by stretch."""
    sums = StreamedSums(of, most)
    for recording in recordings:
        for products in stretches(recording, of, blocks):
            sums.add(products)
    return sums.fit()


def rounding(row: RowSums, values: np.ndarray, reference: np.ndarray, terms: int) -> float:
    """Return how far rounding may move a row's sum of squared residuals, in sums of so many terms.

    It is the quadratic form of the products in (p - p₀, 1), whose terms may cancel. Each product
    is right to `terms` units of rounding of the lengths of its two factors.
    """
    lengths = np.sqrt(np.diag(row.gram))
    residual = np.sqrt(row.residual_sum)
    left = residual + 2.0 * np.abs(values - reference) @ lengths  # by the reference, of y
    whole = residual + 2.0 * (np.abs(values) + np.abs(reference)) @ lengths
    unit = np.finfo(float).eps
    return float(unit * (terms * left**2 + 2.0 * len(values) * residual * whole))


def assert_same(found: StreamedFit, expected: LeastSquaresFit, of: StreamedProblem) -> None:
    """Assert equal values, covariance, degrees of freedom and sums of squares."""
    assert found.names == expected.names
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-10)
    size = np.outer(expected.standard_deviations, expected.standard_deviations)
    np.testing.assert_allclose(
        found.covariance / size, expected.covariance / size, rtol=0.0, atol=2e-8
    )
    np.testing.assert_allclose(found.degrees_of_freedom, expected.degrees_of_freedom, rtol=1e-9)
    values = dict(zip(found.names, found.values, strict=True))
    references = dict(zip(UNKNOWNS.names, of.reference, strict=True))
    for mine, other in zip(found.rows, expected.rows, strict=True):
        assert mine.count == other.count
        parts = [np.array([of[name] for name in mine.coefficients]) for of in (values, references)]
        allowed = rounding(other, *parts, terms=2 * of.block + mine.count // of.block)
        assert mine.residual_sum == pytest.approx(other.residual_sum, rel=0.0, abs=allowed)
        assert mine.total_sum == pytest.approx(other.total_sum, rel=1e-9)


@pytest.mark.parametrize("blocks", [2, 5, 100])
def test_stretches_are_the_whole_record(blocks: int):
    """Assert that a fit in one pass over stretches is the fit in memory."""
    record = joint_samples(0)
    of = problem(record, 0.99)
    assert_same(streamed([record], of, blocks), filtered_least_squares([record], JOINT), of)


def test_recordings_are_apart():
    """Assert that several recordings give what they give in memory."""
    record = joint_samples(1)
    recordings = [
        Samples(record.positions[a:b], None, record.inputs[a:b], record.sample_time, 1e-3 * a)
        for a, b in ((0, 9_700), (9_900, 25_123), (25_200, 30_001))
    ]
    of = problem(record)
    assert_same(streamed(recordings, of, 3), filtered_least_squares(recordings, JOINT), of)


def test_the_reference_does_not_matter():
    """Assert that values ten times too large as a reference change nothing but rounding."""
    record = joint_samples(2)
    near, far = (streamed([record], problem(record, factor), 4) for factor in (1.0, 10.0))
    np.testing.assert_allclose(near.values, far.values, rtol=1e-9)
    np.testing.assert_allclose(near.covariance, far.covariance, rtol=2e-6)


def test_fixing_afterwards_is_fixing_before():
    """Assert that a coefficient fixed after the pass is as if it had been fixed before."""
    record = joint_samples(3)
    of = problem(record, 0.9)
    sums = StreamedSums(of)
    for products in stretches(record, of, 6):
        sums.add(products)
    fixed = UNKNOWNS.fixing({"theta1": 4.9})
    assert_same(sums.fit(fixed), filtered_least_squares([record], JOINT, unknowns=fixed), of)


def test_joined_blocks_keep_the_values():
    """Assert that joining blocks changes no value, and the intervals by little."""
    record = joint_samples(4)
    of = problem(record, 1.0)
    whole, joined = (streamed([record], of, 7, most) for most in (64, 16))
    np.testing.assert_allclose(joined.values, whole.values, rtol=1e-12)
    np.testing.assert_allclose(joined.standard_deviations, whole.standard_deviations, rtol=0.5)
    assert np.all(np.array(joined.degrees_of_freedom) < np.array(whole.degrees_of_freedom))


def test_blocks_left_out_are_as_if_never_seen():
    """Assert that leaving a stretch out gives the values of the other stretches alone."""
    record = joint_samples(5)
    of = problem(record, 1.0)
    parts = stretches(record, of, 10)
    all_of_them, others = StreamedSums(of), StreamedSums(of)
    for place, products in enumerate(parts):
        all_of_them.add(products)
        if place != 1:
            others.add(products)
    np.testing.assert_allclose(
        all_of_them.fit(without=[parts[1]]).values, others.fit().values, rtol=1e-9
    )
