"""Comparison of a stream with an earlier estimate, and with prior knowledge."""

import re
from dataclasses import replace

import numpy as np
import pytest
from moving_joint import OPTIONS, options_of, stream, watched

from flexid.identification.preparation.recordings import Amplifier, Delay
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.report.terminal import as_text
from flexid.report.watch import parts
from flexid.streaming.health import Health
from flexid.streaming.learner import departures
from flexid.streaming.options import WatchOptions, not_accounted_for, wanted_kind

TRUTH = {"joint_stiffness": 100.0, "link_inertia": 1.0, "motor_inertia": 0.3, "gravity_torque": 5.0}


def against(**other: float) -> WatchOptions:
    """Return options with the true values as reference, some of them changed."""
    reference = {name: (value, 1e-3 * value) for name, value in (TRUTH | other).items()}
    return replace(OPTIONS, reference=reference)


def estimated(value: float, half: float) -> dict[str, ValueEstimate]:
    """Return a parameter with its interval."""
    ends = (value - half, value + half)
    return {"a": ValueEstimate("a", "N m", value, half / 2.0, ends, "determined")}


@pytest.mark.parametrize(
    ("now", "half", "count"),
    [(109.0, 0.1, 0), (111.0, 0.1, 1), (120.0, 11.0, 0), (120.0, 9.0, 1), (89.0, 0.1, 1)],
)
def test_what_counts_as_a_departure(now: float, half: float, count: int):
    """Assert that a departure needs a tenth of the value, and twice the half widths."""
    reference = {"a": (100.0, 1.0), "b": (1.0, 0.1)}
    assert len(departures(reference, estimated(now, half), widths=2.0, least=0.1)) == count


@pytest.mark.parametrize(("was", "now", "count"), [(3.1, -3.1, 0), (0.0, 0.09, 0), (3.1, -3.0, 1)])
def test_an_angle_departs_round_the_circle(was: float, now: float, count: int):
    """Assert that angles differ by the shorter way, with a limit in rad."""
    angle = replace(estimated(now, 0.01)["a"], name="gravity_angle", unit="rad")
    found = departures({angle.name: (was, 0.01)}, {angle.name: angle}, widths=2.0, least=0.1)
    assert len(found) == count
    for one in found:
        assert one.sentence == "gravity_angle is -3 rad, and 3.1 in the estimate"
        assert np.isnan(one.change)


@pytest.fixture(scope="module")
def result(example_estimate):
    """Return an identification of the example."""
    return example_estimate.result


def test_terms_and_filter_of_a_stream(result):
    """Assert those of the estimate unless given, and those of a rigid joint by either name."""
    options = options_of(result)
    assert (options.terms, options.hold) == (("gravity", "motor_viscous"), "zero")
    assert options.filter_rate == result.choices.filter_rate
    assert options.reference.keys() >= TRUTH.keys()
    options = options_of(result, terms=("gravity",), hold="linear", filter_rate=10.0)
    assert (options.terms, options.hold, options.filter_rate) == (("gravity",), "linear", 10.0)
    assert wanted_kind({}, replace(result, model="link")) == "link"
    beta = replace(result.coefficients["beta1"], value=3.0, std=0.0)  # given instead of estimated
    options = options_of(replace(result, coefficients=result.coefficients | {"beta1": beta}))
    assert options.given == {"beta1": 3.0}
    assert "beta1" not in options.system.coefficients
    assert options_of(kind="rigid").terms == ("gravity", "viscous", "coulomb")
    options = options_of(kind="rigid", terms=("motor_viscous", "viscous_asymmetry"))
    assert options.terms == ("viscous", "viscous_asymmetry")
    assert options_of(h=0.02).filter_rate == pytest.approx(0.125 / 0.02)


@pytest.mark.parametrize("part", ["value", "std", "interval"])
def test_a_number_that_is_missing_is_compared_with_nothing(result, part: str):
    """Assert that a parameter without a finite value or interval is not compared."""
    missing = {"value": np.nan, "std": np.inf, "interval": (-np.inf, 1.0)}[part]
    stiffness = replace(result.parameters["joint_stiffness"], **{part: missing})
    parameters = result.parameters | {"joint_stiffness": stiffness}
    options = options_of(replace(result, parameters=parameters))
    assert {*TRUTH} - {*options.reference} == {"joint_stiffness"}


def test_what_a_stream_is_not_corrected_by_is_warned_of(result):
    """Assert warnings of a delay above a tenth of a sample, and of an amplifier's dead zone."""
    late = Delay(0.002, 1e-4, (0.0018, 0.0022), "found")
    alignment = replace(result.choices.alignment, input_delay=late)
    made = replace(result, choices=replace(result.choices, alignment=alignment))
    (warning,) = not_accounted_for(made, 0.019)
    assert "the input late by 2 ms" in warning
    assert [*not_accounted_for(made, 0.021)] == []
    choices = replace(result.choices, amplifier=Amplifier(dead_zone=0.2))
    (warning,) = not_accounted_for(replace(result, choices=choices), 0.01)
    assert "send the input that reaches the motor" in warning


def test_what_is_known_narrows_or_is_contradicted():
    """Assert that known inertias narrow other intervals, and that a wrong one is named."""
    free, fixed, nearly = (
        watched(stream(), replace(OPTIONS, known=known, known_deviations=deviations))
        for known, deviations in (
            ({}, {}), ({"motor_inertia": 0.3}, {}), ({"link_inertia": 1.0}, {"link_inertia": 1e-4})
        )
    )  # fmt: skip
    assert fixed.options.given == {"beta1": pytest.approx(1.0 / 0.3)}
    assert fixed.coefficients["beta1"].std == 0.0
    assert fixed.health.health is Health.CONVERGED
    for session, name, share in ((fixed, "joint_stiffness", 0.8), (nearly, "link_inertia", 0.5)):
        widths = [np.diff(s.parameters[name].interval)[0] for s in (free, session)]
        assert widths[1] < share * widths[0]
    low, high = nearly.parameters["joint_stiffness"].interval
    assert low < 100.0 < high
    known = replace(OPTIONS, known={"link_inertia": 2.0}, known_deviations={"link_inertia": 0.01})
    health, reason = watched(stream(), known).health
    assert health is Health.INCONSISTENT
    assert "link_inertia is known as 2" in reason


def test_a_drive_that_has_departed_is_said_to():
    """Assert the largest difference by name, in per cent, or in units if zero is possible."""
    session = watched(stream(), against(joint_stiffness=125.0, motor_inertia=0.26))
    assert [d.name for d in session.departures] == ["joint_stiffness", "motor_inertia"]
    assert session.departures[0].change == pytest.approx(-0.2, abs=0.005)
    health, reason = session.health
    assert health is Health.INCONSISTENT
    assert reason.startswith("joint_stiffness is ")
    assert reason.endswith("N m/rad (-20 %), and 125 in the estimate")
    reference = {"joint_stiffness": (100.0, 0.1), "gravity_torque": (0.5, 0.6)}
    text = as_text(parts(watched(stream(), replace(OPTIONS, reference=reference))))
    assert re.search(r"joint_stiffness .* [+-]\d\.\d %\n", text)
    assert re.search(r"gravity_torque .* \+4\.\d+ N m\n", text)
