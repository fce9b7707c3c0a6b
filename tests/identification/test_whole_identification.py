"""Complete identifications, from logs of an independent simulator to intervals and choices."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_joint import (
    COEFFICIENTS,
    CORE,
    SAMPLE_TIME,
    TRUTH,
    assert_holds,
    diverging,
    log,
    made,
    made_fit,
    recording,
)

import flexid.identification.estimation.answers as answers
import flexid.identification.identify as identify_module
from flexid.errors import ConvergenceError
from flexid.estimators.budget import BudgetError
from flexid.identification.estimation.final_fits import FinalFits
from flexid.identification.estimation.inputs import answer_with_amplifier
from flexid.identification.full_model.fits_by_length import FitsByLength, nearly_explains
from flexid.identification.identify import identify
from flexid.identification.preparation.recordings import IDEAL
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import interval
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.frame import table_of_arrays
from flexid.recording.read import log_of_table
from flexid.recording.table import Table
from flexid.simulation.free_run import free_run

TERMS = ("gravity", "motor_viscous")
SETTINGS = Settings(terms=TERMS, input_delay=0.0, link_delay=0.0, segment_duration=1.0)


def assert_true(result, truth, accuracy=1e-3):
    """Assert the coefficients' names, and their values within a relative accuracy."""
    assert set(result.coefficients) == set(truth)
    for name, true in truth.items():
        assert result.coefficients[name].value == pytest.approx(true, rel=accuracy), name


@pytest.fixture(scope="module")
def clean():
    """Return one log of the paper's joint."""
    return log(made(1))


@pytest.fixture(scope="module")
def alone(clean):
    """Return the result of that log with given terms and no prior knowledge."""
    return identify([clean], SETTINGS)


def test_a_log_that_tells_everything(alone):
    """Assert that given choices are kept, values determined and right, and only noise is left."""
    assert alone.choices.terms == TERMS
    assert alone.choices.segment_duration == pytest.approx(1.0, rel=0.1)
    assert alone.choices.alignment.input_delay.status == "given"
    assert_true(alone, COEFFICIENTS)

    assert {c.verdict for c in alone.coefficients.values()} == {"determined"}
    assert {p.verdict for p in alone.parameters.values()} == {"determined"}
    assert alone.warnings == ()
    assert alone.compliance.visible

    assert set(alone.parameters) == set(TRUTH)
    assert all(fit > 99.9 for fit in alone.validation.fit_percent.values())
    assert list(alone.validation.horizons) == [0.05, 0.2, 1.0]
    assert alone.validation.runs[0].time[0] == pytest.approx(10.0 * 2 / 3, abs=0.01)

    assert list(alone.residual_excess.values()) == pytest.approx([1.0, 1.0], abs=0.1)
    assert alone.model_error.share == 0.0


def test_rest_before_a_motion_changes_nothing(clean):
    """Assert that long rest before a motion changes hardly anything, though the torque jumps."""
    (moving,) = clean.recordings
    count = 4 * len(moving)
    quiet = 1e-5 * np.random.default_rng(5).standard_normal((2, count))
    channels = (moving.link_position, moving.motor_position, moving.input)
    before = (*quiet, np.zeros(count))
    whole = [np.concatenate(pair) for pair in zip(before, channels, strict=True)]
    times = moving.time[0] + SAMPLE_TIME * np.arange(-count, len(moving))
    result = identify([log(recording(times, *whole))], SETTINGS)
    assert_true(result, COEFFICIENTS)
    assert all(own.std < 1e-3 * own.value for own in result.coefficients.values())
    (said,) = (warning for warning in result.warnings if "nothing moves" in warning)
    assert "nothing moves long before" in said
    assert "after" not in said  # the motion lasts to the end
    assert sum(map(len, result.recordings)) < 1.2 * len(moving)


def test_a_brake_at_both_ends_is_left_out(clean):
    """Assert true values if a brake holds the motor before and after a motion, with torque on."""
    (moving,) = clean.recordings
    count = len(moving) // 3
    noise = 1e-5 * np.random.default_rng(6).standard_normal((2, count))
    torque = moving.input
    link, motor = (
        np.concatenate((own[0] + before, own, own[-1] + before))
        for own, before in zip((moving.link_position, moving.motor_position), noise, strict=True)
    )
    whole = (link, motor, np.concatenate((torque[-count:], torque, torque[:count])))
    times = moving.time[0] + SAMPLE_TIME * np.arange(-count, len(moving) + count)
    result = identify([log(recording(times, *whole))], SETTINGS)
    assert_true(result, COEFFICIENTS, 2e-3)
    (said,) = (warning for warning in result.warnings if "a brake or a stop held it" in warning)
    assert re.search(r"rests before \S+ s and after \S+ s though the input acts", said)


def test_a_step_one_way_leaves_room_for_friction():
    """Assert that one-way motion may hide friction, which widens parameters, but not the ratio."""
    acts: dict[str, Any] = {"gravity_torque": 0.0, "motor_inertia": 0.5, "joint_damping": 0.3}
    acts |= {"motor_viscous": 0.8, "motor_coulomb_up": 1.0, "motor_coulomb_down": 1.0}
    acts |= {"torque": lambda at: np.where(at >= 0.2, 5.0, 0.0), "held": True}
    result = identify([log(made(4, 3.0, noise=1e-4, **acts))])
    for name, true in (("link_inertia", 1.0), ("joint_stiffness", 100.0)):
        found = result.parameters[name]
        assert found.interval[0] < true < found.interval[1]
        assert found.verdict != "determined"
    spring = result.coefficients["theta2"]
    assert spring.value == pytest.approx(100.0, rel=0.01)
    assert spring.verdict == "determined"
    assert any("turns one way under a constant input" in warning for warning in result.warnings)


def test_a_delay_that_is_none_is_as_doubtful_as_the_rest(fits_seen: list[FinalFits]):
    """Assert that the interval of an absent delay includes the model error."""
    # With a given segment duration the exact fit is reported.
    settings = Settings(terms=TERMS, segment_duration=0.5)
    result = identify([log(made(1, ripple_torque=0.5, ripple_number=10.0))], settings)
    (fits,) = fits_seen
    assert result.choices.amplifier == IDEAL
    assert fits.error.share > 0.5
    delay = result.choices.alignment.link_delay
    assert delay.status == "none"
    place = fits.full.names.index("link_delay")
    bare = interval(0.0, fits.full.fit.deviations[place], 20.0)
    assert delay.interval[1] - delay.interval[0] > 1.5 * (bare[1] - bare[0])
    # A fit that diverges may ask for any delay, even a longer one than the log.
    reported = fits.reported
    about = {"structure": reported.structure, "data": reported.data, "at_bound": {}}
    far = SimpleNamespace(**about, delays={"input_delay": 1e9})
    assert replace(fits, reported=cast(Any, far)).squares.names == fits.squares.names


def test_what_is_known_shifts_and_bounds(clean, alone):
    """Assert that a prior one deviation away shifts the stiffness halfway, and a bound is met."""
    theta2, alpha2 = (alone.coefficients[name] for name in ("theta2", "alpha2"))
    known, least = theta2.value + theta2.std, alpha2.value + alpha2.std
    settings = replace(SETTINGS, known={"theta2": known}, known_deviations={"theta2": theta2.std})
    after = identify([clean], settings).coefficients["theta2"]
    assert after.value == pytest.approx(theta2.value + theta2.std / 2, abs=0.05 * theta2.std)
    assert after.std < 0.9 * theta2.std
    bounded = identify([clean], replace(SETTINGS, bounds={"alpha2": (least, 2.0)}))
    alpha2 = bounded.coefficients["alpha2"]
    assert (alpha2.value, alpha2.std, alpha2.reason) == (least, 0.0, "at its bound")


STIFF = made(1, 2.0, joint_stiffness=1e6)  # the encoders hardly show its deflection


def test_a_joint_too_stiff_for_its_log_is_taken_as_rigid():
    """Assert that motor and link together are determined if a flexible joint is not."""
    stiff = log(STIFF)
    result = identify([stiff])
    assert result.model == "rigid"
    assert any("the drive was taken as rigid" in warning for warning in result.warnings)
    assert result.parameters["inertia"].value == pytest.approx(1.3, rel=1e-3)
    assert result.parameters["gravity_torque"].value == pytest.approx(5.0, rel=1e-3)
    assert {value.verdict for value in result.parameters.values()} == {"determined"}
    assert result.provenance["settings"]["model"] == "auto"


def watched(monkeypatch: pytest.MonkeyPatch, failing: str = "") -> list[str]:
    """Return the kinds of joint that later identifications fit; fits of `failing` diverge."""
    kinds: list[str] = []

    def answer(job: Any) -> Any:
        kinds.append(job.joint.kind)
        return diverging() if kinds[-1] == failing else answer_with_amplifier(job)

    monkeypatch.setattr(identify_module, "answer_with_amplifier", answer)
    return kinds


def test_a_rigid_fit_that_fails_loses_nothing(monkeypatch):
    """Assert that a flexible joint of which nothing is determined is reported if the rest fails."""
    watched(monkeypatch, failing="rigid")
    monkeypatch.setattr(identify_module, "_verdicts", lambda _: {"undetermined"})
    assert identify([log(made(1, 3.0))]).model == "flexible"


def test_a_drive_without_deflection_is_identified_once(monkeypatch):
    """Assert that noise between both encoders leads to one rigid fit with one warning."""
    kinds = watched(monkeypatch)
    monkeypatch.setattr(identify_module, "_verdicts", lambda _: {"undetermined"})
    result = identify([log(made(1, 3.0, joint_stiffness=1e6, noise=1e-4))])
    assert kinds == ["rigid"]
    assert sum("taken as rigid" in warning for warning in result.warnings) == 1


@pytest.mark.parametrize(
    ("asked", "rigid"),
    [
        (Settings(), True),
        (Settings(model="flexible"), False),
        (Settings(terms=TERMS), False),
        (Settings(known={"motor_inertia": 0.3}), False),
        (Settings(bounds={"joint_stiffness": (0.0, 1e7)}), False),
    ],
)
def test_a_joint_that_cannot_be_fitted_is_rigid_unless_something_is_asked(
    monkeypatch, asked, rigid
):
    """Assert that a rigid joint is fitted if the flexible one fails and the user asked nothing."""
    watched(monkeypatch, failing="flexible")
    if rigid:
        assert identify([log(STIFF)], asked).model == "rigid"
        return
    with pytest.raises(ConvergenceError, match="the motion diverges"):
        identify([log(STIFF)], asked)


@pytest.mark.parametrize(("steps", "disturbed"), [(1.8e5, False), (1e4, True)])
def test_a_search_beyond_its_budget_uses_a_part_or_allows_for_disturbances(
    monkeypatch, clean, steps, disturbed
):
    """Assert that a search that takes too long ends with determined values all the same."""
    monkeypatch.setattr(answers, "_MOST_STEPS", steps)
    result = identify([clean])
    assert (result.disturbances is not None) == disturbed
    assert_holds(result, CORE, verdict="determined")


@pytest.mark.parametrize(("duration", "nearly"), [(0.8, True), (0.5, True), (0.3, False)])
def test_a_remainder_counts_over_half_a_second(duration: float, nearly: bool):
    """Assert that what short segments leave is scaled up, and what long ones leave is not."""
    fit = made_fit(30.0, duration=duration, unexplained=0.004)
    assert nearly_explains(fit, THRESHOLDS) == nearly


@pytest.mark.parametrize("seconds", [9.0, 4.0])
def test_a_long_log_is_searched_in_part(monkeypatch, seconds):
    """Assert that long pieces of two logs with their own offsets lead to an exact fit."""
    search, searched = answers.predicting, []

    def in_part_alone(job: Any) -> Any:
        searched.append(job.in_part)
        if not job.in_part:
            raise BudgetError(1.0)
        return search(job)

    monkeypatch.setattr(answers, "predicting", in_part_alone)
    offsets = {"[1]": 0.5, "[2]": -0.5}
    logs = [made(n, seconds, motor_offset=size) for n, size in enumerate(offsets.values(), 1)]
    found = identify([log(own) for own in logs])
    is_long = seconds > 5.0
    assert (found.disturbances is None) == is_long
    assert searched == [False, True][: 1 + is_long]
    for name, size in offsets.items():
        estimate = found.parameters[f"motor_offset_torque{name}"]
        assert estimate.value == pytest.approx(size, rel=1e-3 if is_long else 0.1)


@pytest.mark.parametrize(
    ("excess", "duration", "longest", "unexplained", "later", "disturbed", "is_exact"),
    [
        (1.05, 0.6, 5.0, 0.02, 1.0, 0.01, True),  # long segments
        (1.05, 0.1, 0.1, 0.02, 1.0, 0.01, True),  # there are no longer ones
        (1.05, 0.1, 5.0, 0.0009, 1.0, 0.01, True),  # the remainder stays small
        (1.01, 0.1, 5.0, 0.006, 1.0, 0.01, True),  # it is chance
        (1.05, 0.1, 5.0, 0.006, 1.0, 0.09, False),
        (1.05, 0.1, 5.0, 0.006, 1.0, 0.11, True),  # disturbances hide the core
        (1.2, 0.1, 5.0, 0.02, 1.0, 0.11, False),  # more than noise
        # Longer segments contradict it.
        (0.9, 0.1, 5.0, 0.0, 6.0, 0.09, False),
        (0.9, 0.1, 5.0, 0.0, 6.0, 0.11, True),
        (0.9, 0.6, 5.0, 0.0, 6.0, 0.09, True),
    ],
)
def test_a_fit_of_short_segments_gives_way_to_disturbances(
    monkeypatch, excess, duration, longest, unexplained, later, disturbed, is_exact
):
    """Assert which fit is reported, by what is left over half a second and the core's width."""
    about = {"unexplained": unexplained, "at_bound": {}, "converged": True}
    reported = made_fit(excess, duration=duration, **about)
    reported.problem.degrees_of_freedom = 20_000
    division = SimpleNamespace(mean_duration=longest)
    by_length = FitsByLength((), cast(Any, (division,)), True, (), "")
    choice = SimpleNamespace(by_length=by_length)
    longer = made_fit(later, duration=4.0 * duration, **{**about, "unexplained": 0.1})
    both = {"reported": reported, "lengths_fitted": [reported, longer]}
    fits = cast(Any, SimpleNamespace(choice=choice, **both))
    exact, other = (answers.Answer(fits, cast(Any, None), cast(Any, None)) for _ in range(2))
    job = SimpleNamespace(exact=False, thresholds=THRESHOLDS, whole=None)
    for name, result in (
        ("_searched", (None, None)),
        ("_exact_fits", fits),
        ("_exact", exact),
        ("delay_doubts", ()),
        ("_disturbed", other),
    ):
        monkeypatch.setattr(answers, name, lambda *_, result=result, **__: result)
    monkeypatch.setattr(answers, "_core_width", lambda found: disturbed if found is other else 0.1)
    assert answers.answer(cast(Any, job)) is (exact if is_exact else other)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"bounds": {"alpha2": (1.0, 2.0)}}, "alpha2 is bounded by 1, which contradicts the log"),
        ({"known": {"motor_inertia": 0.6}}, "is known as 0.6.*the log alone gives 0.3 ±"),
        (
            {"known": {"motor_inertia": 0.4}, "known_deviations": {"motor_inertia": 0.001}},
            "motor_inertia is known as 0.4 ± 0.001",
        ),
    ],
)
def test_what_the_log_contradicts_is_told(clean, given, words):
    """Assert a warning of the contradiction, and no determined value if an exact value is given."""
    found = identify([clean], replace(SETTINGS, **given))
    assert any(re.search(words, warning) for warning in found.warnings)
    if "known_deviations" not in given:
        assert {c.verdict for c in found.coefficients.values()} == {"undetermined"}
        assert "determined" not in {p.verdict for p in found.parameters.values()}


def test_thresholds_and_long_segments(clean, alone):
    """Assert that thresholds change verdicts only, and that a segment is no longer than the log."""
    strict = replace(THRESHOLDS, determined_width=1e-12, negligible_share=0.0)
    given = replace(SETTINGS, segment_duration=60.0)
    result = identify([clean], given, thresholds=strict)
    assert {c.verdict for c in result.coefficients.values()} == {"weak"}
    assert_true(result, {name: c.value for name, c in alone.coefficients.items()}, 1e-5)
    assert result.choices.segment_duration is not None
    assert 5.0 < result.choices.segment_duration <= 10.0


@pytest.mark.parametrize(
    ("torque", "more", "widest"),
    [
        (lambda at: 2.0 * at, {"duration": 6.0}, 1e-3),
        (
            lambda at: np.where(at > 0.5, 5.0, 0.0),
            {"duration": 5.0, "held": True, "gravity_torque": 10.0},
            0.25,
        ),
    ],
    ids=["a ramp that turns it over", "a step from rest"],
)
def test_what_a_log_leaves_open_is_left_out(torque, more, widest):
    """Assert that offsets which the log leaves open are removed, and other values stay known.

    The minimum of the quadratic form may have no fit, or the limit of stiction may look exact.
    """
    dry = {"motor_coulomb_up": 0.3, "motor_coulomb_down": 0.3}
    result = identify([log(made(1, torque=torque, noise=1e-4, **dry, **more))])
    assert {*result.parameters} - {"total_inertia"} == {*TRUTH, "motor_coulomb_friction"}
    assert_holds(result, CORE, 2.0 * widest)


def motion(coefficients, size, highest):
    """Return times, torque and states of a joint driven by nine tones up to `highest` Hz."""
    times = SAMPLE_TIME * np.arange(3000)
    tones = 2.0 * np.pi * np.geomspace(0.2, highest, 9)
    torque = size * np.sin(np.outer(times, tones) + tones).sum(axis=1)
    states = free_run(flexible_joint(), coefficients, np.zeros(4), torque[:, None], SAMPLE_TIME)
    return times, torque, states


@pytest.mark.parametrize("position", ["motor_position", ""], ids=["a link's", "both"])
def test_speeds_will_do_where_no_position_was_measured(position):
    """Assert that a drive is identified from logged velocities with a resolution of 1 mrad/s."""
    times, torque, states = motion({**COEFFICIENTS, "theta1": 0.0}, 4.0, 4.0)
    channels = {"time": times, "motor_torque": torque, "motor_position": states[:, 2]}
    channels |= {f"{n}_velocity": states[:, k].round(3) for n, k in (("link", 1), ("motor", 3))}
    if not position:
        del channels["motor_position"]
    result = identify([log_of_table(table_of_arrays(channels))])
    assert any("was integrated" in warning for warning in result.warnings)
    assert_holds(result, CORE, 0.02)


HELD = {**COEFFICIENTS, "theta1": 0.0, "theta2": 0.0}


def driven(coefficients, size):
    """Return the channels of two encoders."""
    times, torque, states = motion(coefficients, size, 6.0)
    noise = 1e-5 * np.random.default_rng(3).standard_normal(len(times))
    motor, link = states[:, 2] + noise, states[:, 0] + np.any(states[:, 0]) * noise[::-1]
    return {"time": times, "motor_torque": torque, "motor_position": motor, "link_position": link}


def clamped(stiffer: float) -> Table:
    """Return a motor's log in front of a clamped link, with a stiffer spring."""
    channels = driven({**HELD, "alpha1": stiffer * HELD["alpha1"]}, 1.0)
    del channels["link_position"]
    return table_of_arrays(channels)


def test_a_clamped_link_leaves_the_motor_and_the_spring():
    """Assert that a clamped link leaves motor and spring known, and has no inertia itself."""
    result = identify([log_of_table(clamped(1.0), {"link_position": 0.0})])
    assert not any("held-out" in warning for warning in result.warnings)
    known = ("motor_inertia", "joint_stiffness", "motor_viscous_friction")
    assert_holds(result, {name: TRUTH[name] for name in known}, 2e-3)
    assert "link_inertia" not in {*result.parameters, *result.removed}
    assert result.coefficients["theta2"].interval == (0.0, 0.0)
    assert {*result.fit.names} == {"alpha1", "alpha2", "beta1"}
    assert result.supports()


def test_a_swing_before_a_clamped_motor_shows_its_friction():
    """Assert that a link that swings freely is known over its inertia, with friction.

    Damping of the spring acts like friction, and a delay shifts the time: they are not sought.
    """
    values = {"theta2": 75.0, "theta_viscous": 0.22}
    system = flexible_joint(("link_viscous",))
    held = dict.fromkeys(system.coefficients, 0.0) | values
    states = free_run(system, held, np.array([0.6, 0.0, 0.0, 0.0]), np.zeros((7500, 1)), 2e-3)
    channels = {"time": 2e-3 * np.arange(7500), "link_position": states[:, 0].round(4)}
    log = log_of_table(table_of_arrays(channels), {"motor_position": 0.0})
    result = identify([log])
    names = ("joint_stiffness_per_link_inertia", "viscous_friction_per_link_inertia")
    assert_holds(result, dict(zip(names, values.values(), strict=True)), 1e-3)
    assert {*result.fit.names} == {*values}


@pytest.mark.parametrize("is_one_log", [True, False], ids=["one log", "two logs"])
def test_a_link_that_is_clamped_at_first_has_an_inertia(is_one_log):
    """Assert that a recording with a clamped link leaves the link of the next one sought."""
    free = driven(COEFFICIENTS, 3.0)
    if is_one_log:  # with a pause
        held = driven(HELD, 1.0)
        free["time"] += held["time"][-1] + 1.0
        both = {name: np.concatenate((held[name], free[name])) for name in held}
        logs = [log_of_table(table_of_arrays(both))]
    else:
        logs = [log_of_table(clamped(1.0), {"link_position": 0.0})]
        logs += [log_of_table(table_of_arrays(free))]
    result = identify(logs)
    assert_holds(result, {"link_inertia": TRUTH["link_inertia"]})
    assert result.coefficients["theta2"].reason != "given"
    assert "link_position" in result.validation.fit_percent


def test_the_spring_of_a_clamped_link_is_not_called_gravity():
    """Assert that a strong pull over a small angle is undetermined, and the inertia is not."""
    result = identify([log_of_table(clamped(3.0))])
    assert result.parameters["gravity_torque"].verdict == "undetermined"
    assert "write link_position = 0" in result.parameters["gravity_torque"].reason
    assert result.parameters["inertia"].verdict == "determined"
