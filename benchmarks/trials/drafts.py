"""Draft of a drive before its motion is known, with values relative to torque and deflection."""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.size import sized
from benchmarks.trials.integrator import Drive


@dataclass
class Draft:
    """Random draft of a family, which becomes a `Drive` once the size of the motion is known.

    Parameters
    ----------
    base : Drive
        Absolute values.
    resonance : float
        Resonance of link against motor, in rad/s.
    band : float
        Approximate highest frequency of the torque, in rad/s.
    target : float
        Half the desired range of the link, in rad.
    of_torque : dict of str to float
        Fields of the drive, as shares of the torque's root mean square.
    cubic, hysteresis, hysteresis_reach, bend : float
        Share of the spring's torque at the largest deflection; share of the spring's torque; and
        two deflections over the deflection's root mean square.
    presliding : float
        Presliding displacement of LuGre friction, in rad.
    torque_noise : float
        Unlogged part of the acting torque, over the torque's root mean square.
    input_delay, link_delay : float
        In s, positive if the torque acts later, and if the link is recorded earlier, as in flexid.
    link_zero, motor_zero, torque_zero : float
        Offsets of the recorded values; the last over the torque's root mean square.
    controlled : bool
        Whether a position controller moves the drive.
    motion : {"sines", "steps", "moves"}
        Kind of torque; for "moves", of the controller's reference.
    jolted : bool
        Whether a stepped torque acts before the log begins and steps at its beginning.
    durations : tuple of float
        Shortest and longest log in s.
    longest : float
        Longest step of the integrator in s.
    holds : tuple of str
        Holds to choose from.
    bits : tuple of int
        Smallest and largest number of bits of the encoders.
    noise : tuple of float
        Smallest and largest noise of encoders without rounding, in rad.
    visible : tuple of float
        Smallest and largest deflection in multiples of the encoder's error.
    faint : float
        Deflection in multiples of the encoder's error, for which encoders are chosen; zero if
        encoders are random.
    smallest : float
        Smallest deflection in rad.
    jitter : float
        Jitter of the sampling instants, over the sample time.
    stamps : {"true", "nominal"}
        Time stamps of the log.
    lost : {"", "missing", "stale"}
        Fault of a few samples.
    """

    base: Drive
    resonance: float
    band: float
    target: float
    of_torque: dict[str, float] = field(default_factory=dict)
    cubic: float = 0.0
    hysteresis: float = 0.0
    hysteresis_reach: float = 0.0
    bend: float = 0.0
    presliding: float = 0.0
    torque_noise: float = 0.0
    input_delay: float = 0.0
    link_delay: float = 0.0
    link_zero: float = 0.0
    motor_zero: float = 0.0
    torque_zero: float = 0.0
    controlled: bool = False
    motion: str = "sines"
    jolted: bool = False
    durations: tuple[float, float] = sized((12.0, 30.0), (6.0, 7.0))
    longest: float = 5e-5
    holds: tuple[str, ...] = ("zero", "smooth")
    bits: tuple[int, int] = (13, 18)
    noise: tuple[float, float] = (2e-5, 3e-4)
    visible: tuple[float, float] = (20.0, np.inf)
    faint: float = 0.0
    smallest: float = 1e-3
    jitter: float = 0.0
    stamps: str = "true"
    lost: str = ""


@dataclass(frozen=True)
class Size:
    """Size of a motion: root mean squares and peaks of torque and deflection."""

    torque: float
    torque_peak: float
    deflection: float
    deflection_peak: float


def realised(draft: Draft, size: Size) -> Drive:
    """Return the drive of a draft for a size of the motion."""
    drive = draft.base._replace(peak_torque=size.torque_peak)
    drive = drive._replace(**{name: share * size.torque for name, share in draft.of_torque.items()})
    stiffness = drive.joint_stiffness
    if draft.cubic:
        drive = drive._replace(cubic_stiffness=draft.cubic * stiffness / size.deflection_peak**2)
    if draft.hysteresis:
        drive = drive._replace(
            hysteresis_torque=draft.hysteresis * stiffness * np.sqrt(2.0) * size.deflection,
            hysteresis_reach=draft.hysteresis_reach * size.deflection,
        )
    if draft.bend:
        drive = drive._replace(bend=draft.bend * size.deflection)
    if draft.presliding:
        bristle = drive.bristle_coulomb / draft.presliding
        damping = np.sqrt(bristle * drive.motor_inertia)  # half of critical
        drive = drive._replace(bristle_stiffness=bristle, bristle_damping=damping)
    return drive


def truth(draft: Draft, drive: Drive, size: Size) -> dict[str, float]:
    """Return the true physical parameters by flexid's names, for the channels as logged.

    An offset of an encoder shifts the gravity angle, and the difference of both offsets adds a
    torque of the spring. Two masses act as one at an angle in between.
    """
    pull = drive.gravity_torque * np.exp(1j * drive.gravity_angle)
    pull += drive.payload_torque * np.exp(1j * drive.payload_angle)
    stretch = drive.joint_stiffness * (draft.link_zero - draft.motor_zero)
    coulomb = 0.5 * (drive.motor_coulomb_up + drive.motor_coulomb_down) + drive.bristle_coulomb
    uneven = 0.5 * (drive.motor_coulomb_down - drive.motor_coulomb_up)
    values = {"gravity_torque": float(abs(pull))}
    if abs(pull) > 0.0:
        values["gravity_angle"] = float(np.angle(pull)) + draft.link_zero
    return values | {
        "link_inertia": drive.link_inertia,
        "joint_stiffness": drive.joint_stiffness,
        "motor_inertia": drive.motor_inertia,
        "motor_viscous_friction": drive.motor_viscous,
        "motor_coulomb_friction": coulomb,
        "motor_offset_torque": drive.motor_offset
        + uneven
        - draft.torque_zero * size.torque
        - stretch,
        "joint_damping": drive.joint_damping,
        "cubic_joint_stiffness": drive.cubic_stiffness,
        "spring_hysteresis": drive.hysteresis_torque,
        "hysteresis_reach": drive.hysteresis_reach if drive.hysteresis_torque else 0.0,
        "link_viscous_friction": drive.link_viscous,
        "link_coulomb_friction": drive.link_coulomb,
        "link_offset_torque": drive.link_offset + stretch,
        "half_backlash": drive.half_gap,
        "bend_stiffness": drive.bend_stiffness,
        "eccentricity": drive.eccentricity,
        "eccentricity_angle": -drive.eccentricity_phase,
        "transmission_error": drive.transmission_error,
        "transmission_error_angle": -drive.transmission_phase,
        "second_transmission_error": drive.second_transmission_error,
        "second_transmission_error_angle": -drive.second_transmission_phase,
        "motor_stribeck_friction": drive.motor_static,
        "torque_ripple": drive.ripple_torque,
        "ripple_angle": -drive.ripple_phase,
        "torque_saturation": drive.saturation / drive.peak_torque**2,
        "input_delay": draft.input_delay,
        "link_delay": draft.link_delay,
    }


_TERMS = {
    "gravity_torque": "gravity",
    "gravity_angle": "gravity_cosine",
    "motor_viscous_friction": "motor_viscous",
    "link_viscous_friction": "link_viscous",
    "joint_damping": "joint_damping",
    "motor_coulomb_friction": "motor_coulomb",
    "link_coulomb_friction": "link_coulomb",
    "cubic_joint_stiffness": "cubic_stiffness",
    "spring_hysteresis": "spring_hysteresis",
    "link_offset_torque": "link_offset",
    "motor_offset_torque": "motor_offset",
    "half_backlash": "backlash",
    "bend_stiffness": "bent_spring",
    "eccentricity": "eccentricity",
    "transmission_error": "transmission_error",
    "motor_stribeck_friction": "motor_stribeck",
    "torque_ripple": "torque_ripple",
    "torque_saturation": "torque_saturation",
}
"""Term that contains each parameter."""


def acting(values: dict[str, float]) -> tuple[str, ...]:
    """Return flexid's terms for the parameters that are not zero."""
    return tuple(term for name, term in _TERMS.items() if values.get(name, 0.0) != 0.0)
