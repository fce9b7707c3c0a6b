"""Elimination of terms: on quadratic forms with a known solution, and on stand-ins for fits."""

from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_joint import JOINT, made_fit, over
from scipy.stats import chi2, f, norm, t

import flexid.identification.full_model.fitting as fitting
import flexid.identification.structure.choice as choice_module
import flexid.identification.structure.job as job
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.full_model.fits_by_length import FitsByLength, explains
from flexid.identification.full_model.model import LINK, Fitted, Structure
from flexid.identification.structure.choice import best_length
from flexid.identification.structure.elimination import eliminate
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS

LIMITS = replace(THRESHOLDS, term_chance=0.02, shape_chance=0.002, friction_sign=3.5)
MANY = 1e9  # degrees of freedom, practically a normal distribution


@dataclass
class _Quadratic:
    """Stand-in for a fit with a quadratic sum of squares."""

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
    def fit(self) -> SimpleNamespace:
        deviations, count = self.unit_deviations * self.spread, len(self.names)
        freedom = self.freedom if isinstance(self.freedom, tuple) else (self.freedom,) * count
        return SimpleNamespace(deviations=deviations, degrees_of_freedom=freedom)

    @property
    def scatter(self) -> np.ndarray:
        return Fitted.scatter.func(cast(Fitted, self))


def left(
    quadratic: _Quadratic, kept: tuple[str, ...] = (), thresholds=LIMITS, **more: Any
) -> set[str]:
    """Return the optional coefficients and delays that are kept."""
    structure, _ = eliminate(cast(Fitted, quadratic), kept, thresholds, **more)
    names = {name.partition("[")[0] for name in quadratic.names}
    return (names & JOINT.optional) - structure.absent | {*structure.timing.sought}


BASE = ("theta2", "alpha1", "beta1")


def beside(values: dict[str, float], correlation: float = 0.0, **more: Any) -> _Quadratic:
    """Return spring and gain, and values in multiples of their standard deviation of 0.1."""
    n = len(values)
    information = np.zeros((3 + n, 3 + n))
    information[:3, :3] = 1e4 * np.eye(3)
    spread = 0.01 * ((1.0 - correlation) * np.eye(n) + correlation)
    information[3:, 3:] = np.linalg.inv(spread)
    sizes = [0.1 * size for size in values.values()]
    return _Quadratic((*BASE, *values), np.array([100.0, 300.0, 3.0, *sizes]), information, **more)


def normal(chance: float) -> float:
    """Return the two-sided quantile of the normal distribution."""
    return float(norm.isf(chance / 2.0))


GEAR = ("alpha_ecc_sine", "alpha_ecc_cosine")
TWO_NUMBERS = float(np.sqrt(chi2.isf(0.002, 2)))
FEW = float(np.sqrt(2.0 * f.isf(0.002, 2, 5.0)))  # two coefficients with five degrees of freedom
assert FEW > TWO_NUMBERS + 0.5
EDGES: dict[str, tuple[float, dict[str, float], dict[str, Any]]] = {
    # Limit in standard deviations; direction of the coefficients; settings of the fit.
    "a usual term: one in 50": (normal(0.02), {"theta_offset": 1.0}, {}),
    "gravity, of either sign": (normal(0.02), {"theta1": -1.0}, {}),
    "a shape: one in 500": (normal(0.002), {"alpha_saturation": -1.0}, {}),
    "one offset of two": (normal(0.02), {"theta_offset[1]": 0.0, "theta_offset[2]": 1.0}, {}),
    **{
        f"amplitude and phase together, at {phase}": (
            TWO_NUMBERS,
            dict(zip(GEAR, (np.cos(phase), np.sin(phase)), strict=True)),
            {},
        )
        for phase in (0.0, 0.7, np.pi / 2.0, 3.0)
    },
    **{
        f"the fewer degrees of freedom, of {name}": (
            FEW,
            dict(zip(GEAR, (1.0, 0.0), strict=True)),
            {"freedom": (*[MANY] * 3, *(5.0 if name == each else MANY for each in GEAR))},
        )
        for name in GEAR
    },
    "Student's t": (float(t.isf(0.01, 5.0)), {"theta_offset": 1.0}, {"freedom": 5.0}),
    "thrice white noise": (3.0 * normal(0.02), {"theta_offset": 1.0}, {"spread": 3.0}),
    "blocks that agree by chance": (normal(0.02), {"theta_offset": 1.0}, {"spread": 0.1}),
    **{
        f"negative {name}": (3.5, {name: -1.0}, {})
        for name in ("alpha2", "theta_viscous", "theta_coulomb", "alpha_damping", "alpha_drag")
    },
}


@pytest.mark.parametrize("case", EDGES)
def test_what_is_beyond_chance_stays(case):
    """Assert the limit for each kind of term, which keeps all of its coefficients or none."""
    edge, direction, more = EDGES[case]
    for away, stays in ((0.05, True), (-0.05, False)):
        sizes = {name: (edge + away) * part for name, part in direction.items()}
        names = {name.partition("[")[0] for name in direction}
        assert left(beside(sizes, **more)) == (names if stays else set())


def test_less_is_asked_of_what_is_likely():
    """Assert that a likely friction is kept up to `generous_chance`."""
    edge = normal(LIMITS.generous_chance)
    for away, stays in ((0.05, {"alpha_coulomb"}), (-0.05, set())):
        friction = beside({"alpha_coulomb": edge + away, "theta_offset": edge + away})
        assert left(friction, likely=("alpha_coulomb",)) == stays
        assert left(friction) == set()


def test_what_has_to_stay_stays():
    """Assert that spring and gain are kept, and requested terms as a whole."""
    structure, (evidence,) = eliminate(cast(Fitted, beside({"theta1": 0.1})), (), LIMITS)
    assert not {*BASE} & structure.absent
    assert (evidence.name, evidence.std) == ("theta1", pytest.approx(0.1))
    structure, (evidence,) = eliminate(cast(Fitted, beside({"alpha2": -0.1})), ["alpha2"], LIMITS)
    assert "alpha2" not in structure.absent
    assert (evidence.name, evidence.kept, evidence.std) == ("alpha2", True, pytest.approx(0.1))
    assert left(beside(dict.fromkeys(GEAR, 0.0)), kept=GEAR[:1]) == {*GEAR}
    assert left(beside({"theta_offset[1]": 0.5, "theta_offset[2]": 10.0})) == {"theta_offset"}


def test_others_follow_along_the_quadratic_form():
    """Assert that values and deviations are updated after another term is removed.

    Offset and cosine share their information, r = 0.9: without one the other's deviation falls to
    √(1 - r²) of what it was, and its value moves by r times the removed value.
    """
    r = 0.9
    quadratic = beside({"theta_cosine": 1.5, "theta_offset": 2.0}, r)
    structure, tests = eliminate(cast(Fitted, quadratic), (), LIMITS)
    found = {test.name: test for test in tests}
    assert "theta_cosine" in structure.absent
    assert not found["theta_cosine"].kept
    assert (found["theta_cosine"].value, found["theta_cosine"].std) == pytest.approx((0.15, 0.1))
    offset = found["theta_offset"]
    assert offset.kept == ("theta_offset" not in structure.absent)
    moved, deviation = 2.0 - r * 1.5, np.sqrt(1.0 - r**2)
    assert (offset.value, offset.std) == pytest.approx((0.1 * moved, 0.1 * deviation))
    assert offset.probability == pytest.approx(2.0 * norm.sf(moved / deviation), rel=1e-3)


@pytest.mark.parametrize(
    ("sizes", "stays"),
    [
        # The smaller one is removed, and the other is then significant.
        ({"theta1": 1.9, "theta_offset": 1.6}, "theta1"),
        ({"theta1": 1.6, "theta_offset": 1.9}, "theta_offset"),
        # An insignificant shape is removed first, though a usual term is smaller.
        ({"theta_offset": 0.8, "alpha_backlash": 2.5}, "theta_offset"),
        # Friction stays, though the delay that looks like it is more significant.
        ({LINK: 2.2, "theta_viscous": 1.6}, "theta_viscous"),
    ],
)
def test_of_two_that_share_their_information_one_goes(sizes, stays):
    """Assert which of two correlated terms below three standard deviations is kept."""
    assert left(beside(sizes, -0.95, sought=(*{LINK} & sizes.keys(),))) == {stays}


def test_of_two_that_cannot_be_told_apart_the_less_usual_goes():
    """Assert that of two identical columns the shape is removed, and the usual term kept."""
    information = np.diag([1e4, 1e4, 1e4, 0.0, 0.0])
    information[3:, 3:] = 100.0
    for pair in (("alpha_coulomb", "alpha_drag"), ("alpha_backlash", "alpha_offset")):
        values = np.array([100.0, 300.0, 3.0, 0.5, 0.5])
        (usual,) = {*pair} - JOINT.shapes
        assert left(_Quadratic((*BASE, *pair), values, information)) == {usual}


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("size", "margin", "stays"),
    [(2.4, 10.0, True), (2.2, 10.0, False), (9.0, 0.91, True), (9.0, 0.89, False)],
)
def test_delays_go_like_terms(side, size, margin, stays):
    """Assert that an insignificant delay, or one longer than the margin, is removed."""
    quadratic = beside({INPUT: side * size}, sought=(INPUT,), margin=margin)
    assert left(quadratic) == ({INPUT} if stays else set())


def test_the_narrowest_fit_that_converged_is_best():
    """Assert that converged fits come first, and the longer of two fits within 5 % of width."""

    def fit(width: float, converged: bool = True, value: float = 1.0) -> Fitted:
        estimate = Estimate(("theta2",), np.array([value]), np.array([[width**2]]), (MANY,))
        return made_fit(converged=converged, fit=estimate)

    wide, narrow, not_ended = fit(0.2), fit(10.0, value=100.0), fit(0.01, converged=False)
    assert best_length([wide, narrow, not_ended]) is narrow
    assert best_length([not_ended, wide]) is wide
    assert best_length([not_ended]) is not_ended
    longer, too_wide = fit(0.104), fit(0.106)
    assert best_length([narrow, longer]) is longer
    assert best_length([narrow, too_wide]) is narrow


USUAL = Structure(JOINT, frozenset({"alpha_drag", "alpha_saturation"}), Timing("zero"))
UNUSUAL = Structure(JOINT, frozenset({"theta_offset", "alpha_offset"}), Timing("zero"))


@pytest.mark.parametrize(("explained", "saturates"), [(True, True), (True, False), (False, True)])
def test_steps_need_not_end_where_the_log_is_explained(monkeypatch, explained, saturates):
    """Assert that unusual terms are added, even unconverged, if the log is explained.

    A saturation is added only if the input can show it.
    """
    excess = THRESHOLDS.sensor_excess + (-0.001 if explained else 0.001)
    shapes = JOINT.shapes
    without = Structure(JOINT, shapes, Timing("zero"))
    narrow = made_fit(excess, segments="segments", states="states", structure=without)

    def fit_from(fitted, structure, *, steps):
        assert (fitted, steps.insist) == (narrow, False)
        left = shapes & (JOINT.remembered | choice_module.SOUGHT_COEFFICIENTS)
        assert structure.absent == (left if saturates else left | choice_module.SATURATION)
        return made_fit(excess, structure=structure)

    monkeypatch.setattr(choice_module, "shows_saturation", lambda _: saturates)
    monkeypatch.setattr(choice_module, "fit_like", lambda *_: None)
    monkeypatch.setattr(choice_module, "fit_from", fit_from)
    by_length = FitsByLength((narrow,), (), True, ("zero",))
    wider, _ = choice_module._wider(narrow, by_length)
    assert (wider is not narrow) == explained


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
    """Assert that unusual terms with fewer coefficients may predict worse by 5 %."""

    def chosen(_job, by_length, *, with_shapes):
        fitted = made_fit(names=range(7 if with_shapes and fewer else 8))
        structure = UNUSUAL if with_shapes else Structure(JOINT, JOINT.shapes, Timing("zero"))
        choice = SimpleNamespace(structure=structure, fitted=fitted, by_length=by_length)
        return choice, "unusual" if with_shapes else "usual"

    monkeypatch.setattr(job, "_chosen", chosen)
    monkeypatch.setattr(job, "misprediction", lambda its: worse if its == "unusual" else 0.0)
    monkeypatch.setattr(job, "_further_searches", lambda *_: ())
    own: Any = SimpleNamespace(
        fitted_by_length=lambda: SimpleNamespace(found=()),
        settings=SimpleNamespace(terms="auto"),
        progress=lambda _: None,
        thresholds=THRESHOLDS,
    )
    assert job._predicting(own)[1] == expected


RIGID = SimpleNamespace(joint=SimpleNamespace(kind="rigid"))


@pytest.mark.parametrize(
    ("fitted", "stands"),
    [
        (made_fit(1.64, unexplained=1.0, at_bound=()), True),
        (made_fit(1.66, unexplained=0.0051, at_bound=()), False),
        (made_fit(1.66, unexplained=0.0049, at_bound=()), True),
        (made_fit(1.66, unexplained=1.0, at_bound=("alpha2",)), True),
        (made_fit(99.0, structure=RIGID, at_bound=()), True),
        (made_fit(101.0, structure=RIGID, at_bound=()), False),
    ],
)
def test_only_what_may_stand_is_made_leaner(monkeypatch, fitted, stands):
    """Assert that a fit too poor to be reported is not made leaner, unless `exact` is set."""

    def choose(*, exact):
        by_length = FitsByLength((fitted,), (), False, ("cubic",), "", exact=exact)
        return choice_module.choose_structure(by_length, (), with_shapes=False)

    monkeypatch.setattr(choice_module, "eliminate", lambda *_: 1 / 0)
    for exact in (True, False):
        with nullcontext() if not (exact or stands) else pytest.raises(ZeroDivisionError):
            assert choose(exact=exact).fitted is fitted


def test_a_leaner_fit_may_take_rough_steps(monkeypatch):
    """Assert that a term goes although small steps fail without it."""
    full = over(1, 1.0)
    leaner = full.structure.without(["theta_viscous"])
    for name, stub in (
        ("eliminate", lambda *_: (leaner, ())),
        ("settled", lambda fitted: fitted),
        ("_rivals", lambda *_: ()),
        ("fit_like", lambda own, _, *rough: over(1, 1.0, own) if rough else None),
    ):
        monkeypatch.setattr(choice_module, name, stub)
    by_length = FitsByLength((full,), (), False, ("cubic",), "", exact=True)
    assert choice_module.choose_structure(by_length, (), with_shapes=False).structure is leaner


@pytest.mark.parametrize(
    ("excesses", "exact", "lengths"),
    [
        ((9.0, 9.0, 9.0), False, [0.25, 0.5]),
        ((9.0, 9.0, 9.0), True, [0.25, 0.5, 1.0]),
        ((9.0, 1.0, 1.0), False, [0.25, 0.5, 1.0]),
        ((9.0, 1.0, 9.0), False, [0.25, 0.5, 1.0]),
    ],
)
def test_what_cannot_stand_leads_to_no_longer_segments(monkeypatch, excesses, exact, lengths):
    """Assert that lengths end at 0.5 s if the fit there is too poor to be reported."""
    duration_of = {8: 0.25, 4: 0.5, 2: 1.0}
    fits = {
        count: made_fit(
            excess, segments=range(count), duration=duration, unexplained=1.0, at_bound=()
        )
        for (count, duration), excess in zip(duration_of.items(), excesses, strict=True)
    }
    monkeypatch.setattr(fitting, "over_longer", lambda _, longer, __: fits[len(longer)])
    divisions: Any = tuple(map(range, duration_of))
    by_length = FitsByLength((), divisions, True, ("cubic",), "", exact=exact)
    found = by_length.onward(fits[8])
    assert [fit.duration for fit in found] == lengths


RIVALS: dict[str, tuple[dict[str, Any], list[str]]] = {
    "nothing else": ({}, []),
    "fewer coefficients": ({"generous": USUAL.without({"theta_offset"})}, []),
    "more coefficients": ({"generous": replace(USUAL, absent=frozenset())}, ["generous"]),
    "a friction that drives": ({"values": (9.0, -1e-9)}, ["braking"]),
    "one that is to be kept": ({"values": (9.0, -1e-9), "kept": ("alpha2",)}, []),
    "more than noise": ({"excess": 1.101}, ["other length"]),
    "more than noise, and bounds": ({"excess": 1.101, "bounds": {"alpha2": (0.0, 1.0)}}, []),
}


@pytest.mark.parametrize("case", RIVALS)
def test_what_held_out_data_may_prefer(monkeypatch, case):
    """Assert which rival fits are made, and for which reason."""
    changes, expected = RIVALS[case]
    given = {"generous": USUAL, "values": (9.0, 0.1), "kept": (), "excess": 1.099, "bounds": {}}
    given |= changes
    structure = replace(USUAL, bounds=given["bounds"])
    names = {given["generous"].absent: "generous", USUAL.absent | {"alpha2"}: "braking"}
    more = {"names": ("theta1", "alpha2"), "values": np.array(given["values"])}
    fitted = made_fit(given["excess"], structure=structure, **more)
    found: Any = (fitted, SimpleNamespace(duration=0.5, name="other length"))
    monkeypatch.setattr(
        choice_module, "fit_like", lambda one, _: SimpleNamespace(name=names[one.absent])
    )
    rivals: Any = choice_module._rivals(fitted, given["generous"], found, given["kept"], THRESHOLDS)
    assert [rival.name for rival in rivals] == expected


@pytest.mark.parametrize(
    ("errors", "taken"), [((0.5, 0.501), 0), ((0.5, 0.499), 1), ((0.4, 0.3), 1), ((0.2, 0.3), 2)]
)
def test_a_rival_has_to_predict_far_better(monkeypatch, errors, taken):
    """Assert that a rival needs the required gain, and that the best of several is taken."""
    limit = 0.5 + THRESHOLDS.generous_gain
    fits: list[Any] = [
        SimpleNamespace(structure=USUAL, error=error) for error in (limit, *errors[::-1])
    ]
    choice: Any = choice_module.Choice(
        USUAL, UNUSUAL, fits[0], (), (), cast(Any, None), (*fits[1:],)
    )
    monkeypatch.setattr(job, "validate", lambda fitted, *_: fitted)
    monkeypatch.setattr(job, "misprediction", lambda fitted: fitted.error)
    monkeypatch.setattr(job, "settled", lambda fitted: fitted)
    recordings = SimpleNamespace(starts=())
    own: Any = SimpleNamespace(recordings=recordings, whole=None, thresholds=THRESHOLDS)
    best, validation = job._preferred(choice, own)
    assert fits.index(best.fitted) == fits.index(cast(Any, validation)) == taken
    assert (best.structure is USUAL) == (taken > 0)


@pytest.mark.parametrize(
    ("duration", "unexplained", "sought"),
    [(0.5, 0.119, True), (0.5, 0.121, False), (0.25, 0.059, True), (0.25, 0.061, False)],
)
def test_shapes_are_sought_where_the_model_follows_half_a_second(
    monkeypatch, duration, unexplained, sought
):
    """Assert the limit, proportional to the duration; play is tried in any case."""
    monkeypatch.setattr(job, "SOUGHT", ())  # hysteresis is left
    fitted = made_fit(9.0, duration=duration, unexplained=unexplained)
    choice: Any = SimpleNamespace(by_length=SimpleNamespace(found=(fitted,)), found=())
    own: Any = SimpleNamespace(progress=lambda _: None, thresholds=THRESHOLDS)
    tried = [*job._further_searches(choice, own)]
    assert len(tried) == 1 + sought


@pytest.mark.parametrize(
    ("excess", "duration", "expected"),
    [(1.099, 0.5, True), (1.101, 0.5, False), (1.099, 0.49, False)],
)
def test_what_explains_the_log_ends_the_search(excess, duration, expected):
    """Assert that the search ends if only noise is left over segments of at least 0.5 s."""
    assert explains(made_fit(excess, duration=duration), THRESHOLDS) == expected
