"""Doubts: possible errors of the rig and removed terms, and how far each shifts a value."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_joint import made_fit
from scipy.integrate import quad
from scipy.stats import norm

from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.estimation import doubts
from flexid.identification.estimation.answers import between_lengths
from flexid.identification.estimation.final_fits import hidden_covariance
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS

VALUES = {"theta1": 5.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 20.0, "beta1": 3.0}
DELAY = 5e-4  # s
NAMES = (*VALUES, INPUT)
LINK, MOTOR = ("theta1", "theta2"), ("alpha1", "alpha2", "beta1")
SPRINGS = ("theta2", "alpha1")
ROOT = float(np.sqrt(3.0))


def doubted(
    delay: float = DELAY,
    apart: float = 0.0,
    step: float = 1e-4,
    *,
    is_voltage: bool = False,
    **more: Any,
) -> doubts.Doubted:
    """Return a fit with a delayed input; 10 % (link) and 20 % (motor) are unexplained."""
    values = np.array([*VALUES.values(), delay])
    fitted = SimpleNamespace(
        names=NAMES,
        values=values,
        data=SimpleNamespace(scales_apart=apart, recordings=(SimpleNamespace(sample_time=step),)),
        structure=SimpleNamespace(
            timing=Timing("zero", sought=(INPUT,)),
            joint=SimpleNamespace(nonlinear={"alpha_stribeck": "stribeck_velocity"}),
        ),
        by_name=dict(zip(NAMES, values.tolist(), strict=True)),
    )
    sizes = {name: 0.5 / value for name, value in VALUES.items()}
    return doubts.Doubted(cast(Any, fitted), sizes, {"link": 0.1, "motor": 0.2}, is_voltage, **more)


def shares(directions: np.ndarray, found: doubts.Doubted) -> dict[str, float]:
    """Return the relative shift of each value by one doubt; values without a shift are omitted."""
    assert len(directions) == len(NAMES)
    moved = np.sqrt(np.sum(directions**2, axis=1)) / np.abs(found.fitted.values)
    return {name: share for name, share in zip(NAMES, moved.tolist(), strict=True) if share}


NOISE = np.array([0.0, 0.0, -30.0, 0.0, -0.3, 0.0])
EARLY = {"is_voltage": True, "delay": -DELAY}
SIDES = {**dict.fromkeys(LINK, 0.1), **dict.fromkeys(MOTOR, 0.2)}
CASES: list[tuple[Any, dict[str, Any], dict[str, float]]] = [
    (doubts.calibration, {}, dict.fromkeys(NAMES, 0.002)),
    (doubts.further_modes, {}, dict.fromkeys(LINK, 0.003)),
    # Different scales of the encoders act like gravity.
    (doubts.scales_apart, {"apart": 0.02}, {**dict.fromkeys(NAMES, 0.02), "theta1": 0.02 * 21.0}),
    (doubts.scales_apart, {}, {}),
    # A torque has neither coil nor amplifier. A coil's lag is at least half a sample, at most 2 ms.
    (doubts.coil_lag, {}, {}),
    (doubts.coil_lag, EARLY, dict.fromkeys(MOTOR, 20.0 * 5e-5 / ROOT)),
    (doubts.coil_lag, {**EARLY, "step": 2e-3}, dict.fromkeys(MOTOR, 20.0 * 1e-3 / ROOT)),
    (doubts.coil_lag, {**EARLY, "step": 5e-3}, dict.fromkeys(MOTOR, 20.0 * 2e-3 / ROOT)),
    (doubts.dead_zone, {}, {}),
    # Uniform between zero and the full effect of play on a spring.
    (doubts.play, {"by_play": 0.3}, dict.fromkeys(SPRINGS, 0.3 / ROOT)),
    (doubts.play, {}, {}),
    (doubts.another_law, {}, {}),
    (doubts.gear_efficiency, {}, {}),
    # The doubt is larger for a term with a smaller part in its balance, and largest for friction.
    (
        doubts.looks_like_a_term,
        {},
        {n: (0.7 if n == "alpha2" else 0.4 * s) * s / 0.5 for n, s in SIDES.items()},
    ),
    # Each balance may be heavier by the square of its share, if all of it acts as inertia.
    (doubts.looks_like_the_acceleration, {}, {name: share**2 for name, share in SIDES.items()}),
]


@pytest.mark.parametrize(("doubt", "about", "expected"), CASES)
def test_what_each_doubt_moves(doubt: Any, about: dict[str, Any], expected: dict[str, float]):
    """Assert the relative shift of each value by a doubt, and no shift of other values."""
    found = doubted(**about)
    assert shares(doubt(found), found) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("doubt", "computed", "error", "share"),
    [
        (doubts.lag, "lagged", NOISE, 0.1),
        (doubts.dead_zone, "behind_a_dead_zone", NOISE, 0.1),
        (doubts.term_law, "by_other_laws", NOISE[:, None], 0.1 / 3.0**0.5),
    ],
)
def test_errors_that_are_computed(
    monkeypatch: pytest.MonkeyPatch, doubt: Any, computed: str, error: np.ndarray, share: float
):
    """Assert which part of an error by another motion counts."""
    monkeypatch.setattr(doubts, computed, lambda _: error)
    found = doubted(is_voltage=True)
    assert shares(doubt(found), found) == pytest.approx({"alpha1": share, "beta1": share})


def test_values_of_one_balance_move_together():
    """Assert that a heavier balance, or a stiffer spring, is a single direction."""
    one, two = doubts.further_modes(doubted()), doubts.looks_like_the_acceleration(doubted())
    assert (one.shape[1], two.shape[1], doubts.play(doubted(by_play=0.3)).shape[1]) == (1, 2, 1)
    assert ((two != 0.0).sum(axis=1) <= 1).all()


NOTHING: Mapping[str, float] = {}


def among(doubt: Any, fixed: Mapping[str, float] = NOTHING, /, **values: float) -> np.ndarray:
    """Return the directions of a doubt about a fit of these values, besides fixed ones."""
    found = doubted(apart=0.02)
    own = {"names": (*values,), "values": np.array([*values.values()]), "by_name": values}
    own["all_values"] = {**fixed, **values}
    fitted: Any = SimpleNamespace(**{**vars(found.fitted), **own})
    return doubt(replace(found, fitted=fitted))


def test_what_depends_on_the_terms():
    """Assert directions of doubts for fits with other terms.

    A heavier balance changes no velocity. The motor's springs may be stiffer by half the squared
    friction of the load. A spring to the base explains different scales of encoders, unless there
    is no motor's balance. As it is open which encoder is right, an error of scales is one of the
    motor's balance, but for viscous friction, of its spring, or of its input. Torque and reach of a
    hysteresis may both be larger by 15 %; what it leaves of the link's acceleration, 10 %, may be
    the spring's.
    """
    moved = among(doubts.looks_like_the_acceleration, **VALUES, stribeck_velocity=1.0)
    assert moved.any(axis=1).tolist() == [True] * len(VALUES) + [False]
    gear = {"theta2": 100.0, "alpha1": 300.0, "alpha_load": 60.0, "alpha_damping": 2.0}
    moved = among(doubts.gear_efficiency, **gear)
    assert moved[:, 0] == pytest.approx([0.0, 0.02 * 300.0, 0.0, 0.02 * 2.0])
    assert not among(doubts.scales_apart, **VALUES, theta_parallel=3.0).size
    assert among(doubts.scales_apart, theta2=100.0, theta_parallel=3.0).size
    scaled = {"theta2": 100.0, "alpha1": 300.0, "alpha2": 2.0, "alpha_scale": 0.9}
    scaled |= {"alpha_drag": 4.0, "beta1": 3.0}
    moved = ROOT / 0.003 * among(doubts.scales_apart, **scaled)
    assert moved[:, 0] == pytest.approx([0.0, 300.0, 0.0, 0.9, -4.0, 3.0])
    assert moved[:, 1] == pytest.approx([0.0, 300.0, 0.0, 0.9, 0.0, 0.0])
    assert moved[:, 2] == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    known = among(doubts.scales_apart, {"alpha1": 300.0}, alpha_scale=0.9, beta1=3.0)
    assert ROOT / 0.003 * known == pytest.approx(np.array([[0.9, 0.9, 0.0], [3.0, 0.0, 3.0]]))
    moved = among(doubts.another_law, alpha1=300.0, alpha_hysteresis=2.0, hysteresis_grip=50.0)
    spring = 0.1 / np.sqrt(3.0) * 300.0
    assert moved == pytest.approx(np.array([[0.0, spring], [0.3, 0.0], [-7.5, 0.0]]))


@pytest.mark.parametrize("part", [0.3, 1.0])
def test_a_lag_in_place_of_a_delay(part: float):
    """Assert that the allowance covers the error of inertia if a delay replaces a coil's lag.

    With lag T, back-EMF e and friction f, u -> v is 1 / ((1 + T s)(s + f) + e); the model has 1 /
    ((a s + b) exp(T s)). Equal to first order in s where a / b = (1 - T e) / (f + e).
    """
    viscous = VALUES["alpha2"]
    emf, friction = part * viscous, (1.0 - part) * viscous
    true = np.polynomial.Polynomial([1.0, DELAY]) * np.polynomial.Polynomial([friction, 1.0]) + emf
    delayed = true * np.polynomial.Polynomial([1.0, -DELAY])  # exp(-T s), to first order
    inertia = delayed.coef[1] / delayed.coef[0] * viscous
    apart = shares(doubts.coil_lag(doubted(is_voltage=True)), doubted(is_voltage=True))
    assert 1.0 - inertia == pytest.approx(part * DELAY * viscous, rel=1e-9)
    assert apart.keys() == {*MOTOR}
    assert 1.0 - inertia <= 1.96 * apart["alpha1"] < 1.2 * DELAY * viscous


def fit_over(duration: float, values: list[float], excess: float, kind: str = "rigid") -> Any:
    """Return a stand-in for a fit of two values with standard deviations of 0.03."""
    structure = SimpleNamespace(joint=SimpleNamespace(kind=kind))
    two = {"values": np.array(values), "unit_deviations": np.full(2, 0.03)}
    return made_fit(excess, duration=duration, structure=structure, names=("a", "b"), **two)


@pytest.mark.parametrize(
    ("kind", "short", "excess", "moved"),
    [
        ("rigid", 1.02, 1.5, True),
        ("rigid", 1.02, 1.05, False),
        ("rigid", 1.3, 1.5, True),
        ("flexible", 1.02, 1.5, False),
    ],
)
def test_a_rigid_joint_that_long_segments_contradict(
    kind: str, short: float, excess: float, moved: bool
):
    """Assert that only a rigid joint's values are widened by their change with segment length."""
    own = fit_over(0.2, [1.0, 2.0], short, kind)
    longer = [fit_over(0.4, [1.0, 2.4], 1.02), fit_over(0.8, [0.7, 2.0], excess)]
    fits = cast(Any, SimpleNamespace(reported=own, lengths_fitted=[own, *longer]))
    found = np.sqrt(np.diag(doubts.covariance_of(between_lengths(fits, THRESHOLDS))))
    expected = np.array([0.3, 0.4]) / np.sqrt(2.0) if moved else np.zeros(2)
    np.testing.assert_allclose(found, expected, rtol=5e-3)


@pytest.mark.parametrize(("variances", "share"), [((4.0, 4.0), 0.25), ((1.0, 9.0), 0.09)])
def test_halves_count_by_what_they_know(variances, share):
    """Assert the variance that disagreeing halves add to their weighted mean, w1 w2 (d² - v1 - v2).

    A half with infinite variance adds none. The whole log may be farther from the better half than
    its mean: then that distance counts.
    """
    first, second = variances
    for difference in (20.0, 2.0):
        pair = [
            doubts.Repeat(np.array([value, value]), np.array([variance, np.inf]))
            for value, variance in zip((5.0, 5.0 + difference), variances, strict=True)
        ]
        beyond = max(difference**2 - sum(variances), 0.0)
        mean = 5.0 + difference * first / (first + second)
        for whole, expected in ((mean, share), (5.0 + 0.8 * difference, 0.64)):
            errors = doubts.between_halves(np.array([whole, 5.0]), *pair)
            found = np.diag(doubts.covariance_of(errors))
            assert found == pytest.approx([expected * beyond, 0.0])


def test_logs_count_by_what_they_know():
    """Assert the variance between logs: squared deviations beyond chance, times each log's share.

    A log that knows little hardly counts, unless it differs clearly. Equal values add nothing, nor
    do those that no log shows.
    """
    values = np.array([[4.0, 4.9, 4.9, 7.0, 3.0], [6.0, 9.0, 15.0, 7.0, 3.0]])
    variances = np.array([[0.1, 0.1, 0.1, 0.1, np.inf], [0.1, 10.0, 10.0, 0.1, np.inf]])
    logs = [doubts.Repeat(*each) for each in zip(values, variances, strict=True)]
    found = doubts.between_logs(np.array([5.0, 5.0, 5.0, 7.0, 3.0]), logs)
    expected = [0.9, (16.0 - 10.0) / 101.0, (100.0 - 10.0) / 2.0, 0.0, 0.0]
    assert np.diag(doubts.covariance_of(found)) == pytest.approx(expected)


def test_covariances_add():
    """Assert that the covariances of all doubts add up, and that the widest doubt is named."""
    found = doubted(is_voltage=True)
    known = Estimate(NAMES, found.fitted.values, np.zeros((6, 6)), (10.0,) * 6)
    simple = doubts.DOUBTS.keys() - {doubts.lag, doubts.dead_zone, doubts.term_law}
    every = [(doubts.covariance_of(doubt(found)), doubts.DOUBTS[doubt]) for doubt in simple]
    estimate, widest = doubts.widened(known, every)
    np.testing.assert_allclose(estimate.covariance, sum(part for part, _ in every))
    assert widest["beta1"] == doubts.DOUBTS[doubts.looks_like_the_acceleration]
    assert widest[INPUT] == ""


def quadratic(names, information, values, robust=1.0) -> Any:
    """Return a stand-in for a fit; `robust` is the ratio of robust to white-noise deviations."""
    unit = np.sqrt(np.diag(np.linalg.pinv(information)))
    return SimpleNamespace(
        names=tuple(names),
        information=np.asarray(information, dtype=np.float64),
        values=np.asarray(values, dtype=np.float64),
        scatter=np.full(len(unit), robust),
        minimum=SimpleNamespace(reduced=SimpleNamespace(values_step=np.zeros(len(names)))),
    )


def hidden(reported, full, scale, certain=(), **one_way: dict[str, float]) -> np.ndarray:
    """Return the covariance due to a removed term of some scale; `one_way` are frictions."""
    scales = {full.names[-1]: scale}
    fits = {"reported": reported, "full": full, "scales": scales, "one_way": one_way}
    return hidden_covariance(cast(Any, SimpleNamespace(**fits)), certain)


def test_a_friction_one_way_may_be_as_large_as_its_scale():
    """Assert that a one-way friction adds half its squared scale to what it acts like."""
    reported = quadratic(("kept", "other"), np.eye(2), np.zeros(2))
    full = quadratic(("kept", "other", "gone"), np.diag([1.0, 1.0, 1e6]), np.zeros(3))
    assert hidden(reported, full, 3.0) == pytest.approx(np.zeros((2, 2)), abs=1e-5)
    found = hidden(reported, full, 3.0, gone={"other": 0.5})
    assert found == pytest.approx(np.diag([0.0, 0.5 * (3.0 * 0.5) ** 2]))


def added(information, values, scale, robust=1.0, certain=(), gone="gone") -> float:
    """Return the variance that a removed second coefficient adds to the first."""
    reported = quadratic(("kept",), information[:1, :1], values[:1])
    full = quadratic(("kept", gone), information, values, robust)
    covariance = hidden(reported, full, scale, certain)
    return float(covariance[0, 0])


TWO = np.array([[1.0, 0.6], [0.6, 1.0]])


def posterior(value: float, scale: float, odds: float) -> float:
    """Return the mean square of a value by quadrature; `odds` are those of its absence."""
    deviation = 1.0 / np.sqrt(1.0 - 0.36)

    def there(b):
        return norm.pdf(value, b, deviation) * norm.pdf(b, 0.0, scale)

    reach = 12.0 * scale
    evidence = quad(there, -reach, reach, points=[0.0, value], limit=400)[0]
    square = quad(lambda b: b * b * there(b), -reach, reach, points=[0.0, value], limit=400)[0]
    return square / (evidence + odds * norm.pdf(value, 0.0, deviation))


@pytest.mark.parametrize("certain", [(), ("gone",)])
@pytest.mark.parametrize(("value", "scale"), [(0.0, 3.0), (0.4, 3.0), (1.1, 0.5), (2.5, 20.0)])
def test_it_is_the_mean_square_of_the_posterior(value, scale, certain):
    """Assert that the added variance is 0.6² E[b²] of a term that is, or may be, present."""
    found = added(TWO, np.array([0.0, value]), scale, certain=certain)
    assert found == pytest.approx(0.36 * posterior(value, scale, len(certain) == 0), rel=1e-6)


@pytest.mark.parametrize(("scale", "usual"), [(60.0, True), (3.0, False)])
def test_most_drives_have_friction(scale, usual):
    """Assert that a friction has the larger mean square, here of 5 % of the acceleration."""
    found = added(TWO, np.array([0.0, 0.4]), scale, gone="theta_viscous")
    others = posterior(0.4, scale, 1.0), posterior(0.4, 0.05 * scale, 1.0 / 9.0)
    assert found == pytest.approx(0.36 * others[usual], rel=1e-6)
    assert others[usual] > others[not usual]


def test_correlated_residuals_count():
    """Assert that a term with twice the score deviation has twice the uncertainty."""
    wide = added(TWO, np.zeros(2), 3.0, robust=2.0)
    narrow = added(TWO / 4.0, np.zeros(2), 3.0)
    assert wide == pytest.approx(narrow, rel=1e-9)


def test_what_is_left_of_the_information_is_not_lost_in_rounding():
    """Assert the added covariance if only 4e-6 of a third column is independent of the others."""
    rng = np.random.default_rng(3)
    base = rng.standard_normal((1000, 3))
    columns = np.column_stack(
        [base[:, 0], base[:, 0] + 1e-3 * base[:, 1], base @ [1.0, 1e-3, 4e-6]]
    )
    information = columns.T @ columns
    reported = quadratic(("a", "b"), information[:2, :2], np.zeros(2))
    full = quadratic(("a", "b", "gone"), information, np.zeros(3))
    scale = 1e-3
    covariance = hidden(reported, full, scale)
    orthogonal, _ = np.linalg.qr(columns[:, :2])
    rest = columns[:, 2] - orthogonal @ (orthogonal.T @ columns[:, 2])
    assert 1.0 / np.linalg.norm(rest) > scale  # invisible in the log
    shift = np.linalg.lstsq(columns[:, :2], columns[:, 2])[0]
    most = scale**2 * np.outer(shift, shift)
    ratio = np.diag(covariance) / np.diag(most)
    assert (ratio > 0.3).all()
    assert (ratio < 0.6).all()
