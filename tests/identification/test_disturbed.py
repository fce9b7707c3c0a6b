"""Fit with disturbances: its estimates, and the doubts that widen its intervals."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_joint import (
    COEFFICIENTS,
    JOINT,
    PUSHED,
    among_disturbances,
    assert_holds,
    data,
    diverging,
    half_widths,
    log,
    made,
    pushed,
    recording,
    seen,
    stopping,
    structure,
)

from flexid.identification.estimation import band, disturbed, unusual_terms
from flexid.identification.estimation import disturbed_estimate as estimating
from flexid.identification.estimation.band import Band, JointInBand
from flexid.identification.estimation.disturbed import Disturbed, fit_disturbed, fit_disturbed_to
from flexid.identification.estimation.disturbed_estimate import disturbed_estimate
from flexid.identification.estimation.doubts import ECCENTRICITY, Repeat
from flexid.identification.estimation.input_noise import InputChoice
from flexid.identification.estimation.model_error import by_other_laws
from flexid.identification.estimation.rig_errors import SHARE
from flexid.identification.full_model.fitting import expanded
from flexid.identification.full_model.model import LINK, Data, Fitted, Structure
from flexid.identification.full_model.starting import least_squares_start, suited_rate
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.structure import gap
from flexid.identification.structure.link_delay import skew
from flexid.identification.structure.sought_terms import STRIBECK
from flexid.identification.structure.validation import from_fitted_states
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import HARDENING
from flexid.models.flexible_joint import HYSTERESIS_GRIP as GRIP
from flexid.recording.recording import Hold, Recording

CORE = ("theta2", "alpha1", "beta1")
HARDENS = 20.0 * 150.0  # N m/rad³
BENT: Any = {"bend": 0.3, "bend_stiffness": 60.0}
FALLING: Any = {
    "motor_coulomb_up": 1.0,
    "motor_coulomb_down": 1.0,
    "motor_static": 1.5,
    "stribeck_velocity": 2.0,
}
BOUC_WEN: Any = {"hysteresis_torque": 4.0, "hysteresis_reach": 0.02, "hysteresis_power": 3.0}


def logged_as(made_log: Recording, torque: np.ndarray) -> Recording:
    """Return the recording with another logged torque."""
    sides = made_log.needed_link_position, made_log.motor_position
    return recording(made_log.time, *sides, torque, "another torque")


def saturating() -> Recording:
    """Return a drive of whose logged torque v only v - s v³ acts, up to 15 % less."""
    right = pushed(7, link_push=0.3)
    acts = right.needed_input
    logged, most = acts, np.abs(acts).max() / 0.85
    for _ in range(50):
        logged = acts + 0.15 * logged**3 / most**2
    return logged_as(right, logged)


def rippling() -> Recording:
    """Return a drive with a cogging torque of 1 N m, 14 times per turn of the motor."""
    right = pushed(7, link_push=0.3)
    return logged_as(right, right.needed_input + np.sin(14.0 * right.motor_position + 0.4))


@dataclass(frozen=True)
class Case:
    """Log with its terms, its true values and the allowed half width of the main coefficients."""

    made: Callable[[], Recording]
    terms: tuple[str, ...] = ()
    hold: Hold = "cubic"
    with_shapes: bool = False
    share: float = 0.1
    more: tuple[tuple[str, float], ...] = ()

    @cached_property
    def data(self) -> Data:
        """Data of the log, as fits take them."""
        return data(self.made())

    @property
    def structure(self) -> Structure:
        """Structure with all terms that are considered."""
        base = structure("motor_viscous", *self.terms, hold=self.hold)
        return replace(base, joint=JOINT.scaled(self.data.samples)) if self.with_shapes else base

    def fit(self) -> Disturbed:
        """Return the fit to the log."""
        own = self.structure, self.data
        found = fit_disturbed(*own, (), (self.hold,), THRESHOLDS, with_shapes=self.with_shapes)
        return fit_disturbed_to(found, self.data) if self.with_shapes else found


CASES = {
    "a pushed link": Case(lambda: pushed(1, link_push=1.0)),
    "a fourth of the samples": Case(lambda: pushed(1, link_push=1.0, every=4)),
    "a drive that stops": Case(lambda: stopping(2), ("motor_coulomb",), "zero", share=0.15),
    **{
        f"gravity on {turns}": Case(
            lambda size=size: pushed(3, size=size, gravity_torque=8.0, link_push=0.3 * size),
            ("gravity",),
            share=share,
            more=(("theta1", 8.0),),
        )
        for turns, size, share in (("a little motion", 0.06, 0.2), ("much", 1.0, 0.1))
    },
    **{
        f"play of {size:g} rad": Case(
            lambda size=size: pushed(7, link_push=0.3, half_gap=size), ("cubic_stiffness",),
            with_shapes=True,
        )
        for size in (0.02, 0.08)
    },
    "another law of hysteresis": Case(
        lambda: made(7, torque_noise=0.5, **BOUC_WEN), ("gravity", "joint_damping"),
        with_shapes=True, more=(*COEFFICIENTS.items(),),
    ),
    "a spring that bends": Case(
        lambda: made(7, torque_noise=0.5, **BENT), ("gravity", "joint_damping", "cubic_stiffness"),
        with_shapes=True, more=(*COEFFICIENTS.items(), ("alpha_bend", 200.0)),
    ),
    "friction that falls": Case(
        lambda: made(7, torque_noise=0.5, **FALLING),
        ("gravity", "joint_damping", "motor_coulomb"), with_shapes=True,
        more=(*COEFFICIENTS.items(), ("alpha_coulomb", 10.0 / 3.0), ("alpha_stribeck", 5.0)),
    ),
    "a torque that saturates": Case(saturating, with_shapes=True),
    "a torque with ripple": Case(rippling, with_shapes=True),
    "a spring that hardens": Case(
        lambda: pushed(7, link_push=0.3, cubic_stiffness=HARDENS), ("cubic_stiffness",),
        with_shapes=True,
    ),
}  # fmt: skip


@cache
def fitted(name: str) -> tuple[Disturbed, Estimate]:
    """Return the fit and the estimate of a case."""
    fit = CASES[name].fit()
    return fit, disturbed_estimate(fit, CASES[name].data, is_voltage=False)[0]


def test_friction_has_the_direction_of_a_late_link(monkeypatch: pytest.MonkeyPatch):
    """Assert that a fit that finds a delay is repeated with directions that allow for it."""
    asked: list[float] = []
    on_time = band.directions_on_time

    def recorded(own: Data, late: float, *rest: Any) -> np.ndarray:
        asked.append(late)
        return on_time(own, late, *rest)

    monkeypatch.setattr(band, "directions_on_time", recorded)
    late = data(made(7, 12.0, torque_noise=0.5, link_delay=8e-3, link_coulomb=1.0))
    terms = ("gravity", "motor_viscous", "link_coulomb", "joint_damping")
    own = structure(*terms, sought=(LINK,))
    fit = Band(late, 16).fit(own, {**COEFFICIENTS, "theta_coulomb": 1.0})
    assert asked == [0.0, pytest.approx(8e-3, rel=0.1)]
    assert fit.fitted.by_name["theta2"] == pytest.approx(COEFFICIENTS["theta2"], rel=1e-3)
    moved = band.directions(late.samples, 16) - on_time(late, 8e-3, 16)
    assert np.abs(moved[:, 0]).max() > 0.1 > np.abs(moved[:, 1]).max()


@pytest.mark.parametrize("name", CASES)
def test_the_core_stays_known(name: str):
    """Assert that intervals contain the true values and are narrow."""
    case, estimate = CASES[name], fitted(name)[1]
    numbers = estimate.names, estimate.values, half_widths(estimate)
    for coefficient, value, half in zip(*numbers, strict=True):
        truth = {**PUSHED, **dict(case.more)}.get(coefficient)
        if truth is not None:
            assert abs(value - truth) <= half, coefficient
            assert half < case.share * truth or coefficient not in CORE, coefficient


def test_torques_that_differ_from_the_log():
    """Assert that saturation and ripple are found among disturbances."""
    found = {name: {*fitted(name)[1].names} for name in CASES}
    assert [name for name, own in found.items() if "alpha_saturation" in own] == [
        "a torque that saturates"
    ]
    assert [name for name, own in found.items() if "ripple_number" in own] == [
        "a torque with ripple"
    ]
    number = fitted("a torque with ripple")[1].by_name["ripple_number"]
    assert number == pytest.approx(14.0, abs=0.05)


def test_what_each_log_shows():
    """Assert that disturbances are found in their row, rest in time, and play only if present."""
    link, motor = fitted("a pushed link")[0].best.sizes.disturbances
    assert 1.0 / 1.5 < link < 1.5
    assert motor < 0.3 * link
    observer = fitted("a drive that stops")[0].fitted.problem.observer
    assert observer is not None
    assert 0.1 < observer.resting[:, 1].mean() < 0.8
    turned = [np.ptp(CASES[n].data.samples[0].positions[:, 0]) for n in CASES if "gravity" in n]
    assert turned[0] < 0.5 < turned[1]
    for size in (0.02, 0.08):
        played = fitted(f"play of {size:g} rad")[0].fitted
        assert gap.is_dead_zone(played)
        assert gap.half_gap(played) == pytest.approx(size, rel=0.1)
    remembering = [name for name in CASES if GRIP in fitted(name)[0].fitted.names]
    assert remembering == ["another law of hysteresis"]
    for name, term in (("a spring that bends", "bend"), ("friction that falls", "stribeck")):
        others = {f"alpha_{own}" for own in ("bend", "stribeck", "backlash", "hysteresis")}
        own = fitted(name)[0].fitted
        assert others & {*own.names} == {f"alpha_{term}"}
        constant = own.structure.joint.nonlinear[f"alpha_{term}"]
        assert own.structure.joint.constants[constant] == own.by_name[constant]
    hardens = fitted("a spring that hardens")[0].fitted
    assert gap.half_gap(hardens) == 0.0
    assert "alpha_cubic" in hardens.names


@pytest.mark.parametrize("law", [2.0, 1.0])
def test_friction_may_follow_the_other_law(law: float):
    """Assert the change of the values by the other law: that of a fit with it."""
    found = fitted("friction that falls")[0]
    structure, data = found.fitted.structure, CASES["friction that falls"].data
    pair = []
    for own in (law, 3.0 - law):
        joint = structure.joint.with_widths({"stribeck_exponent": own})
        start = found.fitted.by_name if not pair else pair[0].fitted.by_name
        own_structure = replace(structure, joint=joint)
        own_band = replace(found.best.band, data=data)
        pair.append(own_band.fit(own_structure, start, found.best.sizes))
    first, second = (fit.fitted for fit in pair)
    change, scale = by_other_laws(first)[:, 0], first.unit_deviations
    assert np.abs(second.values / first.values - 1.0).max() > 0.4
    assert change / scale == pytest.approx((second.values - first.values) / scale, abs=1.0)
    other = fitted("a spring that bends")[0].fitted  # has one law alone
    assert by_other_laws(other).shape == (len(other.names), 0)


def test_a_spring_is_no_delay():
    """Assert that a delay explains less than a fifth of a compliant joint's deflection."""
    found = skew(JOINT, data(pushed(1)))
    assert abs(found.explained) < 0.2
    assert not found.makes_the_deflection
    assert found.excess > 100.0


@pytest.mark.parametrize(("stiffness", "gravity"), [(1e6, 0.0), (2e4, 0.0), (2e4, 60.0)])
def test_a_delay_between_encoders_is_found(stiffness: float, gravity: float):
    """Assert that a delay of 3 ms is found for a rigid joint and for a compliant one.

    Gravity may bend the spring more than the acceleration does.
    """
    acts: Any = {"joint_stiffness": stiffness, "gravity_torque": gravity}
    found = skew(JOINT, data(made(6, link_delay=3e-3, **acts)))
    assert found.delay == pytest.approx(3e-3, rel=0.02)
    assert found.explained > 0.9
    assert found.makes_the_deflection == (stiffness == 1e6)
    if found.makes_the_deflection:
        assert abs(found.delay - 3e-3) < 4.0 * found.deviation
        assert found.excess < 10.0
    else:
        assert found.by_spring > 0.9


def test_damping_of_a_pushed_joint_may_look_like_a_late_encoder():
    """Assert that the interval of the motor's friction contains the true 1.5 1/s, three away.

    What pushes the link hides that the other balance contradicts the delay.
    """
    shaken = data(pushed(3, 16.0, link_push=20.0, motor_push=0.05, joint_damping=2.0))
    found = among_disturbances(structure("motor_viscous", sought=(LINK,)), shaken)
    estimate = disturbed_estimate(found, shaken, is_voltage=False)[0]
    place = estimate.names.index("alpha2")
    away = abs(estimate.by_name["alpha2"] - 1.5)
    assert 3.0 < away < half_widths(estimate)[place]
    change = 3.0**0.5 * estimating.by_damping(found)[place, 0]  # from none to all of it
    assert abs(estimate.by_name["alpha2"] + change - 1.5) < 0.1 * away


@pytest.mark.parametrize("delay", [0.0, 2e-3])
def test_a_late_encoder_that_the_link_shows_is_no_damping(delay: float):
    """Assert no such doubt without a delay, or if damping leaves clearly more unexplained."""
    log = data(made(6, link_delay=delay, torque_noise=0.5))
    found = among_disturbances(structure("motor_viscous", "gravity", sought=(LINK,)), log)
    assert (LINK in found.fitted.names) == bool(delay)
    assert not estimating.by_damping(found).size


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_friction_stays_beside_disturbances(seed: int):
    """Assert the intervals of a pendulum with a disturbed torque, a tenth of which is dry friction.

    Without the friction term, inertia and gravity are 15 to 22 % too large with 90 % confidence.
    """
    swung = made(
        seed,
        4.0,
        torque=lambda at: np.clip(at, 0.0, 1.0) * 3.0 * np.sin(1.9 * at) + 0.8 * np.sin(8.0 * at),
        torque_noise=2.0,
        joint_stiffness=1e6,
        motor_viscous=0.0,
        **dict.fromkeys(("motor_coulomb_up", "motor_coulomb_down"), 0.4),
    )
    found = identify([log(replace(swung, link_position=None))])
    assert (found.model, found.compliance.visible) == ("rigid", False)
    assert found.disturbances is not None
    assert_holds(found, {"gravity_torque": 5.0, "coulomb_friction": 0.4})
    assert_holds(found, {"inertia": 1.3}, width=1.0)


@pytest.mark.parametrize(("torque_noise", "asked"), [(0.1, False), (1.0, True)])
def test_disturbances_are_asked_for_where_the_core_is_not_well_known(
    torque_noise: float, asked: bool
):
    """Assert that a noisy torque leads to a fit with disturbances, and stiffness stays known."""
    steps: list[str] = []
    found = identify([log(made(5, torque_noise=torque_noise))], progress=steps.append)
    assert ("fit with disturbances" in steps) == asked
    assert_holds(found, {"joint_stiffness": 100.0}, width=0.05)


def test_halves_of_two_drives_widen_the_interval():
    """Assert that the interval of a drifting friction contains the means of both halves."""
    case = Case(lambda: pushed(5, motor_push=0.1, drift=0.6, drift_time=8.0))
    fit = case.fit()
    estimate = disturbed_estimate(fit, case.data, is_voltage=False)[0]
    half = half_widths(estimate)[estimate.names.index("alpha2")]
    warmth = 1.0 - 0.6 * (1.0 - np.exp(-np.linspace(0.0, 16.0, 1000) / 8.0))
    for mean in (warmth[:500].mean(), warmth[500:].mean()):
        assert abs(estimate.by_name["alpha2"] - mean * PUSHED["alpha2"]) <= half


@pytest.mark.parametrize("of_spring", [False, True])
def test_a_sensor_at_the_joint_shows_nothing_of_the_motor(of_spring: bool):
    """Assert that the spring's torque as input determines link and spring, but no motor."""
    right = made(6, motor_coulomb_up=0.5, motor_coulomb_down=0.5)
    spring = 100.0 * (right.motor_position - right.needed_link_position)
    noise = 0.02 * np.random.default_rng(8).standard_normal(len(spring))
    found = identify([log(logged_as(right, spring + noise) if of_spring else right)])
    assert any("the spring's torque" in str(warning) for warning in found.warnings) == of_spring
    verdicts = {name: p.verdict for name, p in found.parameters.items() if "link_visc" not in name}
    motor = {name for name in verdicts if "motor" in name or name == "total_inertia"}
    assert motor == {n for n in verdicts if (verdicts[n] == "undetermined") == of_spring} & motor
    assert_holds(found, {"joint_stiffness": 100.0, "link_inertia": 1.0}, width=0.3)


@pytest.mark.parametrize("payload", [0.0, 0.4])
def test_logs_with_another_payload_are_named(payload: float):
    """Assert that the interval contains both inertias, and that a warning names the parameter."""
    loads = (0.0, payload)
    logs = [
        log(made(5 + i, link_inertia=1.0 + more, gravity_torque=5.0 + 8.0 * more, torque_noise=0.3))
        for i, more in enumerate(loads)
    ]
    found = identify(logs, settings=Settings(terms=("gravity", "motor_viscous", "link_offset")))
    low, high = found.parameters["link_inertia"].interval
    assert low <= 1.0
    assert 1.0 + payload <= high
    named = [text for text in map(str, found.warnings) if text.startswith("the logs differ in")]
    assert [("link_inertia" in text, "joint_stiffness" in text) for text in named] == (
        [(True, False)] if payload else []
    )
    assert found.parameters["joint_stiffness"].half_width < 5.0
    assert {"theta_offset[1]", "theta_offset[2]"} <= found.coefficients.keys()


@pytest.mark.parametrize(("gain", "every"), [(600.0, 5), (1200.0, 5), (600.0, 1)])
def test_a_log_slower_than_its_controller_misses_torque(gain: float, every: int):
    """Assert that the interval allows for torque between the samples, if there is any.

    A controller answers steps of its course; the log has one of `every` of its samples.
    """
    step = 1e-3
    course = np.repeat(np.random.default_rng(1).uniform(-0.5, 0.5, 24), 1000)
    link = motor = link_speed = motor_speed = 0.0
    rows = np.zeros((len(course), 3))
    for row, goal in zip(rows, course, strict=True):
        torque = gain * (goal - motor) - 40.0 * motor_speed
        row[:] = link, motor, torque
        spring = 150.0 * (motor - link)
        link_speed += step * spring
        motor_speed += step / 0.6 * (torque - spring - 0.9 * motor_speed)
        link, motor = link + step * link_speed, motor + step * motor_speed
    rows[:, :2] += 2e-5 * np.random.default_rng(3).standard_normal((len(course), 2))
    logged = data(recording(step * np.arange(len(course))[::every], *rows[::every].T))
    found = among_disturbances(structure("motor_viscous"), logged)
    estimate = disturbed_estimate(found, logged, is_voltage=False)[0]
    half = half_widths(estimate)[estimate.names.index("beta1")] / PUSHED["beta1"]
    error = abs(estimate.by_name["beta1"] / PUSHED["beta1"] - 1.0)
    assert error < half < (0.05 if every == 1 else 0.4)
    assert (error > 0.1) == (every > 1)


@cache
def eccentric(size: float, motor_push: float) -> tuple[Fitted, Estimate]:
    """Return the fit of a drive with gravity whose link encoder is eccentric by `size` rad."""
    right = pushed(3, 16.0, gravity_torque=8.0, link_push=0.05, motor_push=motor_push)
    error = size * np.sin(right.needed_link_position)
    log = data(seen(right, error, np.zeros(len(right))))
    found = among_disturbances(structure("motor_viscous", "gravity"), log)
    return found.fitted, disturbed_estimate(found, log, is_voltage=False)[0]


@pytest.mark.parametrize("size", [0.0, 1e-3, 2e-3])
def test_a_torque_tells_gravity_from_an_eccentric_encoder(size: float):
    """Assert that the motor's balance limits the doubt about gravity, and intervals are right."""
    fitted, estimate = eccentric(size, 0.3)
    place, usual = fitted.names.index("theta1"), ECCENTRICITY * PUSHED["theta2"]
    directions = estimating.by_eccentricity(fitted)
    doubt = float(np.linalg.norm(directions[place]))
    assert doubt < 0.7 * usual if size == 0.0 else doubt > usual
    assert abs(estimate.by_name["theta1"] - 8.0) <= half_widths(estimate)[place]
    assert abs(fitted.by_name["theta1"] - 8.0) == pytest.approx(150.0 * size, abs=0.02)


@pytest.mark.parametrize("size", [0.0, 1e-3])
def test_an_eccentric_encoder_bends_the_spring_as_gravity_does(size: float):
    """Assert that the intervals contain the true values if gravity bends the spring most.

    Without the error they are narrow, since the log excludes it.
    """
    tones, torques = np.array([1.1, 2.7, 6.3, 13.0]), np.array([16.0, 10.0, 10.0, 8.0])
    acts: Any = {"joint_stiffness": 3000.0, "gravity_torque": 30.0, "motor_inertia": 1.8}
    right = made(
        3, 16.0, torque=lambda t: np.sin(np.outer(t, tones) + np.arange(4)) @ torques, **acts
    )
    log = data(seen(right, size * np.sin(right.needed_link_position), np.zeros(len(right))))
    found = among_disturbances(structure("motor_viscous", "gravity"), log)
    estimate = disturbed_estimate(found, log, is_voltage=False)[0]
    true = {"theta1": 30.0, "theta2": 3000.0, "alpha1": 3000.0 / 1.8, "beta1": 1.0 / 1.8}
    halves = dict(zip(estimate.names, half_widths(estimate).tolist(), strict=True))
    for name, value in true.items():
        assert abs(estimate.by_name[name] - value) <= halves[name]
    assert (halves["alpha1"] < 0.02 * true["alpha1"]) == (size == 0.0)


@pytest.mark.parametrize(
    ("size", "cable", "doubt"),
    [(1.0, 0.0, (0.001, 0.01)), (1.0, 1.5, (1.5, 2.0)), (0.25, 0.0, (0.25, 0.3))],
    ids=["far", "far, with a cable", "near"],
)
def test_a_far_motion_tells_gravity_from_a_cable(
    size: float, cable: float, doubt: tuple[float, float]
):
    """Assert the doubt about gravity in 1/s²: none if the log excludes a cable, else its effect."""
    rest: Any = {"link_push": 0.05, "motor_push": 0.3, "cable_stiffness": cable}
    seen = pushed(3, 16.0, gravity_torque=8.0, size=size, **rest)
    found = among_disturbances(structure("motor_viscous", "gravity"), data(seen)).fitted
    row = least_squares_start(found.structure, found.data, suited_rate(found))[1].rows[0]
    directions = estimating.by_cable(found, row)
    errors = dict(zip(found.names, np.linalg.norm(directions, axis=1).tolist(), strict=True))
    assert {name for name, error in errors.items() if error} == {"theta1"}
    assert doubt[0] < errors["theta1"] < doubt[1]
    assert abs(found.by_name["theta1"] - 8.0) < 2.0 * errors["theta1"]


@pytest.mark.parametrize(
    ("size", "terms", "least", "most"),
    [
        (0.25, (), 0.0, 0.01),
        (0.25, ("gravity_cosine", "link_offset"), 0.2, 0.5),
        (0.25, ("parallel_spring",), 3.0, 6.0),
        (2.0, ("gravity_cosine", "link_offset"), 0.0, 0.02),
        (2.0, ("parallel_spring",), 0.0, 0.02),
    ],
)
def test_only_a_far_motion_excludes_a_curved_cable(
    size: float, terms: tuple[str, ...], least: float, most: float
):
    """Assert the doubt in 1/s²: over a short way some terms take up the torque of a cable."""
    motions: Any = {"gravity_torque": 8.0, "size": size, "motor_push": 0.3}
    log = data(*(pushed(seed, 8.0, **motions) for seed in (3, 4)))
    fitted = among_disturbances(structure("motor_viscous", "gravity"), log).fitted
    row = least_squares_start(fitted.structure, log, suited_rate(fitted))[1].rows[0]
    wider = structure("motor_viscous", "gravity", *terms)
    seen = expanded(wider.with_hold(fitted.problem.timing.hold), fitted)
    errors = np.abs(estimating.by_curved_cable(seen, row)).max(axis=1)
    assert least <= errors.max() < most
    if least and "link_offset" in terms:  # the offset of each recording takes it up as the cosine
        offsets = errors[[name.startswith("theta_offset[") for name in seen.names]]
        assert offsets == pytest.approx(np.full(2, errors.max()), rel=0.05)


def test_each_group_has_its_own_offset():
    """Assert the terms of the link's angle at every second sample of two logs."""
    log = data(*(pushed(seed, 30.0, gravity_torque=8.0) for seed in (3, 4)))
    made_up: Any = SimpleNamespace(structure=structure("gravity"), data=log)
    terms, angle = estimating._terms_of_angle(made_up, ["theta1", "theta_offset[2]"])
    links = [each.positions[::2, 0] for each in log.samples]
    assert np.array_equal(angle, np.concatenate(links))
    assert np.abs(terms[:, 0]) == pytest.approx(np.abs(np.sin(angle)), abs=1e-12)
    second = np.repeat([0.0, 1.0], [*map(len, links)])
    assert np.abs(terms[:, 1]) == pytest.approx(second, abs=1e-12)


def test_a_curved_cable_is_the_main_doubt_about_a_spring_to_the_base():
    """Assert the cause of the widest intervals of gravity and such a spring over a short motion."""
    log = data(pushed(3, 16.0, gravity_torque=8.0, size=0.25, motor_push=0.3))
    found = among_disturbances(structure("motor_viscous", "gravity"), log)
    wider = structure("motor_viscous", "gravity", "parallel_spring")
    fit = found.best.band.fit(wider, found.fitted.by_name | {"theta_parallel": 0.0})
    both = replace(found, best=fit, full=fit.fitted)
    estimate, causes = disturbed_estimate(both, log, is_voltage=False)
    assert causes["theta1"] == causes["theta_parallel"] == "a curved cable may look like it"
    assert estimate.of("theta1")[1] > 2.0


CHANGE = {"alpha1": 0.03, "theta2": -0.01}  # relative


@pytest.mark.parametrize(
    ("by", "factor", "least"),
    [
        # The uncertainty of a spring is at least that of the deflection sensor's scale.
        (estimating.by_gauge, 2.0, 0.02),
        (lambda found: estimating.by_input_noise(found, found.best.band.data), 0.25, 0.0),
    ],
    ids=["gauge", "input"],
)
def test_another_fit_shows_the_error(
    monkeypatch: pytest.MonkeyPatch, by: Any, factor: float, least: float
):
    """Assert the errors of values by the change of another fit, and none without a reason."""
    found = fitted("a pushed link")[0]
    assert not by(replace(found, input=InputChoice())).size
    values, names = found.fitted.values, found.fitted.names
    changes = np.array([CHANGE.get(name, 0.0) for name in names])
    other = Repeat(values * (1.0 + changes), np.zeros(len(names)))
    monkeypatch.setattr(estimating, "_refit", lambda *_: other)
    own = found.best.band
    gauged = replace(own, data=replace(own.data, relative_to={"link": "motor"}))
    chosen = InputChoice(without_noise=True, left=0.25)
    errors = by(replace(found, best=replace(found.best, band=gauged), input=chosen))[:, 0] / values
    springs = np.isin(names, ("theta2", "alpha1"))
    expected = np.maximum(factor * np.abs(changes), least * springs)
    assert np.abs(errors) == pytest.approx(expected)


def test_a_cable_that_is_fitted_is_no_doubt():
    """Assert no doubt about gravity by a cable with a term of its own."""
    fitted = eccentric(0.0, 0.3)[0]
    wider = replace(fitted.structure, absent=fitted.structure.absent - {"theta_parallel"})
    row = least_squares_start(fitted.structure, fitted.data, suited_rate(fitted))[1].rows[0]
    seen = expanded(wider.with_hold(fitted.problem.timing.hold), fitted)
    assert not estimating.by_cable(seen, row).size


def test_a_smaller_trial_replaces_one_that_diverges(monkeypatch: pytest.MonkeyPatch):
    """Assert that a smaller trial gives nearly the same doubt if the usual one diverges.

    If all diverge, gravity may be wrong by its value. A directly measured deflection has no
    eccentricity that looks like gravity.
    """
    fitted, likely = eccentric(0.0, 0.3)[0], estimating.likely_changes
    usual = estimating.by_eccentricity(fitted)

    def only_small(*rest: Any) -> Any:
        return diverging(rest[0]) if rest[-1] == SHARE else likely(*rest)

    monkeypatch.setattr(estimating, "likely_changes", only_small)
    small = estimating.by_eccentricity(fitted)
    assert np.linalg.norm(small) == pytest.approx(np.linalg.norm(usual), rel=0.1)
    monkeypatch.setattr(estimating, "likely_changes", diverging)
    directions = estimating.by_eccentricity(fitted)
    errors = dict(zip(fitted.names, directions[:, 0].tolist(), strict=True))
    assert {name for name, error in errors.items() if error} == {"theta1"}
    assert errors["theta1"] == pytest.approx(fitted.by_name["theta1"])
    alone = replace(fitted, data=replace(fitted.data, relative_to={"link": "motor"}))
    assert not estimating.by_eccentricity(alone).size


def unended(fitted: Fitted) -> Fitted:
    """Return the fit as one that has not converged."""
    minimum = fitted.minimum
    reduced = replace(minimum.reduced, decrement=minimum.equations.cost)
    return replace(fitted, minimum=replace(minimum, reduced=reduced, last_step=20.0))


def nth_fit(monkeypatch: pytest.MonkeyPatch, which: Collection[int], becomes: Any) -> None:
    """Replace the results of the n-th fits by `becomes` of them; the second has another input."""
    fit, made = Band.fit, []

    def counted(*given: Any, **how: Any) -> Any:
        made.append(fit(*given, **how))
        return becomes(made[-1]) if len(made) in which else made[-1]

    monkeypatch.setattr(Band, "fit", counted)


@pytest.mark.parametrize(
    ("has_fit", "left", "doubt"), [(True, 0.26, 0.0), (True, 0.24, 5.0), (False, 0.26, 5.0)]
)
def test_play_that_the_log_denies_is_no_doubt(
    monkeypatch: pytest.MonkeyPatch, has_fit: bool, left: float, doubt: float
):
    """Assert that likely play is no doubt if its fit is worse, unless least squares is clear."""

    def likely_play(structure: Structure, _: Data) -> gap.LikelyPlay:
        without = structure.without(HARDENING)
        wide = gap.as_wide(replace(without, absent=without.absent - gap.PLAY), 0.02)
        return gap.LikelyPlay(wide, {**PUSHED, "theta_backlash": 3.0}, 5.0, left)

    monkeypatch.setattr(disturbed, "likely_play", likely_play)
    if not has_fit:
        nth_fit(monkeypatch, {3}, diverging)
    case = CASES["a spring that hardens"]
    own = case.structure, case.data
    fit = fit_disturbed(*own, (), (case.hold,), THRESHOLDS, with_shapes=True)
    assert fit.by_play == doubt


def test_unusual_terms_that_are_likely_stay(monkeypatch: pytest.MonkeyPatch):
    """Assert that play stays, since it made the fit likelier, without a test of its value."""
    asked: list[set[str]] = []
    eliminate = disturbed.eliminate

    def recorded(fitted: Fitted, kept: set[str], *rest: Any, **more: Any) -> Any:
        asked.append(kept)
        return eliminate(fitted, kept, *rest, **more)

    monkeypatch.setattr(disturbed, "eliminate", recorded)
    fit = CASES["play of 0.02 rad"].fit()
    assert "alpha_backlash" in fit.fitted.names
    assert {term.name for term in fit.terms if term.kept} >= {"alpha_backlash"}
    assert asked
    assert all("alpha_backlash" in kept for kept in asked)


def test_a_term_whose_fits_do_not_end_is_not_taken(monkeypatch: pytest.MonkeyPatch):
    """Assert that a likelier fit with another term counts only if it has converged."""
    case = CASES["friction that falls"]
    plain = Band(case.data, 4).fit(case.structure, {**COEFFICIENTS, "alpha_coulomb": 3.0})
    asked = STRIBECK, plain, ()
    assert unusual_terms.with_shape(*asked).cost < plain.cost - 100.0
    monkeypatch.setattr(Fitted, "converged", property(lambda _: False))
    assert unusual_terms.with_shape(*asked) is plain


def test_a_fit_whose_steps_do_not_end_is_compared_with_no_other(monkeypatch: pytest.MonkeyPatch):
    """Assert that halves and other bands are fitted only for a converged fit."""
    case, fit = CASES["a pushed link"], fitted("a pushed link")[0]
    made: list[object] = []
    monkeypatch.setattr(estimating, "_refit", lambda *given: made.append(given))
    disturbed_estimate(fit, case.data, is_voltage=False)
    assert made
    ended = len(made)
    disturbed_estimate(
        replace(fit, best=replace(fit.best, fitted=unended(fit.fitted))),
        case.data,
        is_voltage=False,
    )
    assert len(made) == ended


@pytest.mark.parametrize("fails", [False, True])
def test_a_fit_that_explains_little_begins_with_few_terms_too(
    monkeypatch: pytest.MonkeyPatch, fails: bool
):
    """Assert that the likelier of two fits is kept: from all terms, or from the paper's first."""
    usual = fitted("a drive that stops")[0]
    made: list[Structure] = []
    fit = Band.fit

    def first_astray(own: Band, structure: Structure, *given: Any, **how: Any) -> JointInBand:
        made.append(structure)
        found = fit(own, structure, *given, **how)
        if len(made) > 1:
            return diverging(found) if fails and len(made) == 2 else found
        return replace(found, cost=found.cost + 1e4, sizes=replace(found.sizes, disturbances=huge))

    huge = 1e3 * usual.best.sizes.disturbances
    monkeypatch.setattr(Band, "fit", first_astray)
    found = CASES["a drive that stops"].fit()
    assert made[1].absent > made[0].absent
    if fails:
        assert found.full.structure is made[0]
        return
    assert made[2].absent == made[0].absent
    assert found.full.values == pytest.approx(usual.full.values, rel=1e-2)


def less_likely(by: float, *, in_sizes: bool = True) -> Callable[[JointInBand], JointInBand]:
    """Return a function that makes a fit less likely, with tenfold disturbances or innovations."""

    def far_off(fit: JointInBand) -> JointInBand:
        if in_sizes:
            sizes = replace(fit.sizes, disturbances=10.0 * fit.sizes.disturbances)
            return replace(fit, cost=fit.cost + by, sizes=sizes)
        minimum = fit.fitted.minimum
        left = replace(minimum.equations, cost=100.0 * minimum.equations.cost)
        fitted = replace(fit.fitted, minimum=replace(minimum, equations=left))
        return replace(fit, cost=fit.cost + by, fitted=fitted)

    return far_off


# The fit without friction has several minima, so its own likelihood depends on the processor.
@pytest.mark.parametrize(
    ("by", "stays"),
    [({3: 1e5, 4: 1e5}, True), ({3: 1e5, 4: -1e5}, False), ({3: -1e5}, False)],
)
@pytest.mark.parametrize("in_sizes", [True, False])
def test_what_a_balance_cannot_do_without_stays(
    monkeypatch: pytest.MonkeyPatch, in_sizes: bool, by: dict[int, float], stays: bool
):
    """Assert that a friction is kept if the fit without it leaves far more, despite few blocks.

    If leaving out all terms insignificant at 0.005 leaves more, those insignificant at 0.1 may go.
    """
    eliminate = disturbed.eliminate

    def too_much(*asked: Any, **more: Any) -> Any:
        leaner, evidence = eliminate(*asked, **more)
        return leaner.without({"alpha_coulomb"}), evidence

    monkeypatch.setattr(disturbed, "eliminate", too_much)
    changes = iter([less_likely(more, in_sizes=in_sizes) for more in by.values()])
    nth_fit(monkeypatch, by, lambda fit: next(changes)(fit))
    found = CASES["a drive that stops"].fit().fitted
    assert ("alpha_coulomb" in found.names) == stays


@pytest.mark.parametrize("seed", [1, 2])
def test_offsets_stay_where_the_motion_is_one_way(seed: int):
    """Assert the motor's balance of a loaded drive that turns one way, with shifted encoders.

    Neither offset nor dry friction is significant, as each could replace the other.
    """
    recorded = pushed(seed, size=0.3, link_push=1.0, load=3.0)
    recorded = seen(recorded, np.zeros(len(recorded)), np.full(len(recorded), 0.4))
    terms = ("motor_viscous", "motor_coulomb", "link_coulomb", "link_offset", "motor_offset")
    found = among_disturbances(structure(*terms), data(recorded)).fitted.by_name
    for name in ("alpha1", "beta1"):
        assert found[name] == pytest.approx(PUSHED[name], rel=0.01)
    assert found["theta2"] == pytest.approx(PUSHED["theta2"], rel=0.05)
    assert {"theta_offset", "theta_coulomb"} & found.keys()


def test_a_term_without_which_the_motion_runs_away_stays(monkeypatch: pytest.MonkeyPatch):
    """Assert that the fuller fit is kept if the leaner one diverges."""
    nth_fit(monkeypatch, {3}, diverging)
    fit = CASES["a drive that stops"].fit()
    assert fit.fitted is fit.full


def test_where_all_data_lead_nowhere_what_was_found_stands(monkeypatch: pytest.MonkeyPatch):
    """Assert that values from before the held-out end are reported, with a note."""
    monkeypatch.setattr(disturbed, "fit_disturbed_to", diverging)
    found = identify([log(pushed(1, link_push=1.0))], Settings())
    assert found.parameters["joint_stiffness"].verdict == "determined"
    assert any("come from the data before the held-out end" in str(w) for w in found.warnings)


def test_predictions_begin_anyhow_where_an_observer_runs_away(monkeypatch: pytest.MonkeyPatch):
    """Assert that predictions start from fitted states if the observer diverges."""
    fit, own = fitted("a pushed link")[0], CASES["a pushed link"].data
    windows = replace(fit.fitted.problem.segments)
    usual = disturbed.follower(fit, own)
    monkeypatch.setattr(band, "predicting", diverging)
    warm = windows.lengths // 2
    problem = replace(fit.fitted.problem, observer=None)
    motion, states = usual(problem, fit.fitted.values, windows, warm)
    assert motion.observer is None
    _, expected = from_fitted_states(problem, fit.fitted.values, windows, warm)
    assert states == pytest.approx(expected)


def test_fits_to_all_data_that_go_astray_are_made_up_for(monkeypatch: pytest.MonkeyPatch):
    """Assert the fallbacks if the fit to all data, or the one with all terms, fails or is worse."""
    fit, own = fitted("a pushed link")[0], CASES["a pushed link"].data

    def unended_and_unlikely(fit: JointInBand) -> JointInBand:
        return replace(fit, fitted=unended(fit.fitted), cost=fit.cost + 1e4)

    def again(n: int, becomes: Any) -> Disturbed:
        with monkeypatch.context() as patched:
            nth_fit(patched, {n}, becomes)
            return fit_disturbed_to(fit, own)

    likelier = again(1, less_likely(1e4)).best.sizes.disturbances
    assert likelier == pytest.approx(fit.best.sizes.disturbances, rel=0.5)
    leaner_alone = again(2, diverging)
    assert leaner_alone.full is fit.full
    assert leaner_alone.fitted is not fit.fitted
    assert again(2, unended_and_unlikely).full.converged


def test_a_width_that_leads_nowhere_is_not_taken(monkeypatch: pytest.MonkeyPatch):
    """Assert that the width of play is kept if the fit with the width of its gap fails."""
    name = "play of 0.02 rad"
    fit = fitted(name)[0].best
    wide = gap.as_wide(fit.fitted.structure, 0.015)
    begun = fit.band.fit(wide, fit.fitted.by_name, fit.sizes)
    assert not gap.is_dead_zone(begun.fitted)
    nth_fit(monkeypatch, {1}, diverging)
    assert unusual_terms.with_width_of_gap(begun) is begun
