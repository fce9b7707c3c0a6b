"""Shapes with unknown constants: ripple, bent springs, Stribeck friction."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_joint import WITHOUT, by_length_of, fitted, log, made, made_fit, over, turned
from simulated_cases import BENT, BRISTLES, DRY, HYSTERESIS, RIPPLED, SLID, STICTION, Case, asked

import flexid.identification.structure.shapes as shapes
import flexid.identification.structure.sought_terms as sought_terms
from flexid.errors import ConvergenceError, SettingError
from flexid.identification.estimation.model_error import widened
from flexid.identification.full_model.fits_by_length import FitsByLength, leaves_more
from flexid.identification.full_model.model import Fitted
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.structure.shapes import fit_with_shape
from flexid.identification.structure.sought_terms import (
    BEND,
    PRESLIDING,
    RIPPLE,
    STRIBECK,
    TRANSMISSION,
)
from flexid.identification.vocabulary.evidence import ModelError
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import HARDENING

NUMBER, PHASE = RIPPLED["ripple_number"], RIPPLED["ripple_phase"]
UNEVEN: dict[str, Any] = {"transmission_number": NUMBER, "second_transmission_error": 3e-4}
STICKING: dict[str, Any] = {**DRY, **STICTION}
NO_ERROR = ModelError(0.0, 0.0, 0.0)
ENOUGH, TOO_LITTLE = THRESHOLDS.shape_promise + 0.001, THRESHOLDS.shape_promise - 0.001


@pytest.fixture(scope="module")
def plain() -> Fitted:
    """Return a fit to four seconds of the paper's joint."""
    return fitted(made(4, 4.0))


@pytest.mark.parametrize(
    ("terms", "shape", "made_with", "truth", "accuracy", "aways"),
    [
        (("torque_ripple",), RIPPLE, RIPPLED, NUMBER, 5e-4, (0.995, 1.005)),
        (("bent_spring",), BEND, BENT, 0.3, 5e-4, (0.995, 1.005)),
        (("transmission_error",), TRANSMISSION, UNEVEN, NUMBER, 5e-4, (0.998, 1.002)),
        (("motor_coulomb", "motor_stribeck"), STRIBECK, STICKING, 0.15, 0.01, (0.6, 1.6)),
    ],
)
def test_a_constant_goes_where_the_sum_of_squares_is_least(
    terms, shape, made_with, truth, accuracy, aways
):
    """Assert that the constant converges from either side, within its standard error."""
    recording = made(3, **made_with)
    exact = fitted(recording, *terms, fixed={shape.constant: truth})
    assert shape.constant not in exact.names
    for away in aways:
        found = fitted(recording, *terms, widths={shape.constant: away * truth})
        assert found.minimum.equations.cost < exact.minimum.equations.cost
        assert shape.of(found.structure) == pytest.approx(truth, rel=accuracy)
        value, deviation, _ = sought_terms.sought_constants(found.fit, found.structure)[
            shape.constant
        ]
        assert value == shape.of(found.structure)
        assert abs(value - truth) < 4.0 * deviation < 0.2 * truth


def test_a_peak_may_be_the_second_harmonic_of_a_transmission():
    """Assert that half the number of a peak is a candidate too."""
    plain = fitted(made(3, 12.0, transmission_number=10.0, second_transmission_error=3e-4))
    found = TRANSMISSION.candidates(plain.structure, plain.data)
    resolution = TRANSMISSION.resolution(plain.structure.joint, plain.data)
    for number in (10.0, 20.0):
        assert min(abs(other - number) for other in found) < 0.5 * resolution


@pytest.mark.parametrize("velocity", [0.04, 0.11, 0.9])
def test_candidates_for_a_velocity_lie_close(plain, velocity, monkeypatch):
    """Assert that candidates around the best one are refined, with geometric spacing."""
    asked = []

    def promised(_, structure):
        asked.append(STRIBECK.of(structure))
        return -abs(np.log(asked[-1] / velocity))

    monkeypatch.setattr(shapes, "_promised", promised)
    (_, best), *_ = shapes._promising(STRIBECK, plain, plain.structure)
    assert STRIBECK.of(best) == pytest.approx(velocity, rel=0.15)
    assert len(asked) == len(STRIBECK.candidates(plain.structure, plain.data)) + 2 * 5


def test_no_velocity_is_sought_that_friction_takes_in_a_sample(monkeypatch):
    """Assert that candidates and fits stay above the velocity that friction removes in a sample."""
    terms, width = ("motor_coulomb", "motor_stribeck"), {"stribeck_velocity": 0.24}
    first = fitted(made(3, **STICKING), *terms, widths=width)
    taken = abs(first.by_name["alpha_coulomb"]) * first.data.samples[0].sample_time
    assert STRIBECK.least(first) == pytest.approx(taken)
    asked = []
    monkeypatch.setattr(shapes, "_promised", lambda _, own: asked.append(own) or len(asked))
    monkeypatch.setattr(shapes, "sampled", lambda fit: fit)
    monkeypatch.setattr(shapes, "explained_by", lambda *a: first if a[-1](first) else None)
    monkeypatch.setattr(FitsByLength, "onward", lambda _, first: [first])
    monkeypatch.setattr(FitsByLength, "with_term", lambda *_: by_length)
    by_length = by_length_of(first, divisions=(first.problem.segments,))
    for least, follows in ((0.23, False), (0.14, True)):  # the fit has 0.15
        asked.clear()
        shape = replace(STRIBECK, least=lambda _, own=least: own)
        found = fit_with_shape(shape, by_length, first, [])
        assert (found is not None) == follows
        assert min(STRIBECK.of(own) for own in asked) > least
    assert min(STRIBECK.candidates(first.structure, first.data)) < 0.14


@pytest.mark.parametrize(
    ("theta", "alpha", "slack"),
    [
        (0.5, 0.5, True),
        (2.0, 0.5, False),
        (0.5, 2.0, False),
        (-3.0, -3.0, True),
        (20.0, 20.0, False),
    ],
)
def test_a_bend_without_stiffness_below_is_play(theta, alpha, slack):
    """Assert that stiffness below a hundredth of that beyond counts as play, in each row."""
    values = {"theta2": theta, "theta_bend": 100.0 - theta, "alpha1": alpha}
    values |= {"alpha_bend": 100.0 - alpha}

    def of(names: set[str]) -> Fitted:
        own = {name: values[name] for name in names}
        return cast(Fitted, SimpleNamespace(all_values=own, by_name=own))

    assert sought_terms.is_slack(of({*values})) == slack
    assert sought_terms.is_slack(of({"theta2", "theta_bend"})) == (theta < 1.0)
    assert not sought_terms.is_slack(of({"theta2", "alpha1"}))
    assert BEND.is_plausible(of({"alpha1", "alpha_bend"})) == (alpha > 10.0)


@pytest.mark.parametrize("bounded", ["alpha_bend", "alpha1"])
def test_a_constant_is_sought_where_something_ended_at_a_bound(bounded):
    """Assert that a coefficient stays at its bound, and that the constant is still fitted."""
    truth = {"alpha_bend": 40.0 / 0.3, "alpha1": 100.0 / 0.3}[bounded]
    bounds = {bounded: (0.0, 0.9 * truth)}
    recording, width = made(3, **BENT), {"bend_deflection": 0.3}
    found = fitted(recording, "bent_spring", widths=width, bounds=bounds)
    assert found.at_bound == {bounded: pytest.approx(0.9 * truth)}
    assert BEND.of(found.structure) != pytest.approx(0.3, rel=1e-3)
    held = fitted(recording, "bent_spring", fixed=width, bounds=bounds)
    assert found.minimum.equations.cost < held.minimum.equations.cost


@pytest.mark.parametrize("preload", [0.0, 3.0, -3.0])
def test_a_preload_moves_where_a_bend_is_looked_for(plain, preload):
    """Assert that candidates are dense, on both sides of the deflection's mean."""
    (recording,) = plain.data.samples
    moved = replace(recording, positions=recording.positions + np.array([preload, 0.0]))
    data = replace(plain.data, samples=(moved,))
    deflection = np.subtract(*moved.positions.T)
    found = np.array(BEND.candidates(plain.structure, data))
    mean, usual = abs(np.mean(deflection)), np.std(deflection)
    assert found.max() == pytest.approx(mean + 2.0 * usual)
    assert found.min() == pytest.approx(mean + (-2.0 if preload else 0.3) * usual)
    assert np.diff(found).max() < 0.61 * usual
    assert np.abs(found - mean - 0.1 * usual).min() < 0.21 * usual


def test_the_interval_knows_that_the_number_was_sought():
    """Assert that intervals of a phase three turns away include the constant's uncertainty."""
    drift = NUMBER * 2.0 * np.pi * 3.0
    truth = 0.3 / 0.3 * np.array([np.cos(PHASE - drift), np.sin(PHASE - drift)])
    given, free = [], []
    for seed in range(10, 22):
        recording = turned(made(seed, 6.0, **RIPPLED), 3)
        constants = {"ripple_number": NUMBER + 1e-3, "angle_origin": 0.0}
        found = fitted(recording, "torque_ripple", widths=constants)
        sought = {"ripple_number": RIPPLE.of(found.structure)}
        held = fitted(recording, "torque_ripple", widths=constants, fixed=sought)
        for own, offs in ((found, free), (held, given)):
            places = [own.names.index(f"alpha_ripple_{wave}") for wave in ("sine", "cosine")]
            off = own.values[places] - truth
            offs.append(np.abs(off / widened(own, NO_ERROR).deviations[places]).max())
    assert np.median(given) > 3.0
    assert 0.3 < np.median(free) < 1.7  # 1.0 for a maximum of two with one in effect
    assert max(free) < 4.0


def test_the_spectrum_by_position_shows_the_number():
    """Assert that the residuals' largest peak is within half the resolution of the number."""
    plain = fitted(made(4, **RIPPLED))
    resolution = RIPPLE.resolution(plain.structure.joint, plain.data)
    few, peaks = np.split(np.array(sought_terms.numbers(plain.structure, plain.data)), [5])
    assert peaks[0] == pytest.approx(NUMBER, abs=0.5 * resolution)
    assert few == pytest.approx(resolution * np.linspace(1.0, 4.0, 5))


@pytest.mark.parametrize("tied", [True, False])
def test_a_reflected_bend_is_the_same_spring(tied: bool):
    """Assert equal torques of both rows, and positive constants; other values stay."""
    at = np.linspace(-0.5, 0.5, 101)
    values = {"theta1": 5.0, "theta2": 60.0, "alpha1": 200.0, "alpha_bend": 70.0}
    values |= {"bend_deflection": -0.2, "stribeck_velocity": -0.1}
    if not tied:
        values["theta_bend"] = 21.0
    found = sought_terms.reflected(values)
    assert found.keys() == values.keys()
    assert (found["bend_deflection"], found["stribeck_velocity"]) == (0.2, 0.1)
    assert (found["theta1"], sought_terms.reflected(found)) == (5.0, found)

    def torque(own: dict[str, float], spring: str, bend: str) -> np.ndarray:
        following = own["alpha_bend"] * own["theta2"] / own["alpha1"]
        extra, b = own.get(bend, following), own["bend_deflection"]
        return own[spring] * at + extra * (at - (np.abs(at + b) - np.abs(at - b)) / 2.0)

    for names in (("theta2", "theta_bend"), ("alpha1", "alpha_bend")):
        assert torque(found, *names) == pytest.approx(torque(values, *names), abs=1e-9)


def test_a_given_constant_is_the_only_candidate(plain):
    """Assert that no other constant is tried if prior knowledge fixes it."""
    given = replace(plain.structure, fixed={BEND.constant: 0.37})
    ((_, own),) = shapes._promising(BEND, plain, given)
    assert BEND.of(own) == 0.37


@pytest.mark.parametrize(
    ("known", "is_scale", "followed"),
    [
        ({0.1: 0.9, 0.2: 0.8, 0.3: 0.1, 0.4: 0.7}, False, [0.1, 0.4]),
        ({0.1: 0.1, 0.2: 0.8, 0.3: 0.9, 0.4: 0.2}, False, [0.3, 0.1]),
        ({0.1: 0.9, 0.2: 0.8, 0.4: 0.7, 0.8: 0.6}, True, [0.1, 0.4]),
        ({0.1: 0.6, 0.2: 0.8, 0.4: 0.9, 0.8: 0.7}, True, [0.4, 0.1]),
        ({0.1: 0.8, 0.2: 0.9, 0.4: 0.7, 0.8: 0.6}, True, [0.2, 0.8]),
    ],
)
def test_followed_candidates_lie_apart(monkeypatch, known, is_scale, followed):
    """Assert that the second one lies more than twice the resolution from the best."""

    def resolution(joint, _):
        return 0.8 * joint.first[BEND.constant] if is_scale else 0.06

    shape = replace(BEND, candidates=lambda *_: [*known], resolution=resolution)
    if is_scale:
        shape = replace(shape, least=lambda _: 0.0)
    monkeypatch.setattr(shapes, "_promised", lambda _, own: known[shape.of(own)])
    monkeypatch.setattr(shapes, "_near", lambda _s, _b, own, value: [(1.0, shape.put(own, value))])
    before = over(4, 9.0)
    found = [shape.of(own) for _, own in shapes._promising(shape, before, before.structure)]
    assert found == followed


def test_friction_that_rises_with_the_speed_is_no_stribeck_friction(plain):
    """Assert that a negative Stribeck friction does not count as seen."""
    for size, seen in ((1.0, True), (-1.0, False)):
        own = plain.structure
        fit: Any = SimpleNamespace(by_name={"alpha_stribeck": size}, structure=own, data=plain.data)
        assert replace(STRIBECK, least=lambda _: 0.0).is_seen_in(fit) == seen


@pytest.mark.parametrize(("reach", "seen"), [(1.5, True), (0.7, False)])
def test_presliding_along_a_path_within_the_noise_is_not_seen(plain, reach, seen):
    """Assert that a reach, given in standard deviations of the noise, must exceed it."""
    own = PRESLIDING.put(plain.structure, 1.0 / (reach * plain.data.noise[-1]))
    fit: Any = SimpleNamespace(by_name={}, structure=own, data=plain.data)
    assert PRESLIDING.is_seen_in(fit) == seen


def test_which_structures_have_a_shape():
    """Assert that a bend replaces a cubic spring unless that is kept or absent."""
    with_cubic = fitted(made(4, 4.0), "cubic_stiffness").structure
    beside, instead = BEND.extensions(with_cubic)
    assert beside.absent == with_cubic.absent - BEND.coefficients
    assert instead.absent == beside.absent | HARDENING
    assert [own.absent for own in BEND.extensions(with_cubic, HARDENING)] == [beside.absent]
    assert len([*BEND.extensions(with_cubic.without(HARDENING))]) == 1
    laws = [own.joint.constants["stribeck_exponent"] for own in STRIBECK.extensions(with_cubic)]
    assert laws == [2.0, 1.0]


PROMISES = {0.1: 0.3, 0.2: 0.9, 0.3: 0.5}
SAME, LONGER = 4, 2  # segments


@pytest.mark.parametrize(
    ("promises", "holding", "begun", "chosen", "follows"),
    [
        # The two best predictions are followed; a fit that confirms one ends the search.
        (PROMISES, None, [0.2, 0.3], (), False),
        (PROMISES, 0.2, [0.2], (), True),
        (PROMISES, 0.3, [0.2, 0.3], (), True),
        # Predictions below the threshold are not followed.
        ({0.1: ENOUGH, 0.2: TOO_LITTLE}, None, [0.1], (), False),
        # A rival that explains the same segments better ends the search.
        (PROMISES, 0.2, [0.2], (SAME, 8.9), False),
        (PROMISES, 0.2, [0.2], (SAME, 9.1), True),
        (PROMISES, 0.2, [0.2], (LONGER, 8.9), True),
    ],
)
def test_which_constants_are_followed(monkeypatch, promises, holding, begun, chosen, follows):
    """Assert the order of constants that are followed, until a fit confirms its prediction."""
    tried = []
    shape = shapes.SoughtShape(
        "a shape", BEND.coefficients, BEND.constant, lambda *_: [*promises], lambda *_: 0.0
    )

    def fit_from(_, structure, **__):
        held = structure.fixed.get(shape.constant)
        return None if held is None else made_fit(by_name={"held": held})

    def explained_by(before, structure, start, *_):
        tried.append(shape.of(structure))
        assert start == {"held": tried[-1]}  # the fit begins from one with the constant fixed
        return before if tried[-1] == holding else None

    before = over(SAME, 9.0)
    before.names, before.structure = ("theta2",), before.structure.without(HARDENING)
    by_length = by_length_of(before)
    monkeypatch.setattr(shapes, "_promised", lambda _, s: promises[shape.of(s)])
    monkeypatch.setattr(shapes, "sampled", lambda fit: fit)
    monkeypatch.setattr(shapes, "explained_by", explained_by)
    monkeypatch.setattr(FitsByLength, "onward", lambda _, first: [first])
    monkeypatch.setattr(FitsByLength, "with_term", lambda *_: by_length)
    monkeypatch.setattr(shapes, "fit_from", fit_from)
    rivals = [over(*chosen)] if chosen else []
    found = fit_with_shape(shape, by_length, before, rivals)
    assert tried == begun
    assert (found is not None) == follows


@pytest.mark.parametrize(
    ("excess", "slow", "size", "tried", "ended"),
    [
        # Each law is fitted from the best one before it, and longer segments from the best of all.
        (1.5, 1.2, 1.0, [(1.0, 1.5), (0.5, 1.3)], [0.5, 0.5]),
        (1.5, 1.4, 1.0, [(1.0, 1.5), (0.5, 1.3)], [1.0, 1.0]),
        # Friction does not rise with the speed.
        (1.5, 1.2, -1.0, [(1.0, 1.5), (0.5, 1.3)], [1.0, 1.0]),
        # A law that leaves only noise stays.
        (1.09, 1.0, 1.0, [], [2.0, 2.0]),
    ],
)
def test_the_likeliest_law_stays(monkeypatch, excess, slow, size, tried, ended):
    """Assert the order in which laws of Stribeck friction are compared, and which one stays."""
    every, starts = {1.0: 1.3, 0.5: slow}, []

    def law(structure):
        return structure.joint.constants["stribeck_exponent"]

    def fit_like(structure, fitted):
        starts.append((law(structure), fitted.excess))
        found = over(SAME, every[law(structure)], structure)
        found.by_name = {"alpha_stribeck": size if law(structure) == 0.5 else 1.0}
        return found

    first = over(SAME, excess, next(STRIBECK.extensions(WITHOUT)))
    monkeypatch.setattr(shapes, "fit_like", fit_like)
    monkeypatch.setattr(shapes, "_explaining", lambda *_: [first])
    monkeypatch.setattr(
        FitsByLength, "onward", lambda _, fit: [fit, over(1, fit.excess, fit.structure)]
    )
    monkeypatch.setattr(FitsByLength, "with_term", lambda _, found: found)
    by_length = by_length_of(first)
    rises = {"is_possible": lambda fitted: fitted.by_name.get("alpha_stribeck", 1.0) > 0.0}
    shape = replace(STRIBECK, least=lambda _: 0.0, **rises)
    found: Any = fit_with_shape(shape, by_length, first, [])
    assert starts == tried
    assert [law(fit.structure) for fit in found] == ended


@pytest.mark.parametrize(
    ("promise", "costs", "chosen"),
    [(ENOUGH, (8.0, 7.0), 1), (ENOUGH, (7.0, 8.0), 0), (TOO_LITTLE, (8.0,), 0)],
)
def test_a_requested_constant_begins_fixed(monkeypatch, promise, costs, chosen):
    """Assert that it is free from that fit on if the log shows it, and that the better fit stays.

    A fit from values without the term would not determine it.
    """
    shape = replace(RIPPLE, candidates=lambda *_: [NUMBER], resolution=lambda *_: 0.0)
    before = made_fit(9.0, cost=9.0, segments=range(SAME), by_name={"begun": -1.0})
    fits = [
        made_fit(cost=cost, by_name={"begun": i}, converged=True) for i, cost in enumerate(costs)
    ]
    starts = []

    def fit_by_length(structure, _, start, *__, **___):
        starts.append((start["begun"], structure.fixed.get(shape.constant)))
        return [fits[len(starts) - 1]]

    monkeypatch.setattr(shapes, "_promised", lambda *_: promise)
    monkeypatch.setattr(shapes, "fit_by_length", fit_by_length)
    monkeypatch.setattr(FitsByLength, "onward", lambda _, first: [first])
    monkeypatch.setattr(FitsByLength, "with_term", lambda _, found: found)
    found: Any = shapes.fit_requested_shapes([shape], by_length_of(before))
    assert starts == [(-1.0, NUMBER), (0, None)][: len(costs)]
    assert found == [fits[chosen]]


FRICTION = ("motor_coulomb", "motor_stribeck")
FALLS: dict[str, Any] = {**DRY, "motor_static": 1.0}
SLOWLY: dict[str, Any] = {**FALLS, "stribeck_velocity": 0.2, "stribeck_exponent": 0.5}
BOTH = {**SLID, "motor_coulomb_friction": 3.0}
ALL_THREE = ("motor_coulomb", "motor_stribeck", "motor_presliding")
REMEMBERED = ("motor_coulomb", "spring_hysteresis", "motor_presliding")
UNEVENLY = ("motor_coulomb", "torque_ripple", "bent_spring")
CASES = {
    "a bend from which steps with a cubic term lead away": Case(
        {"bend": 0.5, "bend_stiffness": -35.0, "noise": 1e-4},
        ("bent_spring",),
        seconds={2: 10.0},
    ),
    # The first step favours the other law.
    "requested friction, whose law is that of the better fit": Case(
        {**FALLS, "stribeck_velocity": 0.8},
        FRICTION,
        settings=asked(*FRICTION),
        seconds={4: 12.0},
        accuracy=2e-3,
        shapes={"stribeck_exponent": 2.0},
    ),
    # The rare law is found from a fit with another one.
    "friction that falls slowly": Case(
        SLOWLY, FRICTION, seconds={5: 12.0}, accuracy=0.02, shapes={"stribeck_exponent": 0.5}
    ),
    "requested friction that falls slowly": Case(
        SLOWLY,
        FRICTION,
        settings=asked(*FRICTION),
        seconds={5: 12.0},
        accuracy=0.02,
        shapes={"stribeck_exponent": 0.5},
    ),
    # Terms that hide each other: without presliding the friction seems to rise with the speed.
    "requested friction that falls, with presliding": Case(
        {**STICKING, **BRISTLES}, ALL_THREE, BOTH, asked(*ALL_THREE), {3: 12.0}, 0.02
    ),
    "a requested spring that remembers, with presliding": Case(
        {**BRISTLES, **HYSTERESIS}, REMEMBERED, SLID, asked(*REMEMBERED), {3: 12.0}, 0.02
    ),
    "a requested bend and a ripple": Case(
        {**BENT, **RIPPLED}, UNEVENLY, {}, asked(*UNEVENLY), {3: 12.0}, 0.02
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_terms_are_found_with_their_constants(name):
    """Assert terms, laws and values where steps lead astray, or terms hide each other."""
    CASES[name].check(CASES[name].identified())


def test_the_requested_term_that_explains_the_most_comes_first(monkeypatch):
    """Assert the order of the terms, and that the laws of earlier ones are compared again."""
    fit = made_fit()
    leaves = {RIPPLE.words: 0.5, STRIBECK.words: 0.2, BEND.words: 0.7}
    order, again = [], []

    def with_best_law(shape, _, by_length):
        order.append(shape)
        return by_length

    def with_likelier_law(shape, fitted, _):
        again.append(shape)
        return fitted

    monkeypatch.setattr(shapes, "_requested", lambda shape, *_: [(leaves[shape.words], fit)])
    monkeypatch.setattr(shapes, "_with_best_law", with_best_law)
    monkeypatch.setattr(shapes, "_with_likelier_law", with_likelier_law)
    asked = (RIPPLE, STRIBECK, BEND)
    shapes.fit_requested_shapes(asked, by_length_of(fit))
    assert order == [STRIBECK, RIPPLE, BEND]
    assert again == [STRIBECK, RIPPLE]


@pytest.mark.parametrize(("excess", "more"), [(1.11, True), (1.09, False)])
def test_noise_is_not_more_than_another_leaves(excess, more):
    """Assert that a better rival counts only if residuals exceed noise."""
    assert leaves_more(over(4, excess), [over(4, 1.0)], THRESHOLDS) == more


@pytest.mark.parametrize(
    "asked", [{"known": {"torque_ripple": 0.3}}, {"bounds": {"torque_ripple": (0.0, 1.0)}}]
)
def test_smoothed_friction_has_no_such_terms(asked):
    """Assert that a setting for such a term is refused if friction is smoothed."""
    with pytest.raises(SettingError, match="torque_ripple goes with dry friction only"):
        identify([log(made(1, 6.0, **RIPPLED))], Settings(coulomb_velocity=0.1, **asked))


WITH_CONSTANT = [shape for shape in sought_terms.SOUGHT if shape.constant]


@pytest.mark.parametrize("shape", [sought_terms.HYSTERETIC, *WITH_CONSTANT])
def test_where_nothing_moves_nothing_is_sought(plain, shape):
    """Assert that a joint at rest has no candidates, and that a requested term is refused."""
    (recording,) = plain.data.samples
    none = np.zeros_like(recording.positions)
    resting = replace(recording, positions=none, velocities=none)
    data = replace(plain.data, samples=(resting,))
    assert shape.candidates(plain.structure, data) == []
    still = replace(plain, data=data)
    by_length = by_length_of(still, divisions=(still.problem.segments,))
    with pytest.raises(ConvergenceError, match=shape.words):
        shapes.fit_requested_shapes([shape], by_length)


def test_stribeck_friction_falls_within_the_motors_velocities(plain):
    """Assert that a Stribeck velocity above three times the largest velocity is refused."""
    largest = float(np.abs(plain.data.samples[0].velocities[:, 1]).max())  # pyright: ignore[reportOptionalSubscript]
    for share, is_possible in ((2.9, True), (3.1, False)):
        own = sought_terms.STRIBECK.put(plain.structure, share * largest)
        with_term = replace(own, absent=own.absent - sought_terms.STRIBECK.coefficients)
        assert sought_terms.STRIBECK.is_possible(replace(plain, structure=with_term)) == is_possible
        assert sought_terms.STRIBECK.is_possible(replace(plain, structure=own))


def test_many_turns_need_no_more_memory(plain):
    """Assert that the length of the spectrum is limited for a motor that turns on and on."""
    (recording,) = plain.data.samples
    away = np.linspace(0.0, 1e6, len(recording))[:, None]
    turning = replace(recording, positions=recording.positions + away)
    found = sought_terms.numbers(plain.structure, replace(plain.data, samples=(turning,)))
    assert len(found) <= 5 + 8
    assert max(found) <= 2.0**15 * 2.0 * np.pi / 1e6
