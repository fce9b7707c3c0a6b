"""Columns that are recognised by the names that they usually have, and the units in them."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from joint_log import joint_columns, read_columns, refused, without

from flexid.recording import Log
from flexid.recording.names import usual_channel
from flexid.recording.units import EXAMPLES, UnitError, is_usual, scale_to_si

USUAL = {
    "time": (
        *("t", "t_s", "Time_ms", "timestamp", "tout", "Zeit [s]", "Temps", "TIME_MS", "timeMs"),
        *("elapsed_time_s", "millis", "seconds", "Zeitstempel", "Zeit in s", "时间(s)"),
    ),
    "link_position": (
        *("q_l", "theta_link", "LoadAngle", "link angle", "q_link_deg", "q_link {deg}"),
        *("Winkel Abtrieb [°]", "Position charge (deg)", "posizione_carico", "Link [deg]"),
        *("Abtriebswinkel / °", "θ_l", "posição carga (rad)", "负载角度", "fuzai_jiaodu", "ql"),
        *("position (link) [deg]", "[deg] link_position", "link_counts", "LINK_POS_MDEG"),
        *("link position <deg>", "link_pos:deg", "link position, deg", "负载位置（度）"),
    ),
    "motor_position": ("q_m", "theta_m", "motor_pos", "qMotor", "pos_motor_deg", "rotor angle"),
    "motor_velocity": ("qd_m", "motor_speed_rpm", "omega_m", "v_m [rad/s]"),
    "motor_torque": (
        *("tau", "tau_m", "torque", "tau_Nm", "Drehmoment", "Couple moteur (N·m)"),
        *("motor-torque-nm", "MotorTorqueNm", "torque_pct", "Motordrehmoment [Nm]", "tau_inlb"),
    ),
    "torque": ("joint_torque", "torque_sensor_Nm"),
    "motor_current": (
        *("i_m_A", "i_q [A]", "iq", "Iststrom [A]", "motor_current", "Motor (mA)", "current_mA"),
    ),
    "motor_voltage": ("u_V", "voltage", "v_m (V)", "V [mV]"),
    "deflection": ("torsion angle [deg]", "Verdrehwinkel / °", "joint_deflection", "扭转角度"),
    "position": ("position", "angle", "q"),
    "velocity": ("velocity", "speed_rpm"),
}
STRANGE = (
    *("x1", "a1_q_link_deg", "motor", "load [N m]", "motor [bar]", "tau_l", "link_torque", "i"),
    *("u", "temperature", "torque_cmd", "position_desired", "motor_link_angle", "q_dot_dot"),
    *("position[0]", "pot_V", "", "torque ²", "Winkel * 2", "q̇_m", "-tau", "T [°C]", "tau*1000"),
    *("last_position", "POS_A", "pos_V", "v", "v [m/s]", "u [rad]", "position error", "τ̇"),
    *("tension", "spring_torque", "torsional torque", "link_deflection", "twist.linear.x", "input"),
)


@pytest.mark.parametrize("channel", USUAL)
def test_usual_names(channel: str) -> None:
    """Assert that a name is known for the channel it usually is."""
    found = [usual_channel(name) for name in USUAL[channel]]
    assert [one and one[0] for one in found] == [channel] * len(found)


@pytest.mark.parametrize("name", STRANGE)
def test_other_names(name: str) -> None:
    """Assert that nothing is made of a name that may mean something else."""
    assert usual_channel(name) is None


def test_a_log_with_usual_names() -> None:
    """Assert that it is read, in the units in its names, and that what was taken is said."""
    columns = joint_columns()
    log = read_columns(
        {
            "t_ms": columns["time"] * 1e3,
            "theta_m_deg": np.degrees(columns["motor_position"]),
            "q_l": columns["link_position"],
            "tau_mNm": columns["motor_torque"] * 1e3,
            "mode": 0.0 * columns["time"],
        }
    )
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(0.005)
    np.testing.assert_allclose(recording.motor_position, columns["motor_position"], rtol=1e-12)
    np.testing.assert_allclose(recording.needed_input, columns["motor_torque"], rtol=1e-12)
    taken, unused = log.warnings
    for words in ("'t_ms' for time in ms", "'theta_m_deg' for motor_position in deg", "check"):
        assert words in taken
    assert "'mode' is not used" in unused


def test_own_names_come_first() -> None:
    """Assert that a usual name counts for nothing beside the channel's own."""
    columns = joint_columns()
    tau, motor = columns["motor_torque"], columns["motor_position"]
    others = {"tau": 2.0 * tau, "current": 3.0 * tau, "theta_m": 4.0 * motor}
    log = read_columns(columns | others)
    np.testing.assert_array_equal(log.recordings[0].input, tau)
    np.testing.assert_array_equal(log.recordings[0].motor_position, motor)
    assert "'tau', 'current', 'theta_m' are not used" in log.warnings[0]


def of_names(**names: str) -> Log:
    """The log with other names of its columns."""
    columns = without(joint_columns(), "velocity")
    return read_columns({names.get(name, name): values for name, values in columns.items()})


@pytest.mark.parametrize(
    ("names", "side"),
    [
        ({"link_position": "q", "motor_position": "theta_m"}, "link"),
        ({"link_position": "/load_encoder/position", "motor_position": "/state/position"}, "motor"),
        ({"link_position": "SecondaryPosition", "motor_position": "ActualPosition"}, "motor"),
    ],
)
def test_a_position_beside_that_of_one_side_is_of_the_other(
    names: dict[str, str], side: str
) -> None:
    """Assert that a name without a side is of the other side, with a warning."""
    log = of_names(**names)
    for name in ("link_position", "motor_position"):
        np.testing.assert_array_equal(getattr(log.recordings[0], name), joint_columns()[name])
    assert f"{names[f'{side}_position']!r} for {side}_position in rad" in log.warnings[0]


def test_a_torque_beside_two_encoders_may_be_the_springs() -> None:
    """Assert that a sensor's torque is not taken for the motor's."""
    log = of_names(motor_position="position", link_position="load_pos", motor_torque="joint_torque")
    assert log.recordings[0].input is None


def test_a_deflection_by_its_usual_name() -> None:
    """Assert that it is taken beside the motor's position, and in no unit of another kind."""
    columns = joint_columns()
    deflection = columns.pop("link_position") - columns["motor_position"]
    columns = without(columns, "velocity")
    log = read_columns({**columns, "spring_deflection_deg": np.degrees(deflection)})
    link = joint_columns()["link_position"]
    np.testing.assert_allclose(log.recordings[0].needed_link_position, link, rtol=1e-12)
    assert read_columns({**columns, "torsion_V": deflection}).recordings[0].link_position is None


def test_a_command_counts_where_nothing_was_measured() -> None:
    """Assert that it is the input with a warning, and nothing beside a measured current."""
    log = of_names(motor_torque="torque_cmd")
    assert log.recordings[0].input_unit == "N m"
    assert "'torque_cmd' is a command, and not a measurement" in log.warnings[1]
    columns = joint_columns()
    columns["tau_ref"] = columns.pop("motor_torque")
    log = read_columns(columns | {"motor_strom": columns["tau_ref"]})
    assert log.recordings[0].input_unit == "A"


def test_joints_with_numbers() -> None:
    """Assert that the only one is read, and that several are refused with an example."""
    own = {"link_position": "joint_3_q_l", "motor_position": "joint_3_q_m"}
    assert of_names(**own, motor_torque="joint_3_tau").recordings[0].input_unit == "N m"
    other = {"q_l_2": np.sin(joint_columns()["time"])}
    numbered = {f"{n}_1" if n != "time" else n: v for n, v in joint_columns().items()}
    message = refused(read_columns, numbered | other)
    assert "positions with the numbers 1, 2" in message
    assert "as motor_position = 'motor_position_1'" in message


def test_words_of_all_names_say_nothing() -> None:
    """Assert that the name of a rig before all others is left out, and that of one is not."""
    names = {name: f"rig_{name}" for name in joint_columns() if name != "time"}
    assert of_names(**names).recordings[0].input_unit == "N m"
    assert "no motor_position" in refused(lambda _: of_names(motor_position="rig_q_m"), None)


def test_a_time_by_what_it_holds() -> None:
    """Assert that the only column of time stamps is the time, whatever its name."""
    columns = without(joint_columns(), "velocity")
    time = columns.pop("time")
    stamps = np.datetime64("2024-05-01") + (1e6 * time).astype("timedelta64[us]")
    log = read_columns({"when": stamps, **columns})
    assert log.recordings[0].sample_time == pytest.approx(0.005)


def test_one_encoder() -> None:
    """Assert that a position without a side is the motor's where there is no other."""
    columns = joint_columns()
    single = {
        "time": columns["time"],
        "position": columns["motor_position"],
        "velocity": columns["motor_velocity"],
        "torque": columns["motor_torque"],
    }
    (recording,) = read_columns(single).recordings
    np.testing.assert_array_equal(recording.motor_position, columns["motor_position"])
    assert recording.motor_velocity is not None
    del single["position"]
    single["link_position"] = columns["link_position"]
    assert "there is no motor_position" in refused(read_columns, single)


def test_two_usual_names() -> None:
    """Assert that of two columns neither is taken, and both are named."""
    motor = joint_columns()["motor_position"]
    columns = without(joint_columns(), "motor_position")
    columns |= {"theta_m": motor, "motor_angle": 2.0 * motor}
    words = "'theta_m', 'motor_angle' could each be motor_position"
    assert words in refused(read_columns, columns)


def test_a_map_leaves_nothing_to_guess() -> None:
    """Assert that with a column map only a channel's own name is taken."""
    columns = joint_columns()
    columns["tau"] = columns.pop("motor_torque")
    log = read_columns(columns, {"time": "time"})
    assert log.recordings[0].input is None
    assert any("name its column in columns" in warning for warning in log.warnings)


UNITS = {
    (pi / 180, "rad"): ("deg", "°", "DEGREES"),
    (2 * pi, "rad"): ("turn", "rev"),
    (1e-6, "rad"): ("urad", "µrad"),
    (pi / 180, "rad/s"): ("deg/s",),
    (pi / 30, "rad/s"): ("rpm", "U/min", "1/min"),
    (1.0, "rad/s"): ("rad s^-1", "rad/sec"),
    (1.0, "N m"): ("Nm", "N·m", "N\u22c5m", "N.m", "Newton metre"),
    (1e-3, "N m"): ("mNm", "Nmm"),
    (1e3, "N m"): ("kN m",),
    (1e-3, "V"): ("mV",),
    (1e-3, "A"): ("mA",),
    (1e-3, "s"): ("ms",),
    (1e-6, "s"): ("us", "µs"),
    (1.0, "s"): ("Sec",),
}


@pytest.mark.parametrize(("factor", "si_unit"), UNITS)
def test_units(factor: float, si_unit: str) -> None:
    """Assert that a unit has its factor and its SI unit, however it is written."""
    for text in UNITS[factor, si_unit]:
        found = scale_to_si(text, tuple(EXAMPLES))
        assert found == (pytest.approx(factor, rel=1e-12), si_unit), text


UNKNOWN = r"is not known for this column: write \[s\].*\[rad\], \[deg\]"
REFUSED = {
    # What has the dimension by accident, or another.
    **dict.fromkeys(["Hz", "1/s", "Ms", "as", "MS", "N m/rad", "m", "rad^2", ""], UNKNOWN),
    "percent": "share of something: .*rated value as the scale, in a column map",
    "‰": "share of something",
    "Grad": r"may mean degrees, or gon .*: write \[deg\], or .*'1/400'",
    "counts": "depends on the encoder",
    # No unit text does more than fail.
    **dict.fromkeys(["furlongs!", "9^9^9", "km^9999", "km²³²³²³", "rad/", "__x", "("], UNKNOWN),
}


@pytest.mark.parametrize("text", REFUSED)
def test_units_that_are_refused(text: str) -> None:
    """Assert that the message says what to write instead."""
    with pytest.raises(UnitError, match=REFUSED[text]):
        scale_to_si(text, tuple(EXAMPLES))


@pytest.mark.parametrize(
    ("text", "usual"),
    [("kHz", True), ("Volts", True), ("s", True), ("S", False), ("v", False), ("speed", False)],
)
def test_usual_units(text: str, usual: bool) -> None:
    """Assert that a symbol is known as it is written, and a word in any letters."""
    assert is_usual(text) == usual


@given(st.text(max_size=30))
def test_any_unit(text: str) -> None:
    """Assert that any text is converted or refused."""
    try:
        factor, _ = scale_to_si(text, tuple(EXAMPLES))
    except UnitError:
        return
    assert factor > 0.0
