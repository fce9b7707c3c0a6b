"""What the fit with disturbances says of logs of machines that no one here built."""

from pathlib import Path

import pytest

from flexid.identification.identify import identify
from flexid.identification.result.identification import Identification
from flexid.recording.read import read_log

STIFFNESS = "joint_stiffness_per_link_inertia"


def identified(file: Path, columns: Path) -> Identification:
    """Identify one log as it is."""
    return identify([read_log(file, columns)])


def with_columns(folder: Path, *lines: str) -> Path:
    """A column map of these lines."""
    columns = folder / "columns.toml"
    columns.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return columns


@pytest.fixture(scope="module")
def arms(shared_data, examples):
    """The arm of IST Lisbon under a square wave and a pseudo-random voltage."""
    folder, columns = shared_data / "ist-flexible-arm", examples / "columns_voltage_arm.toml"
    names = ("ist_square_1p5V.csv", "ist_prbs.csv")
    return [identified(folder / name, columns).parameters[STIFFNESS] for name in names]


@pytest.mark.parametrize("place", [0, 1], ids=["square", "prbs"])
def test_stiffness_of_the_arm_is_determined(arms, place):
    """Assert a half-width of a tenth at most, and an interval that meets 400 to 470 1/s².

    Filtered least squares in several bands gives 426 to 445, the best fit of others 463.
    """
    lower, upper = arms[place].interval
    assert arms[place].verdict == "determined"
    assert upper - lower <= 0.2 * arms[place].value
    assert lower <= 470.0
    assert upper >= 400.0


def test_logs_of_one_arm_agree(arms):
    """Assert that the intervals of the two logs meet."""
    (a, b), (c, d) = (arm.interval for arm in arms)
    assert max(a, c) <= min(b, d)


@pytest.fixture(scope="module")
def kuka(shared_data, examples):
    """Axis 1 of a KUKA KR300, whose encoders are 3 ms apart."""
    return identified(shared_data / "kr300" / "kr300_A.csv", examples / "columns_kuka_axis_1.toml")


def test_a_skew_is_no_stiffness(kuka):
    """Assert that nothing that rests on a stiffness is called known, not even weakly."""
    springs = {"theta2", "alpha1"}
    numbers = [*kuka.coefficients.values(), *kuka.parameters.values()]
    resting = [number for number in numbers if springs & number.slopes.keys()]
    assert {"theta2", "joint_stiffness"} <= {number.name for number in resting}
    assert {number.verdict for number in resting} == {"undetermined"}


def test_a_skew_is_named_first(kuka):
    """Assert that the first warning names the delay of 3 ms between the encoders."""
    assert "a delay of 3" in kuka.warnings[0]
    assert "ms between the encoders" in kuka.warnings[0]


@pytest.fixture(scope="module")
def stage(shared_data, tmp_path_factory):
    """The first of two flexible stages, the second of which moves on top of it."""
    columns = with_columns(
        tmp_path_factory.mktemp("stage"),
        'time = "t_s"',
        'motor_position = { column = "motor1_deg", unit = "deg" }',
        'deflection = { column = "deflection1_deg", unit = "deg" }',
        'motor_current = { column = "current1_A", unit = "A" }',
    )
    return identified(shared_data / "quanser-two-stage" / "lqr_10deg.csv", columns)


def test_one_stage_of_two_has_no_stiffness(stage):
    """Assert that nothing with a stiffness is determined: the other stage is not in the model."""
    named = [name for name in stage.parameters if "stiffness" in name]
    assert named
    assert "determined" not in {stage.parameters[name].verdict for name in named}
    assert not stage.compliance.visible


@pytest.fixture(scope="module")
def axis(shared_data, tmp_path_factory):
    """A prismatic servo axis, 1 m called 1 rad and 1 N called 1 N m."""
    columns = with_columns(
        tmp_path_factory.mktemp("axis"),
        'time = "t_s"',
        'motor_position = { column = "position_m", unit = "rad" }',
        'motor_torque = { column = "force_N", unit = "N m" }',
    )
    return identified(shared_data / "emps" / "emps_train.csv", columns)


@pytest.mark.parametrize(
    ("name", "published"),
    [("inertia", 95.1), ("viscous_friction", 203.5), ("coulomb_friction", 20.39)],
)
def test_axis_is_as_published(axis, name, published):
    """Assert that the interval holds what Janot, Gautier and Brunot (2019) found."""
    lower, upper = axis.parameters[name].interval
    assert lower <= published <= upper
    assert axis.parameters[name].verdict == "determined"


def test_axis_has_no_gravity(axis):
    """Assert that no term of gravity is kept for an axis that is level and straight."""
    assert not [term for term in axis.choices.terms if "gravity" in term]
    assert "gravity_torque" not in axis.parameters
