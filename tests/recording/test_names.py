"""Recognition of columns by usual names, and the units in them."""

from typing import Any

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, said, without

from flexid.recording.names import usual_channel
from flexid.recording.units import EXAMPLES, UnitError, is_usual, scale_to_si

NAMES = (
    *("t", "t_s", "Time_ms", "timestamp", "tout", "Zeit [s]", "Temps", "TIME_MS", "timeMs"),
    *("elapsed_time_s", "millis", "seconds", "Zeitstempel", "Zeit in s", "时间(s)", "stamp"),
    *("header.stamp", "header.stamp.nanosec"),
    *("q_l", "theta_link", "LoadAngle", "link angle", "q_link_deg", "q_link {deg}"),
    *("Winkel Abtrieb [°]", "Position charge (deg)", "posizione_carico", "Link [deg]"),
    *("Abtriebswinkel / °", "θ_l", "posição carga (rad)", "负载角度", "fuzai_jiaodu", "ql"),
    *("position (link) [deg]", "[deg] link_position", "link_counts", "LINK_POS_MDEG"),
    *("link position <deg>", "link_pos:deg", "link position, deg", "负载位置（度）"),
    *("q_m", "theta_m", "motor_pos", "qMotor", "pos_motor_deg", "rotor angle"),
    *("qd_m", "motor_speed_rpm", "omega_m", "v_m [rad/s]", "n_motor [rpm]", "w_m (rad/s)"),
    *("MotSpd [rpm]", "vm (rad/s)"),
    *("tau", "tau_m", "torque", "tau_Nm", "Drehmoment", "Couple moteur (N·m)", "motor-torque-nm"),
    *("MotorTorqueNm", "torque_pct", "Motordrehmoment [Nm]", "tau_inlb", "torque_cmd", "TauDes"),
    *("torque setpoint [N m]", "TrqReq [Nm]", "tau_filtered"),
    *("joint_torque", "torque_sensor_Nm", "wheel torque [N m]"),
    *("i_m_A", "i_q [A]", "iq", "Iststrom [A]", "motor_current", "Motor (mA)", "current_mA"),
    *("iq_filtered_A", "iq_ref_A", "Im [A]"),
    *("u_V", "voltage", "v_m (V)", "V [mV]", "Vm (V)", "u_PWM [V]"),
    *("torsion angle [deg]", "Verdrehwinkel / °", "joint_deflection", "扭转角度"),
    *("position", "angle", "q", "ActualPosition", "Weg [mm]", "displacement_um", "joint [deg]"),
    *("motor_pos_feedback", "load_position_fbk", "torque_feedback"),
    *("WheelAngle_deg", "Linear Scale [mm]", "AXIS_ENC (arcsec)", "capstan_angle_deg"),
    *("velocity", "speed_rpm", "v [m/s]", "speed_mm/s", "WhlSpd [rpm]"),
    *("force", "Kraft [kN]", "motor_force"),
    # These say too little.
    *("x1", "a1_q_link_deg", "motor", "load [N m]", "motor [bar]", "tau_l", "link_torque", "i"),
    *("u", "temperature", "position_cmd", "position_desired", "motor_link_angle", "q_dot_dot"),
    *("position[0]", "pot_V", "", "torque ²", "Winkel * 2", "q̇_m", "-tau", "T [°C]", "tau*1000"),
    *("last_position", "POS_A", "pos_V", "v", "u [rad]", "position error", "τ̇", "n", "w_m"),
    *("n_m [N]", "w [mm]", "tension", "spring_torque", "torsional torque", "link_deflection"),
    *("twist.linear.x", "input", "scale", "scale [kg]", "linear speed", "alpha"),
    *("theta_ref (rad)", "Vm", "u_pwm", "position_filtered_err", "q_target"),
)


def test_usual_names(golden: Any) -> None:
    """Assert that usual names are recognised as their channel, and ambiguous ones are not."""
    found = {name: usual_channel(name) for name in NAMES}
    golden({repr(name): one[0] if one else "no channel" for name, one in found.items()})


COLUMNS = joint_columns()
TIME, LINK, MOTOR, TORQUE = (
    COLUMNS[name] for name in ("time", "link_position", "motor_position", "motor_torque")
)


def named(*left_out: str, **names: str) -> dict[str, Any]:
    """Return the log without velocities and some channels, with some names changed."""
    columns = without(COLUMNS, "velocity", *left_out)
    return {names.get(name, name): values for name, values in columns.items()}


IN_UNITS = {"t_ms": 1e3 * TIME, "theta_m_deg": np.degrees(MOTOR), "tau_mNm": 1e3 * TORQUE}
STAMPS = np.datetime64("2024-05-01") + (1e6 * TIME).astype("timedelta64[us]")
JOINT_3 = {"link_position": "joint_3_q_l", "motor_position": "joint_3_q_m"}
NUMBERED = {f"{n}_1" if n != "time" else n: v for n, v in COLUMNS.items()}
RIG = {name: f"rig_{name}" for name in COLUMNS if name != "time"}
SPEED = COLUMNS["motor_velocity"]
NAMED: dict[str, dict[str, Any]] = {
    "units in names": {**IN_UNITS, "q_l": LINK, "mode": 0.0 * TIME},
    "own names": COLUMNS | {"tau": 2 * TORQUE, "current": 3 * TORQUE, "theta_m": 4 * MOTOR},
    "a position beside the motor's": named(link_position="q", motor_position="theta_m"),
    "one beside the load's": named(
        link_position="/load_encoder/position", motor_position="/state/position"
    ),
    "one beside a second one": named(link_position="SecondaryPosition", motor_position="Position"),
    "a torque that may be the spring's": named(motor_position="q", motor_torque="joint_torque"),
    "columns of no channel": named() | {"trial": 0 * TIME, "load_torque [N m]": TORQUE},
    "a deflection": named("link") | {"spring_deflection_deg": np.degrees(LINK - MOTOR)},
    "one in another unit": named("link") | {"torsion_V": LINK - MOTOR},
    "a command": named(motor_torque="torque_cmd"),
    "one beside what was measured": named(motor_torque="tau_cmd") | {"tau_m": 2.0 * TORQUE},
    "one beside the same by its own name": named() | {"tau_cmd": 2.0 * TORQUE},
    "two commands": named(motor_torque="tau_cmd") | {"tau_des": 2.0 * TORQUE},
    "the letters of the literature": named(link_position="q", motor_position="theta"),
    "one beside a current": named(motor_torque="tau_ref") | {"motor_strom": 2.0 * TORQUE},
    "a joint with a number": named(**JOINT_3, motor_torque="joint_3_tau"),
    "two of them": NUMBERED | {"q_l_2": np.sin(TIME)},
    "a rig before all names": named(**RIG),
    "a rig before one": named(motor_position="rig_q_m"),
    "stamps by another name": named("time") | {"when": STAMPS},
    "one encoder": {"time": TIME, "position": MOTOR, "velocity": SPEED, "torque": TORQUE},
    "one of a link": {"time": TIME, "link_position": LINK, "velocity": SPEED, "torque": TORQUE},
    "two whole times": named("time") | {"clock_s": TIME, "t_ns": 1e9 * TIME},
    "a time and a stamp": named(time="t_s") | {"header.stamp": TIME + 5.0},
    "times in paths": named(time="out.position.Time") | {"out.link.Time": TIME},
    "a voltage of the q axis": named(time="Target", link_position="Voltage_q"),
    "metres": {"time": TIME, "position [m]": MOTOR, "current [A]": TORQUE},
    "newtons": {"t_s": TIME, "position_m": MOTOR, "force_N": TORQUE},
    "a force without a unit": {"time": TIME, "q_l": LINK, "q_m": MOTOR, "Kraft": TORQUE},
    "a force beside a torque": {"time": TIME, "q_m": MOTOR, "tau": TORQUE, "force": TORQUE},
    "a force beside a current": {"time": TIME, "q_m": MOTOR, "iq": TORQUE, "force_N": TORQUE},
    "a force beside angles": {"time": TIME, "q_l [rad]": LINK, "q_m": MOTOR, "force": TORQUE},
    "metres and radians": {"time": TIME, "q_l [m]": LINK, "q_m [rad]": MOTOR, "tau": TORQUE},
    "a joint behind a capstan": named(
        link_position="joint_angle", motor_position="capstan_angle", motor_torque="iq_filtered_A"
    )
    | {"iq_ref_A": 2.0 * TORQUE, "capstan_angle_ref": 2.0 * MOTOR},
    "a pulley and a drum": named(link_position="drum_angle", motor_position="pulley_angle"),
    "a drum beside the motor's": named(link_position="drum_angle", motor_position="q_m"),
    "a shaft beside the load's": named(link_position="load_angle", motor_position="shaft_angle"),
    "a motor and a wheel": named(link_position="WheelAngle", motor_position="MotorAngle"),
    "their speeds alone": {"t": TIME, "MotSpd": SPEED, "WhlSpd": SPEED + MOTOR, "tau": TORQUE},
    "a filtered torque": named(motor_torque="tau_filtered") | {"tau_ref": 2.0 * TORQUE},
    "one beside the same unfiltered": named(motor_torque="tau") | {"tau_filt": 2.0 * TORQUE},
    "a filtered one beside a current": named(motor_torque="tau_filtered")
    | {"motor_strom": 2.0 * TORQUE},
    "a filtered position": named(motor_position="q_m_filtered") | {"q_m_set": 2.0 * MOTOR},
    "one beside a raw one": named(motor_position="q_m") | {"q_m_filtered": 2.0 * MOTOR},
    "one without a side": named("link", motor_position="theta_m") | {"theta_filt": MOTOR},
    "one of the joint": named(link_position="joint_angle_filt", motor_position="theta_m"),
    "one alone": named("link", motor_position="position_filtered"),
    "a filtered speed without a side": {
        "t": TIME,
        "MotSpd": SPEED,
        "vel_lpf": SPEED,
        "tau": TORQUE,
    },
    "a voltage and a PWM's": {"t": TIME, "pos": MOTOR, "PWM voltage": SPEED, "voltage": TORQUE},
    "a position and a scale": {"t": TIME, "scale [mm]": LINK, "pos [mm]": MOTOR, "force": TORQUE},
    "a drum and a scale": {"t": TIME, "scale [mm]": LINK, "drum pos [mm]": MOTOR, "force": TORQUE},
    "a mark before encoders": named(
        link_position="AZ_AXIS_ENC", motor_position="AZ_MOTOR_ENC", motor_torque="AZ_TRQ_CMD"
    ),
    "the letters of Quanser": named("link", motor_position="Theta", motor_torque="Vm (V)")
    | {"alpha (rad)": LINK - MOTOR, "theta_ref": MOTOR},
    "an angular acceleration": named("link", motor_position="theta")
    | {"alpha [rad/s^2]": LINK - MOTOR},
    "a setpoint and an error": named("link") | {"link_position_ref": LINK, "link error": LINK},
    "two names": named("motor_position") | {"theta_m": MOTOR, "motor_angle": 2.0 * MOTOR},
}


def test_names_of_columns(golden: Any) -> None:
    """Assert that recognised columns are reported, and that two for one channel are refused."""
    golden({name: said(read_columns, columns) for name, columns in NAMED.items()})


def test_seconds_and_the_nanoseconds_beyond_them_are_one_time() -> None:
    """Assert the time of ROS, to 10 ns although some 1.7e9 s have passed since its epoch."""
    nanoseconds = np.round(1e9 * TIME).astype(np.int64) + 1_700_000_000_300_000_000
    parts = dict(zip(("stamp_sec", "stamp_nanosec"), np.divmod(nanoseconds, 10**9), strict=True))
    (recording,) = read_columns(named("time") | parts).recordings
    assert recording.sample_time == pytest.approx(TIME[1] - TIME[0], abs=1e-8)
    assert recording.motor_position == pytest.approx(MOTOR, abs=1e-7)


UNITS = (
    *("deg", "°", "DEGREES", "mdeg", "arcmin", "arcsec", "turn", "rev", "rad", "mrad", "urad"),
    *("µrad",),
    *("mrad/s", "deg/s", "turns/s", "rpm", "U/min", "1/min", "rad s^-1", "rad/sec"),
    *("Nm", "N·m", "N\u22c5m", "N.m", "Newton metre", "uNm", "mNm", "Nmm", "Ncm", "kN m"),
    *("kgf m", "kgf cm", "lbf ft", "lbf in", "ozf in", "kg*cm", "lbf·ft", "N * mm"),
    *("m", "cm", "mm", "millimetres", "1e-3 m", "um", "µm", "micron", "inch"),
    *("m/s", "m s^-1", "cm/s", "mm/s", "um/s", "m/min", "mm/min"),
    *("N", "mN", "kN", "kgf", "lbf"),
    *("V", "mV"),
    *("A", "mA"),
    *("ns", "us", "µs", "ms", "Sec", "sek."),
)
REFUSED = (  # other dimensions, some alike by accident, and texts that are no unit
    *("Hz", "1/s", "Ms", "as", "MS", "N m/rad", "m", "rad^2", "", "percent", "‰", "Grad", "counts"),
    *("mm", "N", "mm/s"),
    *("furlongs!", "9^9^9", "km^9999", "km²³²³²³", "rad/", "__x", "("),
)


def test_units_that_are_refused(golden: Any) -> None:
    """Assert that the message names a unit to use instead."""
    turns = dict.fromkeys(REFUSED, ("s", "rad", "rad/s", "N m", "V", "A"))
    slides = dict.fromkeys(("MM", "deg", "mN m", "cnts", "%"), ("m", "N"))
    found = {}
    for text, units in (turns | slides).items():
        with pytest.raises(UnitError) as caught:
            scale_to_si(text, units)
        found[repr(text)] = str(caught.value)
    golden(found)


def test_units(golden: Any) -> None:
    """Assert factor and SI unit in any spelling, and that symbols alone are case-sensitive."""
    found = {text: scale_to_si(text, tuple(EXAMPLES)) for text in UNITS}
    golden({text: f"{factor:.12g} {si_unit}" for text, (factor, si_unit) in found.items()})
    assert all(map(is_usual, ("kHz", "Volts", "s")))
    assert not any(map(is_usual, ("S", "v", "speed")))
