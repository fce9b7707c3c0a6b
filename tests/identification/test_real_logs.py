"""What `identify` says of logs of machines that no one here built, all by itself."""

import pytest

from flexid.identification.identify import identify
from flexid.identification.settings import Settings
from flexid.recording.read import read_log


@pytest.fixture(scope="module")
def arm(shared_data, examples):
    """The arm of IST Lisbon, fitted on the first half."""
    file = shared_data / "ist-flexible-arm" / "ist_square_1p5V.csv"
    log = read_log(file, examples / "columns_voltage_arm.toml")
    return identify([log], Settings(validation_share=0.5))


def test_arm_is_repeated_over_its_second_half(arm):
    """Assert that the free run reaches what is asked, its first state taken from data before."""
    fit = arm.validation.fit_percent
    assert fit["motor_position"] >= 96.5
    assert fit["link_position"] >= 96.5
    assert fit["deflection"] >= 84.5


def test_arm_needs_its_offsets(arm):
    """Assert that the constant torques are found, and that the free run says what they buy."""
    saved = {e.term: 1 - e.with_term / e.without_term for e in arm.choices.term_evidence}
    assert {"link_offset", "motor_offset"} <= set(arm.choices.terms)
    assert saved["motor_offset"] > 0.5


def test_arm_gets_no_delay_that_the_free_run_contradicts(arm):
    """Assert that the input's delay, which least squares would like, is refused."""
    assert arm.choices.alignment.input_delay.value == 0.0
    assert arm.choices.alignment.input_delay.estimate > 5e-3


def test_arm_is_flexible(arm):
    """Assert that the compliance is called visible, and that a rigid joint repeats less."""
    assert arm.compliance.visible
    rigid = arm.compliance.rigid_fit_percent["motor_position"]
    assert rigid < arm.validation.fit_percent["motor_position"]


@pytest.fixture(scope="module")
def pendulum(shared_data, examples):
    """DFKI's pendulum: one encoder."""
    file = shared_data / "dfki-pendulum" / "ddp.csv"
    return identify([read_log(file, examples / "columns_pendulum.toml")])


def test_pendulum_has_gravity_and_inertia(pendulum):
    """Assert that gravity torque and inertia agree with the balance of energy and work.

    That balance, which uses no acceleration, gives 3.77 N m and 0.202 kg m².
    """
    for name, value in {"gravity_torque": 3.77, "inertia": 0.202}.items():
        lower, upper = pendulum.parameters[name].interval
        assert lower <= value <= upper
        assert upper - lower < 0.2 * value


def test_pendulum_shows_no_compliance(pendulum):
    """Assert that there is no word of a stiffness, and the reason why."""
    assert pendulum.model == "rigid"
    assert not pendulum.compliance.visible
    assert "one encoder" in pendulum.compliance.reason
    assert not any("stiffness" in name for name in pendulum.parameters)


@pytest.mark.parametrize("axis", [1, 3])
def test_skewed_axes_give_no_confident_stiffness(shared_data, tmp_path, axis):
    """Assert that KUKA's axes, all skew and hardly any deflection, are not called known."""
    columns = tmp_path / "columns.toml"
    columns.write_text(
        'time = {column = "t_s", unit = "s"}\n'
        f'link_position = {{column = "a{axis}_q_link_deg", unit = "deg"}}\n'
        f'motor_position = {{column = "a{axis}_q_mot_deg", unit = "deg"}}\n'
        f'motor_torque = {{column = "a{axis}_tau_mot_Nm", unit = "N m"}}\n'
    )
    result = identify([read_log(shared_data / "kr300" / "kr300_A.csv", columns)])
    stiffness = result.parameters["joint_stiffness"]
    lower, upper = stiffness.interval
    right = axis == 3 and lower <= 4.10e6 <= upper and abs(stiffness.value / 4.10e6 - 1) < 0.2
    assert stiffness.status == "undetermined" or right
    assert 2.5e-3 < result.choices.alignment.link_delay.value < 3.5e-3
