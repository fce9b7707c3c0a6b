"""Which terms stay: on made-up quadratic forms whose answer is known, and on small logs."""

from dataclasses import dataclass, field, replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import chi2, f, norm, t

import flexid.identification.structure.elimination as elimination
import flexid.identification.structure.job as job
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.full_model.model import Fitted, Structure
from flexid.identification.preparation.joint import flexible
from flexid.identification.structure.elimination import best_length, eliminate
from flexid.identification.vocabulary.thresholds import THRESHOLDS

JOINT = flexible()
LIMITS = replace(THRESHOLDS, term_chance=0.02, shape_chance=0.001, friction_sign=4.0)
MANY = 1e9  # degrees of freedom: as good as normal


@dataclass
class _Fit:
    covariance: np.ndarray
    degrees_of_freedom: tuple[float, ...]


@dataclass
class _Quadratic:
    """A fit of which only its sum of squares about the minimum is known."""

    names: tuple[str, ...]
    values: np.ndarray
    information: np.ndarray
    freedom: float | tuple[float, ...] = MANY
    spread: np.ndarray | float = 1.0  # true standard deviations over those of white noise
    sought: tuple[str, ...] = ()
    margin: float = 10.0  # s
    structure: Structure = field(init=False)
    at_bound: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        base = {name.partition("[")[0] for name in self.names}
        absent = frozenset(JOINT.optional - base)
        self.structure = Structure(JOINT, absent, Timing("zero", {}, self.sought))

    @property
    def data(self) -> SimpleNamespace:
        return SimpleNamespace(margin=self.margin)

    @property
    def unit_deviations(self) -> np.ndarray:
        return np.sqrt(np.diag(np.linalg.pinv(self.information)))

    @property
    def fit(self) -> _Fit:
        deviations = self.unit_deviations * self.spread
        freedom = self.freedom
        if not isinstance(freedom, tuple):
            freedom = (freedom,) * len(self.names)
        return _Fit(np.diag(deviations**2), freedom)


def left(quadratic: _Quadratic, kept: tuple[str, ...] = (), thresholds=LIMITS) -> set[str]:
    """Optional coefficients and delays that stay."""
    structure, _ = eliminate(cast(Fitted, quadratic), kept, thresholds)
    names = {name.partition("[")[0] for name in quadratic.names}
    return (names & JOINT.optional) - structure.absent | {*structure.timing.sought}


def alone(name: str, deviations: float, **more) -> _Quadratic:
    """Spring and gain beside one number so many standard deviations from zero."""
    names = ("theta2", "alpha1", "beta1", name)
    values = np.array([100.0, 300.0, 3.0, 0.1 * deviations])
    return _Quadratic(names, values, np.diag([1e4, 1e4, 1e4, 100.0]), **more)


def normal(chance: float) -> float:
    """Standard deviations from zero that chance exceeds so often, to either side."""
    return float(norm.isf(chance / 2.0))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("name", "chance"), [("theta_offset", 0.02), ("theta1", 0.02), ("alpha_saturation", 0.001)]
)
def test_chance_decides(name, chance, side):
    """Assert that a usual term stays if chance is below one in 50, a shape if below one in 1000."""
    assert left(alone(name, side * (normal(chance) + 0.02))) == {name}
    assert left(alone(name, side * (normal(chance) - 0.02))) == set()


@pytest.mark.parametrize(("beyond", "stays"), [(0.02, {"theta_offset"}), (-0.02, set())])
def test_the_first_coefficient_is_judged_like_the_last(beyond, stays):
    """Assert that a term's place among the unknowns is of no account."""
    names = ("theta_offset", "theta2", "alpha1", "beta1")
    values = np.array([0.1 * (normal(0.02) + beyond), 100.0, 300.0, 3.0])
    fit = _Quadratic(names, values, np.diag([100.0, 1e4, 1e4, 1e4]))
    assert left(fit) == stays
    _, (evidence,) = eliminate(cast(Fitted, fit), (), LIMITS)
    assert (evidence.name, evidence.std) == ("theta_offset", pytest.approx(0.1))


@pytest.mark.parametrize("phase", [0.0, 0.7, np.pi / 2.0, 3.0])
def test_amplitude_and_phase_are_one_term(phase):
    """Assert that both components of an eccentric gear stay, or none, whatever its phase.

    Together they are that far from zero one time in 1000 for two degrees of freedom.
    """
    names = ("theta2", "alpha1", "beta1", "alpha_ecc_sine", "alpha_ecc_cosine")
    edge = float(np.sqrt(chi2.isf(0.001, 2)))

    def found(deviations: float) -> set[str]:
        values = np.array([100.0, 300.0, 3.0, 0.0, 0.0])
        values[3:] = 0.1 * deviations * np.cos(phase), 0.1 * deviations * np.sin(phase)
        return left(_Quadratic(names, values, np.diag([1e4, 1e4, 1e4, 100.0, 100.0])))

    assert found(edge + 0.02) == {"alpha_ecc_sine", "alpha_ecc_cosine"}
    assert found(edge - 0.02) == set()


@pytest.mark.parametrize("pair", [(5.0, MANY), (MANY, 5.0)])
def test_a_term_is_as_sure_as_the_less_sure_of_its_coefficients(pair):
    """Assert that the fewer degrees of freedom of amplitude and phase decide, by Fisher's F."""
    names = ("theta2", "alpha1", "beta1", "alpha_ecc_sine", "alpha_ecc_cosine")
    edge = float(np.sqrt(2.0 * f.isf(0.001, 2, 5.0)))
    assert edge > float(np.sqrt(chi2.isf(0.001, 2))) + 0.5

    def found(deviations: float) -> set[str]:
        values = np.array([100.0, 300.0, 3.0, 0.1 * deviations, 0.0])
        information = np.diag([1e4, 1e4, 1e4, 100.0, 100.0])
        return left(_Quadratic(names, values, information, freedom=(MANY, MANY, MANY, *pair)))

    assert found(edge + 0.02) == {"alpha_ecc_sine", "alpha_ecc_cosine"}
    assert found(edge - 0.02) == set()


def test_half_an_eccentric_gear_that_is_kept_keeps_the_other():
    """Assert that what stays by wish takes its other half along."""
    names = ("theta2", "alpha1", "beta1", "alpha_ecc_sine", "alpha_ecc_cosine")
    values = np.array([100.0, 300.0, 3.0, 0.0, 0.0])
    fit = _Quadratic(names, values, np.diag([1e4, 1e4, 1e4, 100.0, 100.0]))
    assert left(fit, ("alpha_ecc_sine",)) == {"alpha_ecc_sine", "alpha_ecc_cosine"}


@pytest.mark.parametrize(
    ("edge", "more"),
    [
        (float(t.isf(0.01, 5.0)), {"freedom": 5.0}),
        (3.0 * normal(0.02), {"spread": 3.0}),
        (normal(0.02), {"spread": 0.1}),
    ],
    ids=["Student's t", "three times white noise", "blocks that agree by chance"],
)
def test_deviations_are_those_of_the_blocks_but_no_less_than_noise(edge, more):
    """Assert that what a term needs follows from the scatter of blocks and their number."""
    assert left(alone("theta_offset", edge + 0.05, **more)) == {"theta_offset"}
    assert left(alone("theta_offset", edge - 0.05, **more)) == set()


@pytest.mark.parametrize(
    "name", ["alpha2", "theta_viscous", "theta_coulomb", "alpha_damping", "alpha_drag"]
)
def test_negative_friction_goes(name):
    """Assert that a friction up to four deviations below zero is none, and stays beyond."""
    assert left(alone(name, -3.9)) == set()
    assert left(alone(name, -4.1)) == {name}
    assert left(alone(name, 3.9)) == {name}


def test_negative_gravity_stays():
    """Assert that what may have either sign is not taken for a friction."""
    assert left(alone("theta1", -3.9)) == {"theta1"}


def test_what_is_to_stay_stays():
    """Assert that what the user names stays whatever the log says, be it negative."""
    assert left(alone("alpha2", -0.1), kept=("alpha2",)) == {"alpha2"}


def test_spring_and_gain_stay():
    """Assert that what every joint has is no term that could go."""
    quadratic = alone("theta1", 0.1)
    structure, tests = eliminate(cast(Fitted, quadratic), (), LIMITS)
    assert not {"theta2", "alpha1", "beta1"} & structure.absent
    assert [test.name for test in tests] == ["theta1"]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("size", "margin", "stays"),
    [(2.4, 10.0, True), (2.2, 10.0, False), (9.0, 0.91, True), (9.0, 0.89, False)],
)
def test_delays_go_like_terms(side, size, margin, stays):
    """Assert that one that chance explains, or longer than the margin, is sought no more."""
    quadratic = alone(INPUT, side * size, sought=(INPUT,), margin=margin)
    structure, _ = eliminate(cast(Fitted, quadratic), (), LIMITS)
    assert structure.timing.sought == ((INPUT,) if stays else ())


def test_others_follow_along_the_quadratic_form():
    """Assert that what stays is judged by its value after the others went, with its new width.

    Offset and cosine share their information, r = 0.9: with one gone the other's deviation falls
    to √(1 - r²) of what it was, and its value moves by r times that of the one that went.
    """
    r = 0.9
    covariance = np.array([[1.0, r], [r, 1.0]])
    information = np.zeros((5, 5))
    information[:3, :3] = 1e4 * np.eye(3)
    information[3:, 3:] = np.linalg.inv(covariance)
    names = ("theta2", "alpha1", "beta1", "theta_cosine", "theta_offset")
    values = np.array([100.0, 300.0, 3.0, 1.5, 2.0])
    quadratic = _Quadratic(names, values, information)
    structure, tests = eliminate(cast(Fitted, quadratic), (), LIMITS)
    found = {test.name: test for test in tests}
    assert "theta_cosine" in structure.absent
    assert not found["theta_cosine"].kept
    assert (found["theta_cosine"].value, found["theta_cosine"].std) == pytest.approx((1.5, 1.0))
    assert found["theta_offset"].kept == ("theta_offset" not in structure.absent)
    offset = (2.0 - r * 1.5, np.sqrt(1.0 - r**2))
    assert (found["theta_offset"].value, found["theta_offset"].std) == pytest.approx(offset)
    expected = 2.0 * norm.sf(offset[0] / offset[1])
    assert found["theta_offset"].probability == pytest.approx(expected, rel=1e-3)


def test_of_two_that_cannot_be_told_apart_the_less_usual_goes():
    """Assert that a shape that does just what a usual term does goes first, wherever it stands."""
    information = np.diag([1e4, 1e4, 1e4, 0.0, 0.0])
    information[3:, 3:] = 100.0
    for pair in (("alpha_coulomb", "alpha_drag"), ("alpha_backlash", "alpha_offset")):
        names = ("theta2", "alpha1", "beta1", *pair)
        values = np.array([100.0, 300.0, 3.0, 0.5, 0.5])
        (usual,) = {*pair} - JOINT.shapes
        assert left(_Quadratic(names, values, information)) == {usual}


def test_the_less_usual_goes_before_the_less_probable():
    """Assert that a shape that chance could make goes first, though a usual term is nearer to zero.

    They share their information, r = 0.95; the shape at 2.5 deviations would make up for the
    offset at 0.8, which alone is far from zero.
    """
    r = 0.95
    information = np.zeros((5, 5))
    information[:3, :3] = 1e4 * np.eye(3)
    information[3:, 3:] = np.linalg.inv(np.array([[1.0, -r], [-r, 1.0]]))
    names = ("theta2", "alpha1", "beta1", "theta_offset", "alpha_backlash")
    quadratic = _Quadratic(names, np.array([100.0, 300.0, 3.0, 0.8, 2.5]), information)
    assert left(quadratic) == {"theta_offset"}


def test_least_probable_goes_first():
    """Assert that of two that could go the one goes that is nearer to zero, and saves the other.

    Both together are each less than two deviations from zero; either alone is far from it.
    """
    r = 0.95
    information = np.zeros((5, 5))
    information[:3, :3] = 1e4 * np.eye(3)
    information[3:, 3:] = np.linalg.inv(np.array([[1.0, -r], [-r, 1.0]]))
    names = ("theta2", "alpha1", "beta1", "theta1", "theta_offset")
    for values, expected in (([1.9, 1.6], "theta1"), ([1.6, 1.9], "theta_offset")):
        quadratic = _Quadratic(names, np.array([100.0, 300.0, 3.0, *values]), information)
        assert left(quadratic) == {expected}


def test_offset_of_one_log_keeps_the_term():
    """Assert that an offset which one log shows is sought in all logs."""
    names = ("theta2", "alpha1", "beta1", "theta_offset[1]", "theta_offset[2]")
    values = np.array([100.0, 300.0, 3.0, 0.05, 1.0])
    assert left(_Quadratic(names, values, np.diag([1e4, 1e4, 1e4, 100.0, 100.0]))) == {
        "theta_offset"
    }


@pytest.mark.parametrize(("beyond", "expected"), [(0.02, {"theta_offset"}), (-0.02, set())])
def test_offsets_of_two_logs_are_two_numbers(beyond, expected):
    """Assert that one log's offset is judged by itself: the other log's makes it no chance."""
    names = ("theta2", "alpha1", "beta1", "theta_offset[1]", "theta_offset[2]")
    values = np.array([100.0, 300.0, 3.0, 0.0, 0.1 * (normal(0.02) + beyond)])
    assert left(_Quadratic(names, values, np.diag([1e4, 1e4, 1e4, 100.0, 100.0]))) == expected


def test_the_narrowest_fit_that_converged_is_best():
    """Assert that a fit that has not ended counts where there is no other, be it as narrow as may.

    Of two that are as narrow, but for 5 per cent, that over longer segments is taken.
    """

    def fit(width: float, converged: bool = True) -> Fitted:
        covariance = _Fit(np.array([[width**2]]), (MANY,))
        names, values = ("theta2",), np.ones(1)
        return cast(
            Fitted,
            SimpleNamespace(converged=converged, fit=covariance, names=names, values=values),
        )

    wide, narrow, not_ended = fit(0.2), fit(0.1), fit(0.01, converged=False)
    assert best_length([wide, narrow, not_ended]) is narrow
    assert best_length([not_ended, wide]) is wide
    assert best_length([not_ended]) is not_ended
    longer, too_wide = fit(0.104), fit(0.106)
    assert best_length([narrow, longer]) is longer
    assert best_length([narrow, too_wide]) is narrow


@pytest.mark.parametrize(
    ("changed", "name", "deviations"),
    [
        ({"term_chance": 0.5}, "theta_offset", 1.0),
        ({"shape_chance": 0.1}, "alpha_saturation", 2.0),
        ({"friction_sign": 2.0}, "alpha2", -3.0),
    ],
)
def test_thresholds_are_those_given(changed, name, deviations):
    """Assert that each of the three limits is taken from the thresholds."""
    assert left(alone(name, deviations)) == set()
    assert left(alone(name, deviations), thresholds=replace(LIMITS, **changed)) == {name}


USUAL = Structure(JOINT, frozenset({"alpha_drag", "alpha_saturation"}), Timing("zero"))
UNUSUAL = Structure(JOINT, frozenset({"theta_offset", "alpha_offset"}), Timing("zero"))
FALL = THRESHOLDS.exchange_fall


@pytest.fixture
def leanest(monkeypatch):
    """Return a function that says whether the unusual terms are taken, by what both leave."""

    def taken(usual: tuple[float, int] | None, unusual: tuple[float, int] | None, excess=1.0):
        """By sum of squares and number of coefficients; None where there is no fit."""

        def left(full, kept, thresholds, *, usual_first=False):
            return (UNUSUAL, ("unusual",)) if usual_first else (USUAL, ("usual",))

        def fit(structure, *_):
            found = usual if structure is USUAL else unusual
            if found is None:
                return None
            cost, count = found
            minimum = SimpleNamespace(equations=SimpleNamespace(cost=cost))
            return SimpleNamespace(minimum=minimum, names=range(count), excess=excess)

        monkeypatch.setattr(elimination, "eliminate", left)
        monkeypatch.setattr(elimination, "fit_like", fit)
        full: Any = None
        structure, evidence = elimination._leanest(full, (), THRESHOLDS)
        assert evidence == (("unusual",) if structure is UNUSUAL else ("usual",))
        return structure is UNUSUAL

    return taken


def test_unusual_terms_have_to_be_far_better_or_fewer(leanest):
    """Assert that each coefficient more or less is worth the same fall, and one is to be gained."""
    assert leanest((1000.0, 8), (999.9 - FALL, 8))
    assert not leanest((1000.0, 8), (1000.1 - FALL, 8))
    assert leanest((1000.0, 9), (999.9, 8))
    assert not leanest((1000.0, 9), (1000.1, 8))
    assert leanest((1000.0, 10), (999.9 + FALL, 8))
    assert not leanest((1000.0, 10), (1000.1 + FALL, 8))
    assert not leanest((1000.0, 8), (1000.1 - 2.0 * FALL, 9))


def test_unusual_terms_have_to_explain_the_log(leanest):
    """Assert that far better is no argument where the residuals are more than noise."""
    assert leanest((9000.0, 8), (1000.0, 8), THRESHOLDS.sensor_excess - 0.001)
    assert not leanest((9000.0, 8), (1000.0, 8), THRESHOLDS.sensor_excess + 0.001)


def test_what_has_no_fit_is_not_left(leanest):
    """Assert that the other way of taking away is taken then."""
    assert leanest(None, (1000.0, 8))
    assert not leanest((1000.0, 8), None)


@pytest.mark.parametrize("explained", [True, False])
def test_steps_need_not_end_where_the_log_is_explained(monkeypatch, explained):
    """Assert that unusual terms join as far as they lead there, and not at all elsewhere."""
    excess = THRESHOLDS.sensor_excess + (-0.001 if explained else 0.001)
    shapes = JOINT.shapes
    narrow: Any = SimpleNamespace(
        excess=excess,
        duration=1.0,
        data=None,
        by_name={},
        structure=Structure(JOINT, shapes, Timing("zero")),
        problem=SimpleNamespace(segments="segments"),
        minimum=SimpleNamespace(point=SimpleNamespace(initial_states="states")),
    )

    def fit_by_length(structure, data, start, divisions, states, *, insist):
        assert (divisions, states, insist) == (["segments"], "states", False)
        assert structure.absent == shapes & (JOINT.remembered | elimination.SOUGHT_COEFFICIENTS)
        return [SimpleNamespace(excess=excess, structure=structure)]

    monkeypatch.setattr(elimination, "fit_like", lambda *_: None)
    monkeypatch.setattr(elimination, "fit_by_length", fit_by_length)
    by_length: Any = SimpleNamespace(found=(narrow,), holds=("zero",))
    wider, _ = elimination._wider(narrow, by_length, THRESHOLDS)
    assert (wider is not narrow) == explained


def test_terms_that_lead_astray_do_not_join(monkeypatch):
    """Assert that the fit without them stands."""

    def fit_by_length(*_, insist):
        raise ConvergenceError("prediction error", "diverges")

    narrow: Any = SimpleNamespace(
        data=None,
        by_name={},
        problem=SimpleNamespace(segments=None),
        minimum=SimpleNamespace(point=SimpleNamespace(initial_states=None)),
    )
    monkeypatch.setattr(elimination, "fit_by_length", fit_by_length)
    assert elimination._as_far_as_it_leads(USUAL, narrow) is None


@pytest.mark.parametrize(
    ("fewer", "worse", "expected"),
    [
        (False, -0.001, "unusual"),
        (False, 0.001, "usual"),
        (True, 0.049, "unusual"),
        (True, 0.051, "usual"),
    ],
)
def test_fewer_coefficients_may_predict_a_little_worse(monkeypatch, fewer, worse, expected):
    """Assert that the usual terms win at once with as few coefficients, or else if far better."""

    def chosen(fit_by_length, kept, with_shapes, *_):
        fitted = SimpleNamespace(
            names=range(7 if with_shapes and fewer else 8), excess=1.0, duration=1.0
        )
        structure = UNUSUAL if with_shapes else Structure(JOINT, JOINT.shapes, Timing("zero"))
        return SimpleNamespace(
            structure=structure,
            fitted=fitted,
            found=(),
            with_shapes=with_shapes,
            by_length=fit_by_length,
        )

    monkeypatch.setattr(job, "choose_structure", chosen)
    monkeypatch.setattr(job, "_preferred", lambda choice, *_: (choice, choice.with_shapes))
    monkeypatch.setattr(job, "misprediction", lambda with_shapes: worse if with_shapes else 0.0)
    monkeypatch.setattr(job, "_beside", lambda *_: ())
    own: Any = SimpleNamespace(
        fitted_by_length=lambda *_: SimpleNamespace(found=()),
        settings=SimpleNamespace(terms="auto"),
        kept=(),
    )
    nothing: Any = None
    rest = (nothing, nothing, nothing, lambda _: None, THRESHOLDS)
    choice: Any = job._predicting(own, *rest)[0]
    assert ("unusual" if choice.with_shapes else "usual") == expected


@pytest.mark.parametrize(
    ("duration", "unexplained", "sought"),
    [(0.5, 0.119, True), (0.5, 0.121, False), (0.25, 0.059, True), (0.25, 0.061, False)],
)
def test_shapes_are_sought_where_the_model_follows_half_a_second(
    monkeypatch, duration, unexplained, sought
):
    """Assert the limit, in proportion over shorter segments; play is tried all the same."""
    monkeypatch.setattr(job, "SOUGHT", ())
    joint = SimpleNamespace(remembered={"memory"})
    fitted: Any = SimpleNamespace(
        excess=9.0,
        duration=duration,
        unexplained=unexplained,
        structure=SimpleNamespace(joint=joint, absent={"memory"}),
    )
    fitted.unexplained_over = partial(Fitted.unexplained_over, fitted)
    choice: Any = SimpleNamespace(by_length=SimpleNamespace(found=(fitted,)), found=())
    tried = [*job._beside(choice, lambda _: None, THRESHOLDS)]
    assert len(tried) == 1 + sought


@pytest.mark.parametrize(
    ("excess", "duration", "expected"),
    [(1.099, 0.5, True), (1.101, 0.5, False), (1.099, 0.49, False)],
)
def test_what_explains_the_log_ends_the_search(excess, duration, expected):
    """Assert that noise is left, over segments in which a spring turns round."""
    fitted: Any = SimpleNamespace(excess=excess, duration=duration)
    assert job._explains(fitted, THRESHOLDS) == expected
