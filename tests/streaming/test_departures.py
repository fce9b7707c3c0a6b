"""A stream that is held against an estimate made before, and against what is known."""

import re
from dataclasses import replace

import numpy as np
import pytest
from moving_joint import OPTIONS, H, stream, watched

import flexid
from flexid.errors import SettingError
from flexid.identification.full_model.amplifier import Amplifier
from flexid.identification.preparation.joint import Kind
from flexid.identification.preparation.recordings import Delay
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import ParameterEstimate
from flexid.report.terminal import as_text
from flexid.report.watch import parts
from flexid.streaming.health import Health
from flexid.streaming.learner import departures
from flexid.streaming.options import (
    StreamChannels,
    WatchOptions,
    check_comparable,
    not_accounted_for,
    options_of_stream,
    wanted_kind,
)

TRUTH = {"joint_stiffness": 100.0, "link_inertia": 1.0, "motor_inertia": 0.3, "gravity_torque": 5.0}


def against(**other: float) -> WatchOptions:
    """Options of a stream that is held against the truth, but for some values."""
    reference = {name: (value, 1e-3 * value) for name, value in (TRUTH | other).items()}
    return replace(OPTIONS, reference=reference)


def test_a_drive_as_it_was_has_not_departed():
    """Assert that the true values, and values 5 % beside them, leave the health as it is."""
    for options in (against(), against(joint_stiffness=105.0, link_inertia=0.95)):
        session = watched(stream(), options)
        assert session.departures == ()
        assert session.health.health is Health.CONVERGED


def test_a_drive_that_has_departed_is_said_to():
    """Assert that the health says which parameter differs most, and by how much."""
    session = watched(stream(), against(joint_stiffness=125.0, motor_inertia=0.26))
    assert [d.name for d in session.departures] == ["joint_stiffness", "motor_inertia"]
    assert session.departures[0].change == pytest.approx(-0.2, abs=0.005)
    health, reason = session.health
    assert health is Health.INCONSISTENT
    assert reason.startswith("joint_stiffness is ")
    assert reason.endswith("N m/rad (-20 %), and 125 in the estimate")


def estimated(value: float, half: float) -> dict[str, ParameterEstimate]:
    """A parameter with its interval."""
    ends = (value - half, value + half)
    return {"a": ParameterEstimate("a", "N m", value, half / 2.0, ends, "determined")}


@pytest.mark.parametrize(
    ("now", "half", "count"),
    [(109.0, 0.1, 0), (111.0, 0.1, 1), (120.0, 11.0, 0), (120.0, 9.0, 1), (89.0, 0.1, 1)],
)
def test_what_counts_as_a_departure(now: float, half: float, count: int):
    """Assert that it takes a tenth of the value, and twice the half intervals."""
    reference = {"a": (100.0, 1.0), "b": (1.0, 0.1)}
    assert len(departures(reference, estimated(now, half), widths=2.0, least=0.1)) == count


def turned(was: float, now: float):
    """What is said of the zero of a link's encoder."""
    found = replace(estimated(now, 0.01)["a"], name="gravity_angle", unit="rad")
    return departures({found.name: (was, 0.01)}, {found.name: found}, widths=2.0, least=0.1)


def test_an_angle_departs_round_the_circle():
    """Assert that an angle goes the shorter way, and that its limit is one in rad."""
    assert turned(3.1, -3.1) == ()
    assert turned(0.0, 0.09) == ()
    (found,) = turned(3.1, -3.0)
    assert found.sentence == ("gravity_angle is -3 rad, and 3.1 in the estimate")
    assert np.isnan(found.change)


def options_of(
    made: Identification | None = None, kind: Kind = "flexible", unit: str = "N m", h: float = H,
    **chosen: object,
) -> WatchOptions:  # fmt: skip
    """Options of a stream."""
    return options_of_stream(chosen, made, StreamChannels(kind, unit, False, ()), h)


@pytest.fixture(scope="module")
def result(example_estimate):
    """An identification of the example."""
    return example_estimate.result


def test_a_stream_takes_model_and_filter_of_the_estimate(result):
    """Assert that all but the values is taken, and what is asked for prevails."""
    options = options_of(result)
    assert (options.terms, options.hold) == (("gravity", "motor_viscous"), "zero")
    assert options.filter_rate == result.choices.filter_rate
    assert options.reference.keys() >= TRUTH.keys()
    options = options_of(result, terms=("gravity",), hold="linear", filter_rate=10.0)
    assert (options.terms, options.hold, options.filter_rate) == (("gravity",), "linear", 10.0)


def test_terms_are_those_of_the_joint():
    """Assert that a rigid joint has its own terms, which other joints' names may mean."""
    assert options_of(kind="rigid").terms == ("gravity", "viscous", "coulomb")
    options = options_of(kind="rigid", terms=("motor_viscous", "viscous_asymmetry"))
    assert options.terms == ("viscous", "viscous_asymmetry")
    refused: dict[Kind, str] = {
        "rigid": "joint_damping",
        "link": "motor_drag",
        "flexible": "viscous",
    }
    for kind, term in refused.items():
        with pytest.raises(SettingError, match=f"'{term}' is no term of the {kind} joint; it has"):
            options_of(kind=kind, terms=(term,))


def test_a_filter_that_the_samples_are_too_few_for_is_slowed():
    """Assert that without a rate of its own a slow stream gets one that it allows."""
    options = options_of(h=0.02)
    assert options.filter_rate == pytest.approx(0.125 / 0.02)


def test_what_was_given_is_given(result):
    """Assert that a coefficient that was not estimated is none of the stream's, either."""
    beta = replace(result.coefficients["beta1"], value=3.0, std=0.0)
    options = options_of(replace(result, coefficients=result.coefficients | {"beta1": beta}))
    assert options.given == {"beta1": 3.0}
    assert "beta1" not in options.system.coefficients


def test_what_cannot_be_held_against(result):
    """Assert that another joint or input, a memory, a guess and a missing value are refused."""
    with pytest.raises(SettingError, match="has model flexible, and the stream rigid"):
        options_of(result, "rigid")
    with pytest.raises(SettingError, match="has input in N m, and the stream in A"):
        options_of(result, unit="A")
    with_memory = replace(result.choices, terms=("gravity", "spring_hysteresis"))
    with pytest.raises(SettingError, match=r"remembers the path .* --terms gravity, and"):
        check_comparable(replace(result, choices=with_memory))
    beta = replace(result.coefficients["beta1"], value=np.nan, std=0.0)
    with pytest.raises(SettingError, match="has no value of beta1"):
        check_comparable(replace(result, coefficients=result.coefficients | {"beta1": beta}))
    with pytest.raises(SettingError, match="is not positive"):
        options_of(result, coulomb_velocity=0.0)
    with pytest.raises(SettingError, match="holds no estimate"):
        flexid.watch(sample_time=H, estimate={})
    open_ones = {n: replace(p, verdict="undetermined") for n, p in result.parameters.items()}
    with pytest.raises(SettingError, match="determines nothing"):
        check_comparable(replace(result, parameters=open_ones))


@pytest.mark.parametrize("part", ["value", "std", "interval"])
def test_a_number_that_is_missing_is_compared_with_nothing(result, part: str):
    """Assert that a parameter without value or interval is left out."""
    missing = {"value": np.nan, "std": np.inf, "interval": (-np.inf, 1.0)}[part]
    stiffness = replace(result.parameters["joint_stiffness"], **{part: missing})
    parameters = result.parameters | {"joint_stiffness": stiffness}
    options = options_of(replace(result, parameters=parameters))
    assert {*TRUTH} - {*options.reference} == {"joint_stiffness"}


def test_what_a_stream_is_not_corrected_by_is_warned_of(result):
    """Assert that a delay is said from a tenth of a sample on, and an amplifier's dead zone."""
    late = Delay(0.002, 1e-4, (0.0018, 0.0022), "found")
    alignment = replace(result.choices.alignment, input_delay=late)
    made = replace(result, choices=replace(result.choices, alignment=alignment))
    (warning,) = not_accounted_for(made, 0.019)
    assert "the input late by 2 ms" in warning
    assert [*not_accounted_for(made, 0.021)] == []
    choices = replace(result.choices, amplifier=Amplifier(dead_zone=0.2))
    (warning,) = not_accounted_for(replace(result, choices=choices), 0.01)
    assert "send the voltage at the motor" in warning


def test_what_is_known_exactly_is_not_sought():
    """Assert that a given inertia fixes its coefficient, and the rest is told by it."""
    free, fixed = (
        watched(stream(), replace(OPTIONS, known=known)) for known in ({}, {"motor_inertia": 0.3})
    )
    assert fixed.options.given == {"beta1": pytest.approx(1.0 / 0.3)}
    assert fixed.coefficients["beta1"].std == 0.0
    widths = [np.diff(s.parameters["joint_stiffness"].interval)[0] for s in (free, fixed)]
    assert widths[1] < 0.8 * widths[0]
    assert fixed.health.health is Health.CONVERGED


def test_what_is_nearly_known_narrows():
    """Assert that knowledge with a deviation is joined to what the stream says."""
    short = stream(4.0)
    known = replace(OPTIONS, known={"link_inertia": 1.0}, known_deviations={"link_inertia": 1e-4})
    free, nearly = watched(short), watched(short, known)
    widths = [np.diff(s.parameters["link_inertia"].interval)[0] for s in (free, nearly)]
    assert widths[1] < 0.5 * widths[0]
    low, high = nearly.parameters["joint_stiffness"].interval
    assert low < 100.0 < high


def test_what_is_known_otherwise_is_contradicted():
    """Assert that a wrong value is not believed in silence."""
    known = replace(OPTIONS, known={"link_inertia": 2.0}, known_deviations={"link_inertia": 0.01})
    health, reason = watched(stream(), known).health
    assert health is Health.INCONSISTENT
    assert "link_inertia is known as 2" in reason


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"known": {"magic": 1.0}}, "magic"),
        ({"known": {"joint_damping": 1.0}}, "have no joint_damping"),
        ({"known": {"motor_inertia": -1.0}}, "motor_inertia"),
        ({"known": {"motor_inertia": 1.0}, "input_unit": "A"}, "needs a torque"),
        ({"terms": ("spring_hysteresis",)}, "'spring_hysteresis' is unknown"),
        ({"terms": ("backlash",)}, "needs a backlash_width, which an estimate has"),
    ],
)
def test_what_cannot_be_known(options: dict, words: str):
    """Assert that a name that this model has not is refused, with those that it has."""
    with pytest.raises(SettingError, match=words):
        replace(OPTIONS, **options)


def test_kinds_are_those_of_identify(result):
    """Assert that another model is refused with those there are."""
    with pytest.raises(SettingError, match="must be auto, flexible, link or rigid, got 'elastic'"):
        wanted_kind({"kind": "elastic"}, None)
    assert wanted_kind({}, replace(result, model="link")) == "link"


def test_no_change_is_a_share_of_what_may_be_zero():
    """Assert that a value beside one whose interval holds zero differs from it in its unit."""
    reference = {"joint_stiffness": (100.0, 0.1), "gravity_torque": (0.5, 0.6)}
    text = as_text(parts(watched(stream(), replace(OPTIONS, reference=reference))))
    assert re.search(r"joint_stiffness .* [+-]\d\.\d %\n", text)
    assert re.search(r"gravity_torque .* \+4\.\d+ N m\n", text)
