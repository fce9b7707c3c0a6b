"""Settings, preparation of logs into recordings with held-out ends, and terms of the joints."""

from dataclasses import replace
from functools import partial
from math import inf, nan
from typing import Any

import numpy as np
import pytest
from tests.estimators.noisy_joint import late_motion

from flexid.estimators.samples import Samples
from flexid.identification.preparation.joint import Kind, flexible, joint_of, rigid
from flexid.identification.preparation.recordings import (
    Alignment,
    Delay,
    SplitRecordings,
    aligned,
    prepare,
)
from flexid.identification.preparation.settings import Settings, check_against, check_for
from flexid.models.flexible_joint import BACKLASH_WIDTH
from flexid.recording.recording import Log, Recording
from flexid.recording.sampling import FEWEST_TO_IDENTIFY

WHERE = {
    "anywhere": lambda _: None,
    "a flexible joint": lambda settings: check_for(flexible(), settings),
    "a rigid joint": lambda settings: check_for(rigid(), settings),
    "a link alone": lambda settings: check_for(joint_of("link"), settings),
    "a slide": lambda settings: check_for(joint_of("flexible", "prismatic"), settings),
    "20 s at 1 kHz": lambda settings: check_against(settings, 1e-3, 20.0),
}
REFUSED: dict[str, list[dict[str, Any]]] = {
    "anywhere": [
        {"model": "elastic"},
        {"terms": ("gravity", "turbulence")},
        {"known": {"stiffness": 3.0}},
        {"known": {"motor_inertia": 0.0}},
        {"known": {"motor_inertia": 1e-320}},
        {"known": {"theta2": nan}},
        {"known": {"joint_stiffness": 1e200}},
        {"known": {"beta1": 0.0}},
        {"known": {"joint_stiffness": 0.0}},
        {"known": {"theta2": 1.0}, "known_deviations": {"theta2": -1.0}},
        {"known": {"theta2": 1.0}, "known_deviations": {"theta2": 1e200}},
        {"bounds": {"alpha2": (1e308, inf)}},
        {"bounds": {"link_inertia": (-2.0, -1.0)}},
        {"bounds": {"stiffness": (0.0, 1.0)}},
        {"bounds": {"alpha2": (2.0, 1.0)}},
        {"bounds": {"alpha2": (nan, 1.0)}},
        {"hold": "first"},
        {"coulomb_velocity": 0.0},
        {"coulomb_velocity": 1e-300},
        {"coulomb_velocity": 101.0},
        {"filter_rate": -3.0},
        {"segment_duration": inf},
        {"segment_duration": "long"},
        {"input_delay": inf},
        {"link_delay": nan},
        {"validation_share": 0.0},
        {"validation_share": 0.9},
    ],
    "a flexible joint": [
        {"terms": ("viscous",)},
    ],
    "a rigid joint": [
        {"terms": ("motor_viscous",)},
        {"known": {"motor_inertia": 0.3}},
    ],
    "a link alone": [
        {"hold": "zero"},
        {"input_delay": 1e-3},
        {"terms": ("motor_viscous",)},
    ],
    "a slide": [
        {"terms": ("gravity",)},
    ],
    "20 s at 1 kHz": [
        {"segment_duration": 1e-9},
        {"filter_rate": 501.0},
        {"input_delay": 5.0},
        {"link_delay": -1e3},
    ],
}


def test_what_a_log_can_show_is_taken():
    """Assert that settings at the limits of a log's samples are accepted."""
    usable = Settings(segment_duration=30.0, filter_rate=499.0, input_delay=2.0, link_delay=-2.0)
    check_against(usable, 1e-3, 20.0)
    assert usable.given_delay == 2.0
    assert Settings().given_delay == 0.0


SHARE = 1 / 3


def recording(n=300, *, unit="N m", link=True, start=0.0, seed=0, source="a.csv"):
    """Noise in every channel, sampled at 100 Hz."""
    link_position, motor, drive = np.random.default_rng(seed).standard_normal((3, n))
    link_position, drive = link_position if link else None, drive if unit else None
    return Recording(0.01, start, link_position, motor, drive, unit, source=source)


def log(*recordings, digest=""):
    """Return a log of some recordings."""
    return Log(recordings, (), recordings[0].source, digest)


def lacking(channel: str) -> Log:
    """Return a log without its input, or without the link's position."""
    return log(recording(unit="") if channel == "input" else recording(link=False))


LACKING: list[tuple[str, Kind]] = [
    *(("input", "flexible"), ("input", "rigid")),
    *(("link position", "flexible"), ("link position", "link")),
]
TOGETHER: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "the same bytes": ({}, {"seed": 1}, "abc"),
    "another input": ({}, {"unit": "V"}, ""),
    "an input, and none": ({}, {"unit": ""}, ""),
    "one encoder, and two": ({"link": False}, {}, ""),
    "two encoders, and one": ({}, {"link": False}, ""),
}


def test_what_has_no_meaning(refusals):
    """Assert that settings without effect, and logs that do not suit the model, are refused."""
    calls: dict[str, Any] = {
        f"{where}, {settings}": lambda asked=WHERE[where], of=settings: asked(Settings(**of))
        for where in WHERE
        for settings in REFUSED[where]
    }
    for channel, model in LACKING:
        calls[f"{model} without {channel}"] = partial(prepare, [lacking(channel)], SHARE, model)
    for name, (first, second, digest) in TOGETHER.items():
        each = {"a.csv": first, "b.csv": second}.items()
        logs = [log(recording(source=source, **own), digest=digest) for source, own in each]
        calls[f"two logs, {name}"] = partial(prepare, logs, SHARE)
    calls["too short"] = partial(prepare, [log(recording(FEWEST_TO_IDENTIFY - 1))], SHARE)
    calls["fewer than ten samples to test on"] = partial(prepare, [log(recording(300))], 0.01)
    refusals(calls)
    prepare([log(recording(FEWEST_TO_IDENTIFY))], SHARE)


def test_end_of_every_recording_is_held_out():
    """Assert that the last third of each recording is held out, and logs form groups."""
    recordings, warnings = prepare(
        [log(recording(300), recording(600, start=9.0)), log(recording(900))], SHARE
    )
    assert recordings.starts == (200, 400, 600)
    assert recordings.groups == (0, 0, 1)
    assert warnings == ()
    searched, groups = recordings.searched
    assert [len(part) for part in searched] == [200, 400, 600]
    assert groups == (0, 0, 1)


def test_a_long_log_is_searched_in_windows():
    """Assert three windows of 10 000 samples or 3 s, spread over the data that are fitted."""
    short = recording(6000)
    swing = np.sin(0.5 * np.arange(120_000))  # its velocity is estimated with a short window
    long = replace(recording(120_000, start=4.0), link_position=swing, motor_position=0.9 * swing)
    split, _ = prepare([log(long), log(short)], SHARE)
    searched, groups = split.searched
    assert sum(map(len, searched)) == pytest.approx(30_000, rel=1e-3)
    assert groups == (0, 0, 0, 1)
    first, *_, last, _ = searched
    step = long.sample_time
    assert first.start_time == pytest.approx(4.0)
    assert last.start_time + step * len(last) == pytest.approx(4.0 + step * 80_000)
    fast = replace(long, sample_time=2e-4)
    (own, _) = prepare([log(fast)], SHARE)[0].searched
    assert [len(part) for part in own] == pytest.approx([15_000] * 3, rel=1e-3)
    assert sum(map(len, split.whole)) == 126_000


def test_short_recordings_cost_one_warning_for_a_log():
    """Assert that recordings too short to fit are omitted and counted, if others suffice."""
    short = [recording(40, start=float(n)) for n in range(9)]
    first, second = log(recording(300), *short), log(recording(300, source="b.csv"), short[0])
    recordings, warnings = prepare([first, second], SHARE)
    assert len(recordings.recorded) == len(warnings) == 2
    assert "the 40 samples from 2 s on and 6 more recordings are too few" in warnings[0]
    assert "40 samples from 0 s on are too few" in warnings[1]


def test_the_shortest_recordings_of_a_log_are_left_out():
    """Assert that each log omits its shortest recordings, up to 3 % of its samples."""
    parts = [recording(count) for count in (100, 4000, 85, 135, 6000)]
    split, (warning,) = prepare([log(*parts), log(recording(90))], SHARE)
    assert [len(own) for own in split.recorded] == [4000, 135, 6000, 90]
    assert "the 100 samples" in warning
    assert "the 85 samples" in warning


def test_fitted_velocities_do_not_know_of_held_out_positions():
    """Assert that held-out positions do not affect velocities before them."""
    known, late = recording(300), np.arange(300) >= 200
    link = np.where(late, 50.0, known.needed_link_position)
    motor = np.where(late, -50.0, known.motor_position)
    spoilt = replace(known, link_position=link, motor_position=motor)
    one, other = (
        SplitRecordings((recording,), (200,), (0,)).searched[0][0] for recording in (known, spoilt)
    )
    np.testing.assert_array_equal(one.link_velocity, other.link_velocity)
    np.testing.assert_array_equal(one.motor_velocity, other.motor_velocity)


SAMPLE_TIME = 2e-3


def late_log(link_delay=0.0, input_delay=0.0, by_deflection=False):
    """Return six seconds with a delayed torque and a delayed link encoder or deflection."""
    at = 0.1 + SAMPLE_TIME * np.arange(3000)
    late = late_motion(at, input_delay, link_delay, by_deflection)
    whole = Recording(SAMPLE_TIME, float(at[0]), *late, "N m")
    return replace(whole, link_from_deflection=by_deflection)


def delays(input_delay=0.0, link_delay=0.0):
    """Return an alignment with these delays."""
    input_, link = (Delay(d, 0.0, (d, d), "given") for d in (input_delay, link_delay))
    return Alignment("linear", input_, link, "")


@pytest.mark.parametrize("by_deflection", [False, True])
@pytest.mark.parametrize(("link_delay", "input_delay"), [(1.3e-3, 0.7e-3), (-3.1e-3, -4.4e-3)])
def test_aligned_log_is_in_time(link_delay, input_delay, by_deflection):
    """Assert that the aligned recording equals the log without delays."""
    recording = late_log(link_delay, input_delay, by_deflection)
    moved = aligned(recording, delays(input_delay, link_delay))
    in_time = late_log()
    first = round((moved.start_time - in_time.start_time) / SAMPLE_TIME)
    right = in_time.window(first, first + len(moved))
    assert len(moved) > len(recording) - 40
    assert moved.motor_position == pytest.approx(right.motor_position, abs=1e-12)
    assert moved.link_position == pytest.approx(right.link_position, abs=1e-7)
    assert moved.input == pytest.approx(right.input, abs=1e-3)


@pytest.mark.parametrize("encoders", [1, 2])
def test_input_late_by_samples_keeps_its_values(encoders):
    """Assert that a delay of three samples shifts the torque with the same bits."""
    recording = late_log() if encoders == 2 else replace(late_log(), link_position=None)
    assert aligned(recording, delays()) is recording
    moved = aligned(recording, delays(input_delay=3 * SAMPLE_TIME))
    assert moved.start_time == pytest.approx(recording.start_time + 3 * SAMPLE_TIME)
    np.testing.assert_array_equal(moved.needed_input, recording.needed_input[:-3])
    assert (moved.link_position is None) == (encoders == 1)


def test_velocities_move_with_their_positions():
    """Assert that a logged link velocity is shifted together with the link's position."""
    recording = late_log(link_delay=1e-3)
    speed = np.gradient(recording.needed_link_position, SAMPLE_TIME)
    moved = aligned(replace(recording, link_velocity=speed), delays(link_delay=1e-3))
    derived = np.gradient(moved.needed_link_position, SAMPLE_TIME)
    assert moved.link_velocity is not None
    assert moved.link_velocity[5:-5] == pytest.approx(derived[5:-5], abs=1e-4)


FLEXIBLE = flexible()


ALWAYS = {"flexible": ["theta2", "alpha1", "beta1"], "rigid": ["beta1"], "link": ["theta2"]}


@pytest.mark.parametrize("kind", ALWAYS)
def test_terms_and_what_is_always_there_make_the_system(kind):
    """Assert that each coefficient belongs to one term, to the spring or to the input's gain."""
    joint = joint_of(kind)
    of_terms = [c for names in joint.terms.values() for c in names]
    assert sorted([*of_terms, *ALWAYS[kind]]) == sorted(joint.systems[2].coefficients)
    assert joint.systems[0].inputs == (("x3", "x4") if kind == "link" else ("u",))
    assert any(name.startswith("alpha") for name in joint.units) == (kind == "flexible")


@pytest.mark.parametrize("term", ["joint_damping", "cubic_stiffness", "backlash", "eccentricity"])
def test_what_the_spring_does_to_both_sides_is_one_number(term):
    """Assert that link coefficients of the spring are theta2/alpha1 = 0.3 times the motor's."""
    found = FLEXIBLE.unknowns(FLEXIBLE.optional - {*FLEXIBLE.terms[term]}, {}, groups=(0,))
    known = {"theta2": 90.0, "alpha1": 300.0, "beta1": 1.0}
    values = [known.get(name, 2.0) for name in found.names]
    link = [c for c in FLEXIBLE.terms[term] if c.startswith("theta")]
    assert not {*link} & {*found.names}
    every = dict(zip(found.system.coefficients, found.coefficients(values, 0), strict=True))
    assert [every[c] for c in link] == pytest.approx([0.6] * len(link))


def moving(size: float) -> Samples:
    """Return a motion of this size, with a deflection of a tenth."""
    time = 0.01 * np.arange(1000)
    motor, twist = size * np.sin(time), 0.1 * size * np.sin(3.0 * time)
    speeds = np.column_stack((size * np.cos(time) + 0.3 * size * np.cos(3.0 * time),) * 2)
    speeds[:, 1] = size * np.cos(time)
    return Samples(np.column_stack((motor + twist, motor)), speeds, np.zeros((1000, 1)), 0.01)


def test_shapes_scale_with_the_motion():
    """Assert that widths are proportional to the motion, and need no other kernel."""
    one, two = (FLEXIBLE.scaled([moving(size)]) for size in (1.0, 2.0))
    assert one.first["hysteresis_grip"] == pytest.approx(2.0 * two.first["hysteresis_grip"])
    width, smoothing = (
        [systems(joint).constants[name] for joint in (one, two)]
        for systems, name in (
            (lambda joint: joint.systems[1], BACKLASH_WIDTH),
            (lambda joint: joint.smooth, "coulomb_velocity"),
        )
    )
    assert 0.0 < 2.0 * width[0] == pytest.approx(width[1])
    assert 2.0 * smoothing[0] == pytest.approx(smoothing[1])
    assert two.systems[1].digest == FLEXIBLE.systems[1].digest
    samples = moving(1.0)
    assert samples.velocities is not None
    motor = replace(
        samples, positions=samples.positions[:, 1:], velocities=samples.velocities[:, 1:]
    )
    rigid_smoothing = rigid().scaled([motor]).smooth.constants["coulomb_velocity"]
    assert rigid_smoothing == pytest.approx(0.1 / 2**0.5, rel=0.05)


def test_given_smoothing_takes_the_place_of_dry_friction():
    """Assert that a Coulomb velocity makes friction smooth in every system, without shapes."""
    joint = FLEXIBLE.with_coulomb_velocity(0.01)
    assert {*map(id, (*joint.systems, *joint.smoothed))} == {id(joint.smooth)}
    assert joint.smooth.constants["coulomb_velocity"] == 0.01
    assert joint.smooth.digest == FLEXIBLE.smooth.digest
    assert not joint.shapes
