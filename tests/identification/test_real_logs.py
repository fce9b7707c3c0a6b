"""Results of `identify` on logs of real machines, with default settings."""

import polars as pl
import pytest
from made_joint import assert_holds

import flexid
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.recording.read import read_log

ARM, KUKA = "ist-flexible-arm/ist_square_1p5V.csv", "kr300/kr300_A.csv"


@pytest.fixture(scope="module")
def identified(shared_data, examples):
    """Return a function that identifies a log, given a column map or (column, unit, scale)."""

    def result_of(file, shipped="", settings=None, **columns):
        own = {"time": {"column": "t_s", "unit": "s"}}
        for channel, about in columns.items():
            own[channel] = dict(zip(("column", "unit", "scale"), about, strict=False))
        log = read_log(shared_data / file, examples / shipped if shipped else own)
        return identify([log], settings)

    return result_of


def test_arm_is_predicted_and_not_as_modelled(identified):
    """Assert the fits of IST Lisbon's arm, and that its flexible beam leaves more than noise."""
    arm = identified(ARM, "columns_voltage_arm.toml", Settings(validation_share=0.5))
    fit = arm.validation.fit_percent
    assert fit["motor_position"] >= 95.5
    assert fit["link_position"] >= 95.5
    assert fit["deflection"] >= 84.5
    assert list(arm.validation.horizons) == [0.05, 0.2, 1.0, 5.0]
    for fits in arm.validation.horizons.values():
        assert fits["motor_position"] >= 97.0
        assert fits["deflection"] >= 83.0
    assert {"link_offset", "motor_offset", "motor_viscous"} <= set(arm.choices.terms)
    assert {"link_coulomb", "motor_coulomb"} & set(arm.choices.terms)
    assert arm.parameters
    assert {name for name in arm.parameters if "_per_" not in name} <= {"bend_deflection"}
    assert arm.compliance.visible
    assert arm.disturbances is not None
    assert all(0.05 < share < 0.5 for share in arm.disturbances.shares.values())


@pytest.mark.thorough
def test_arm_has_one_stiffness_whatever_the_voltage(identified):
    """Assert that two voltages give one stiffness, each within 10 %.

    Filtered least squares in several bands gives 426 to 445 1/s², published fits 400 to 470.
    """
    results = (
        identified(log, "columns_voltage_arm.toml")
        for log in (ARM, "ist-flexible-arm/ist_prbs.csv")
    )
    found = [each.parameters["joint_stiffness_per_link_inertia"] for each in results]
    for each in found:
        lower, upper = each.interval
        assert each.verdict == "determined"
        assert upper - lower <= 0.2 * each.value
        assert lower <= 470.0
        assert upper >= 400.0
    (a, b), (c, d) = (each.interval for each in found)
    assert max(a, c) <= min(b, d)


def test_slide_has_its_published_mass_and_friction(shared_data):
    """Assert the published values of EMPS (Janot, Gautier and Brunot, 2019), as a linear axis."""
    slide = identify([read_log(shared_data / "emps/emps_train.csv")])
    assert slide.joint == "prismatic"
    assert slide.parameters["inertia"].unit == "kg"
    published = {"inertia": 95.1, "viscous_friction": 203.5, "coulomb_friction": 20.39}
    assert_holds(slide, published, 0.3, verdict="determined")
    assert not any("gravity" in name for name in (*slide.parameters, *slide.choices.terms))


def test_pendulum_has_gravity_and_inertia(identified):
    """Assert that gravity torque and inertia agree with the balance of energy and work.

    This balance uses no acceleration; it gives 3.77 N m and 0.202 kg m². DFKI's pendulum has one
    encoder, so that no stiffness is reported. Its held-out swing is predicted. Both halves differ
    by more than chance, which widens the intervals.
    """
    pendulum = identified("dfki-pendulum/ddp.csv", "columns_pendulum.toml")
    assert_holds(pendulum, {"gravity_torque": 3.77, "inertia": 0.202}, 0.4)
    assert pendulum.validation.fit_percent["motor_position"] > 95.0
    assert pendulum.model == "rigid"
    assert not pendulum.compliance.visible
    assert "taken as rigid" in pendulum.compliance.reason
    assert not any("stiffness" in name for name in pendulum.parameters)


@pytest.mark.parametrize(("first", "last"), [(0, 1500), (300, 1800), (1000, 2000)])
def test_parts_of_the_pendulum_agree_with_the_whole(shared_data, examples, first, last):
    """Assert that intervals of gravity from parts contain the estimate from all data, 3.77 N m.

    With so few swings friction is hard to identify; without it gravity would be 5 N m.
    """
    rows = pl.read_csv(shared_data / "dfki-pendulum/ddp.csv")[first:last]
    part = flexid.identify(rows, columns=examples / "columns_pendulum.toml")
    lower, upper = part.parameters["gravity_torque"].interval
    assert lower <= 3.77 <= upper
    assert part.parameters["inertia"].verdict != "determined"


def test_a_skew_is_no_stiffness(identified):
    """Assert that a KUKA KR300's stiffness is undetermined, with a warning of a delay of 3 ms."""
    axis = identified(
        KUKA,
        link_position=("a1_q_link_deg", "deg"),
        motor_position=("a1_q_mot_deg", "deg"),
        motor_torque=("a1_tau_mot_Nm", "N m"),
    )
    springs = {"theta2", "alpha1"}
    numbers = [*axis.coefficients.values(), *axis.parameters.values()]
    resting = [number for number in numbers if springs & number.slopes.keys()]
    assert {"theta2", "joint_stiffness"} <= {number.name for number in resting}
    assert {number.verdict for number in resting} == {"undetermined"}
    assert not axis.compliance.visible
    assert "is a delay of 3" in axis.warnings[0]
    assert "ms between the encoders" in axis.warnings[0]


def test_arm_without_its_voltage_has_its_stiffness(identified):
    """Assert the stiffness of the link alone; the best published fit gives 463 1/s²."""
    arm_alone = identified(
        ARM, motor_position=("pot_V", "deg", 35.32), deflection=("strain_V", "deg", 1.34)
    )
    assert arm_alone.model == "link"
    assert arm_alone.validation.fit_percent["deflection"] > 83.0
    stiffness = arm_alone.parameters["joint_stiffness_per_link_inertia"]
    assert stiffness.value == pytest.approx(463.0, rel=0.2)
    assert stiffness.interval[0] <= 463.0 <= stiffness.interval[1]
    assert stiffness.verdict != "undetermined"


@pytest.mark.thorough
def test_kuka_without_torques_shows_no_stiffness(identified):
    """Assert that the delay of 3 ms between the KUKA's encoders is not mistaken for a spring."""
    channels = {"link_position": "a1_q_link_deg", "motor_position": "a1_q_mot_deg"}
    result = identified(KUKA, **{name: (column, "deg") for name, column in channels.items()})
    assert not result.compliance.visible
    assert result.coefficients["theta2"].verdict == "undetermined"


@pytest.mark.thorough
def test_one_stage_of_two_has_no_stiffness(identified):
    """Assert that no stiffness is determined if the second stage is not in the model."""
    stage = identified(
        "quanser-two-stage/lqr_10deg.csv",
        motor_position=("motor1_deg", "deg"),
        deflection=("deflection1_deg", "deg"),
        motor_current=("current1_A", "A"),
    )
    named = [name for name in stage.parameters if "stiffness" in name]
    assert named
    assert "determined" not in {stage.parameters[name].verdict for name in named}
    assert not stage.compliance.visible
