"""Families of random drives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.trials.drafts import Draft
from benchmarks.trials.integrator import Drive

Generator = np.random.Generator


@dataclass(frozen=True)
class Family:
    """Family of drives.

    Parameters
    ----------
    name, about : str
        Name, and a description of one line.
    in_class : bool
        Whether flexid's usual terms describe the drive exactly.
    change : callable
        Function that adds the family's properties to the basic drive.
    has_gravity : bool, optional
    own_term : bool, optional
        Whether an unusual term describes the rest.
    resonances : tuple of float, optional
        Lowest and highest resonance of link against motor, in rad/s.
    """

    name: str
    about: str
    in_class: bool
    change: Callable[[Generator, Draft], None]
    has_gravity: bool = True
    own_term: bool = False
    resonances: tuple[float, float] = (8.0, 45.0)

    def draw(self, rng: Generator) -> Draft:
        """Draw a draft of a drive."""
        harmonic = self.name == "harmonic_drive"
        draft = _harmonic(rng) if harmonic else _basic(rng, self.has_gravity, self.resonances)
        self.change(rng, draft)
        return draft


def _log(rng: Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _basic(rng: Generator, has_gravity: bool, resonances: tuple[float, float]) -> Draft:
    """Draw inertias, spring, gravity and the motor's viscous friction, common to all families."""
    link = _log(rng, 0.02, 2.0)
    motor = link * _log(rng, 0.2, 5.0)
    resonance = _log(rng, *resonances)
    stiffness = resonance**2 * link * motor / (link + motor)
    fastest = min(8.0, 0.5 * np.sqrt(stiffness / link))
    pendulum = _log(rng, 1.0, max(fastest, 1.1))
    drive = Drive(
        link_inertia=link,
        motor_inertia=motor,
        joint_stiffness=stiffness,
        gravity_torque=link * pendulum**2 if has_gravity else 0.0,
        motor_viscous=(link + motor) / _log(rng, 0.3, 5.0),
    )
    return Draft(drive, resonance, resonance, target=_log(rng, 0.3, 1.9))


def _harmonic(rng: Generator) -> Draft:
    """Draw values like an arm's harmonic drive: stiff, with much friction."""
    while True:
        stiffness, motor = _log(rng, 5e3, 3e4), _log(rng, 0.7, 1.5)
        resonance = _log(rng, 70.0, 150.0)
        reduced = stiffness / resonance**2
        if 0.3 < (link := reduced * motor / max(motor - reduced, 1e-9)) < 10.0:
            break
    friction = rng.uniform(8.0, 16.0)
    drive = Drive(
        link_inertia=link,
        motor_inertia=motor,
        joint_stiffness=stiffness,
        gravity_torque=link * _log(rng, 2.0, 6.0) ** 2,
        motor_viscous=(link + motor) / _log(rng, 0.15, 1.0),
        motor_coulomb_up=friction,
        motor_coulomb_down=friction,
    )
    draft = Draft(drive, resonance, 0.4 * resonance, _log(rng, 0.3, 1.5), holds=("zero",))
    draft.bits, draft.noise, draft.visible = (16, 20), (5e-6, 5e-5), (10.0, np.inf)
    draft.smallest = 3e-4
    draft.controlled = bool(rng.random() < 0.3)
    return draft


def _nothing(_: Generator, __: Draft) -> None:
    pass


def _damping_link_friction(rng: Generator, draft: Draft) -> None:
    reduced = draft.base.joint_stiffness / draft.resonance**2
    draft.base = draft.base._replace(
        joint_damping=2.0 * _log(rng, 0.005, 0.05) * draft.resonance * reduced,
        link_viscous=draft.base.link_inertia / _log(rng, 1.0, 10.0),
    )


def _both_delays(rng: Generator, draft: Draft) -> None:
    draft.input_delay, draft.link_delay = rng.uniform(0.0, 5e-3), rng.uniform(-3e-3, 3e-3)


def _torque_noise(_: Generator, draft: Draft) -> None:
    draft.torque_noise = 0.02


def _weak_input(rng: Generator, draft: Draft) -> None:
    draft.target /= rng.uniform(5.0, 10.0)
    draft.visible, draft.smallest = (4.0, 25.0), 0.0
    draft.faint = _log(rng, 5.0, 20.0)


def _coulomb(rng: Generator, draft: Draft) -> None:
    share = rng.uniform(0.05, 0.25)
    draft.of_torque |= {"motor_coulomb_up": share, "motor_coulomb_down": share}
    if rng.random() < 0.3:
        draft.of_torque["link_coulomb"] = rng.uniform(0.02, 0.1)


def _some_coulomb(rng: Generator, draft: Draft) -> None:
    share = rng.uniform(0.05, 0.2)
    draft.of_torque |= {"motor_coulomb_up": share, "motor_coulomb_down": share}


def _closed_loop_friction(rng: Generator, draft: Draft) -> None:
    _some_coulomb(rng, draft)
    draft.controlled = True


def _offsets_tilted_friction(rng: Generator, draft: Draft) -> None:
    _some_coulomb(rng, draft)
    draft.of_torque["motor_offset"] = rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.2)
    angle = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.4)
    draft.base = draft.base._replace(gravity_angle=float(angle))
    draft.link_zero, draft.motor_zero = rng.uniform(-5e-3, 5e-3, 2)
    draft.torque_zero = rng.uniform(-0.05, 0.05)


def _asymmetric_coulomb(rng: Generator, draft: Draft) -> None:
    share, uneven = rng.uniform(0.05, 0.25), rng.uniform(0.1, 0.5) * rng.choice([-1.0, 1.0])
    draft.of_torque |= {
        "motor_coulomb_up": share * (1.0 + uneven),
        "motor_coulomb_down": share * (1.0 - uneven),
    }


def _cubic_spring(rng: Generator, draft: Draft) -> None:
    draft.cubic = _log(rng, 0.05, 0.5)


def _torque_steps(rng: Generator, draft: Draft) -> None:
    draft.motion, draft.holds, draft.durations = "steps", ("zero",), _SHORT
    draft.jolted = bool(rng.random() < 0.5)
    if rng.random() < 0.5:
        _some_coulomb(rng, draft)


def _point_to_point(rng: Generator, draft: Draft) -> None:
    draft.motion, draft.controlled, draft.durations = "moves", True, _SHORT
    if rng.random() < 0.5:
        _some_coulomb(rng, draft)
    plain = draft.base
    _damping_link_friction(rng, draft)
    if rng.random() < 0.7:
        draft.base = draft.base._replace(joint_damping=plain.joint_damping)
    if rng.random() < 0.7:
        draft.base = draft.base._replace(link_viscous=plain.link_viscous)
    if rng.random() < 0.3:
        draft.input_delay = rng.uniform(0.0, 5e-3)


def _fast_joint(rng: Generator, draft: Draft) -> None:
    draft.band = draft.resonance * rng.uniform(0.4, 0.75)  # no tone is far above the resonance
    draft.smallest = 3e-4
    draft.longest = 2.0**-16  # many such steps add up without rounding
    if rng.random() < 0.5:
        _some_coulomb(rng, draft)


def _lugre(rng: Generator, draft: Draft) -> None:
    coulomb = rng.uniform(0.05, 0.2)
    static = coulomb * rng.uniform(1.2, 1.8)
    draft.of_torque |= {"bristle_coulomb": coulomb, "bristle_static": static}
    draft.base = draft.base._replace(stribeck_velocity=_log(rng, 0.01, 0.1))
    draft.presliding = _log(rng, 1e-4, 2e-3)


def _stribeck(rng: Generator, draft: Draft) -> None:
    _some_coulomb(rng, draft)
    draft.of_torque["motor_static"] = draft.of_torque["motor_coulomb_up"] * rng.uniform(0.2, 1.0)
    draft.base = draft.base._replace(stribeck_velocity=_log(rng, 0.02, 0.5))


def _ripple(rng: Generator, draft: Draft) -> None:
    _some_coulomb(rng, draft)
    draft.of_torque["ripple_torque"] = _log(rng, 0.01, 0.05)
    number, phase = float(rng.integers(6, 61)), rng.uniform(0.0, 2.0 * np.pi)
    draft.base = draft.base._replace(ripple_number=number, ripple_phase=phase)


def _backlash(rng: Generator, draft: Draft) -> None:
    draft.base = draft.base._replace(half_gap=0.5 * _log(rng, 2e-4, 2e-3))


def _hysteresis(rng: Generator, draft: Draft) -> None:
    draft.hysteresis = rng.uniform(0.02, 0.08)
    draft.hysteresis_reach = _log(rng, 0.1, 1.0)


def _hysteresis_other(rng: Generator, draft: Draft) -> None:
    _hysteresis(rng, draft)
    draft.base = draft.base._replace(hysteresis_power=rng.uniform(1.5, 4.0))


def _eccentricity(rng: Generator, draft: Draft) -> None:
    size, phase = _log(rng, 1e-4, 1e-3), rng.uniform(0.0, 2.0 * np.pi)
    draft.base = draft.base._replace(eccentricity=size, eccentricity_phase=phase)


def _transmission_error(rng: Generator, draft: Draft) -> None:
    first, second = rng.uniform(0.0, 2.0 * np.pi, 2)
    draft.base = draft.base._replace(
        transmission_number=float(rng.integers(30, 161)),
        transmission_error=_log(rng, 2e-5, 2e-4),
        transmission_phase=first,
        second_transmission_error=_log(rng, 2e-5, 2e-4),
        second_transmission_phase=second,
    )


def _payload_off_axis(rng: Generator, draft: Draft) -> None:
    pull = draft.base.gravity_torque * rng.uniform(0.1, 0.8)
    angle = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.6)
    draft.base = draft.base._replace(
        gravity_torque=draft.base.gravity_torque - 0.5 * pull,
        payload_torque=pull,
        payload_angle=float(angle),
    )


def _saturating_torque(rng: Generator, draft: Draft) -> None:
    draft.base = draft.base._replace(saturation=rng.uniform(0.03, 0.1))


def _clock_jitter(rng: Generator, draft: Draft) -> None:
    draft.jitter = rng.uniform(0.02, 0.1)
    draft.stamps = str(rng.choice(["true", "nominal"]))


def _dropped_sample(rng: Generator, draft: Draft) -> None:
    draft.lost = str(rng.choice(["missing", "missing", "stale"]))


def _spring_other(rng: Generator, draft: Draft) -> None:
    gain = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.4)
    draft.bend = rng.uniform(0.5, 1.5)
    draft.base = draft.base._replace(bend_stiffness=float(gain) * draft.base.joint_stiffness)


def _two_at_once(rng: Generator, draft: Draft) -> None:
    springs = _backlash, _spring_other  # mutually exclusive
    extra = (_stribeck, _ripple, _eccentricity, springs[rng.integers(2)])
    for place in rng.choice(len(extra), 2, replace=False):
        extra[place](rng, draft)


_SHORT = (6.0, 20.0)  # s, of a log

_ALL = (
    Family("basic", "gravity and viscous friction of the motor", True, _nothing),
    Family(
        "damping_link_friction",
        "damping of the spring, viscous friction of the link",
        True,
        _damping_link_friction,
    ),
    Family(
        "both_delays",
        "torque up to 5 ms late, link's encoder up to 3 ms early or late",
        True,
        _both_delays,
    ),
    Family("no_gravity", "viscous friction of the motor only", True, _nothing, False),
    Family("torque_noise", "2 % white noise on the torque that acts", True, _torque_noise),
    Family(
        "weak_input",
        "5 to 10 times weaker: deflection 5 to 20 times the encoder's error",
        True,
        _weak_input,
    ),
    Family(
        "coulomb",
        "set-valued Coulomb friction, 5 to 25 % of the torque; in three of ten on the link too",
        True,
        _coulomb,
    ),
    Family(
        "closed_loop_friction",
        "position controller on the motor's encoder, Coulomb friction",
        True,
        _closed_loop_friction,
    ),
    Family(
        "offsets_tilted_friction",
        "offsets of torque and encoders, tilted gravity, Coulomb friction",
        True,
        _offsets_tilted_friction,
    ),
    Family(
        "asymmetric_coulomb",
        "Coulomb friction that differs between the directions: an even one and an offset",
        True,
        _asymmetric_coulomb,
    ),
    Family("cubic_spring", "a hardening spring with a cubic term", True, _cubic_spring),
    Family(
        "harmonic_drive",
        "stiff, resonance 70 to 150 rad/s, Coulomb friction 8 to 16 N m, held torque",
        True,
        _nothing,
    ),
    Family(
        "payload_off_axis",
        "a second mass at an angle; in the class, as gravity with a tilt",
        True,
        _payload_off_axis,
    ),
    Family("hysteresis", "spring hysteresis after Dahl, 2 to 8 % of its torque", True, _hysteresis),
    Family(
        "torque_steps",
        "torque in random steps or switched to and fro, 6 to 20 s; half of them begin in full "
        "swing; Coulomb friction in half",
        True,
        _torque_steps,
    ),
    Family(
        "point_to_point",
        "position controller from rest to rest, 6 to 20 s; Coulomb friction in half, damping, "
        "friction of the link or a late torque in three of ten each",
        True,
        _point_to_point,
    ),
    Family(
        "fast_joint",
        "resonance 94 to 314 rad/s, Coulomb friction in half",
        True,
        _fast_joint,
        resonances=(94.0, 314.0),
    ),
    Family("lugre", "LuGre friction with Stribeck effect and presliding", False, _lugre),
    Family(
        "stribeck",
        "Stribeck friction: 20 to 100 % more at rest, decaying over 0.02 to 0.5 rad/s",
        False,
        _stribeck,
        own_term=True,
    ),
    Family(
        "ripple",
        "torque ripple by the motor's angle, 1 to 5 % of the torque, and Coulomb friction",
        False,
        _ripple,
        own_term=True,
    ),
    Family(
        "backlash",
        "backlash: dead zone of 0.2 to 2 mrad in the spring",
        False,
        _backlash,
        own_term=True,
    ),
    Family(
        "hysteresis_other",
        "spring hysteresis after Bouc and Wen, with powers of 1.5 to 4",
        False,
        _hysteresis_other,
    ),
    Family(
        "eccentricity",
        "error of the gear once per turn, 0.1 to 1 mrad, after the motor's encoder",
        False,
        _eccentricity,
        own_term=True,
    ),
    Family(
        "transmission_error",
        "error of the gear with 30 to 160 periods per turn, two harmonics of 0.02 to 0.2 mrad",
        False,
        _transmission_error,
        own_term=True,
    ),
    Family(
        "saturating_torque",
        "saturation: 3 to 10 % of the torque is lost at its peak",
        False,
        _saturating_torque,
        own_term=True,
    ),
    Family(
        "clock_jitter",
        "sampled 2 to 10 % of a sample early or late; true or nominal times in the log",
        False,
        _clock_jitter,
    ),
    Family(
        "dropped_sample",
        "a few samples missing, or repeated with new times",
        False,
        _dropped_sample,
    ),
    Family(
        "spring_other",
        "a spring whose stiffness changes at a deflection",
        False,
        _spring_other,
        own_term=True,
    ),
    Family(
        "two_at_once",
        "two of: Stribeck friction, ripple, an eccentric gear, backlash, a change of stiffness",
        False,
        _two_at_once,
        own_term=True,
    ),
)

FAMILIES: Mapping[str, Family] = {family.name: family for family in _ALL}
"""Families by name, those in the model class first."""
