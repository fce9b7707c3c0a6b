"""Families of realistic drives, with random imperfections."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.size import sized
from benchmarks.trials.realistic.drafts import Draft, Sensor
from benchmarks.trials.realistic.drive import Plant

Generator = np.random.Generator


@dataclass(frozen=True)
class RealisticFamily:
    """A kind of rig: name, description of one line, and the function that draws it."""

    name: str
    about: str
    draw: Callable[[Generator], Draft]


def _log(rng: Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _chance(rng: Generator, share: float) -> bool:
    return bool(rng.random() < share)


def _basic(
    rng: Generator, resonances: tuple[float, float], paces: tuple[int, ...], gravity: float
) -> Draft:
    """Draw inertias, spring, perhaps gravity, viscous friction, and a suitable sampling rate."""
    link = _log(rng, 0.02, 2.0)
    motor = link * _log(rng, 0.3, 5.0)
    fastest = min(resonances[1], 2.0 * np.pi * max(paces) / 8.0)
    resonance = _log(rng, resonances[0], fastest)
    reduced = link * motor / (link + motor)
    plant = Plant(
        near_inertia=link,
        motor_inertia=motor,
        joint_stiffness=resonance**2 * reduced,
        joint_damping=2.0 * _log(rng, 0.003, 0.03) * resonance * reduced,
        motor_viscous=(link + motor) / _log(rng, 0.3, 3.0),
    )
    if _chance(rng, gravity):
        pendulum = _log(rng, 1.0, max(min(8.0, 0.4 * resonance * np.sqrt(reduced / link)), 1.1))
        plant = plant._replace(gravity_torque=link * pendulum**2)
    motion = str(rng.choice(["multisine", "multisine", "binary", "square", "tracking", "moves"]))
    enough = [pace for pace in paces if 2.0 * np.pi * pace >= 8.0 * resonance]
    return Draft(
        plant,
        resonance,
        float(rng.choice(enough)),
        duration=sized(1.0, 0.3) * _log(rng, 10.0, 40.0),
        motion=motion,
        target=_log(rng, 0.3, 1.6),
        dither=_log(rng, 0.15, 0.5) if _chance(rng, 0.75) else 0.0,
        highest=rng.uniform(0.8, 1.4),
        held=_chance(rng, 0.6),
    )


def _dry(rng: Generator, draft: Draft, low: float, high: float) -> None:
    draft.sins["coulomb"] = draft.shares["coulomb"] = rng.uniform(low, high)


def _stribeck(rng: Generator, draft: Draft) -> None:
    extra = rng.uniform(0.1, 0.5)
    draft.shares["static_extra"] = draft.shares["coulomb"] * extra
    draft.change(stribeck_velocity=_log(rng, 0.02, 0.3))
    draft.sins["static_extra"] = extra


def _warming(rng: Generator, draft: Draft) -> None:
    draft.change(drift=rng.uniform(0.1, 0.4), drift_time=_log(rng, 4.0, 30.0))
    draft.sins["friction_drift"] = draft.plant.drift


def _ripple(rng: Generator, draft: Draft, number: float, low: float, high: float) -> None:
    size = _log(rng, low, high)
    draft.shares |= {"ripple": size, "ripple_second": 0.3 * size}
    draft.change(ripple_number=number, ripple_phase=rng.uniform(0.0, 2.0 * np.pi))
    draft.sins["ripple"] = size


def _pushes(rng: Generator, draft: Draft, low: float, high: float) -> None:
    draft.shares["link_push"] = _log(rng, low, high)
    draft.shares["motor_push"] = _log(rng, low, high)
    draft.push_time = _log(rng, 0.03, 1.0)
    draft.sins |= {name: draft.shares[name] for name in ("link_push", "motor_push")}
    draft.sins["push_time"] = draft.push_time


def _second_mode(rng: Generator, draft: Draft) -> None:
    """Put part of the link's inertia beyond a second spring."""
    plant, share, ratio = draft.plant, rng.uniform(0.03, 0.15), rng.uniform(2.0, 6.0)
    tip = share * plant.near_inertia
    own = ratio * draft.resonance  # resonance of the tip with the link held
    draft.change(
        near_inertia=plant.near_inertia - tip,
        tip_inertia=tip,
        tip_stiffness=tip * own**2,
        tip_damping=2.0 * _log(rng, 0.003, 0.02) * own * tip,
    )
    draft.sins |= {"second_mode": ratio, "second_mode_inertia": share}


def _cable(rng: Generator, draft: Draft) -> None:
    draft.sins["cable"] = draft.shares["cable"] = rng.uniform(0.01, 0.05)
    draft.change(cable_angle=rng.uniform(-0.5, 0.5))


def _lag(rng: Generator, draft: Draft, low: float, high: float) -> None:
    lag = min(_log(rng, low, high), 0.2 / draft.resonance)
    draft.sins["current_lag"] = lag
    draft.change(lag=lag)


def _voltage(rng: Generator, draft: Draft) -> None:
    """Add the amplifier, back-EMF and a coil, whose lag times the back-EMF's rate is below 1 %."""
    rate = _log(rng, 3.0, 40.0)
    lag = min(_log(rng, 2e-4, 2e-3), 0.01 / rate)
    draft.change(back_emf=rate * draft.plant.motor_inertia, lag=lag)
    draft.change(motor_viscous=draft.plant.motor_viscous * rng.uniform(0.1, 0.6))
    draft.volts = _log(rng, 1.5, 12.0)
    draft.sins |= {"back_emf": rate, "coil_lag": lag}
    if _chance(rng, 0.7):
        draft.sins["dead_zone"] = draft.shares["dead_zone"] = rng.uniform(0.005, 0.04)
    if draft.motion not in ("binary", "square") and _chance(rng, 0.5):
        draft.sins["saturation"] = draft.shares["saturation"] = rng.uniform(0.75, 0.95)


def _voltage_drive(rng: Generator) -> Draft:
    draft = _basic(rng, (12.0, 60.0), (100, 200, 250, 500), 0.85)
    _voltage(rng, draft)
    _dry(rng, draft, 0.02, 0.12)
    for share, sin in ((0.5, _stribeck), (0.4, _warming)):
        if _chance(rng, share):
            sin(rng, draft)
    if _chance(rng, 0.4):
        _ripple(rng, draft, float(rng.integers(6, 61)), 0.005, 0.03)
    if _chance(rng, 0.4):
        _pushes(rng, draft, 0.01, 0.03)
    draft.motor = Sensor(rng.uniform(13.0, 16.0)) if _chance(rng, 0.5) else _converter(rng, 10)
    draft.link = Sensor(int(rng.integers(11, 14))) if _chance(rng, 0.4) else _converter(rng, 8)
    return draft


def _converter(rng: Generator, fewest: int) -> Sensor:
    return Sensor(int(rng.integers(fewest, 13)), rng.uniform(1.15, 1.6), rng.uniform(0.0, 1.0))


def _strain_gauge_arm(rng: Generator) -> Draft:
    draft = _basic(rng, (12.0, 40.0), (50, 100, 200), 0.0)
    draft.motion = str(rng.choice(["square", "binary", "multisine", "square", "binary", "moves"]))
    _voltage(rng, draft)
    _dry(rng, draft, 0.02, 0.12)
    _second_mode(rng, draft)
    for share, sin in ((0.4, _stribeck), (0.3, _warming)):
        if _chance(rng, share):
            sin(rng, draft)
    if _chance(rng, 0.4):
        _pushes(rng, draft, 0.01, 0.03)
    draft.has_gauge = True
    draft.gauge_scale = 1.0 + rng.uniform(-0.03, 0.03)
    draft.gauge_drift = _log(rng, 0.005, 0.05)
    draft.change(gauge_lag=_log(rng, 5e-4, 4e-3))
    draft.motor = Sensor(int(rng.integers(10, 13)), rng.uniform(1.15, 1.6), rng.uniform(0.3, 1.5))
    draft.link = Sensor(int(rng.integers(10, 13)), rng.uniform(1.3, 3.0), rng.uniform(0.3, 2.0))
    draft.sins |= {
        "gauge_scale": draft.gauge_scale,
        "gauge_drift": draft.gauge_drift,
        "gauge_lag": draft.plant.gauge_lag,
    }
    return draft


def _current_drive(rng: Generator) -> Draft:
    draft = _basic(rng, (20.0, 120.0), (250, 500, 1000), 0.8)
    _lag(rng, draft, 5e-4, 3e-3)
    _dry(rng, draft, 0.05, 0.2)
    _stribeck(rng, draft)
    _warming(rng, draft)
    _ripple(rng, draft, float(rng.integers(6, 61)), 0.01, 0.04)
    if _chance(rng, 0.6):
        _cable(rng, draft)
    draft.motor = Sensor(int(rng.integers(13, 17)))
    draft.link = Sensor(int(rng.integers(12, 17)))
    return draft


def _disturbed_arm(rng: Generator) -> Draft:
    draft = _basic(rng, (12.0, 60.0), (100, 200, 250, 500), 1.0)
    _pushes(rng, draft, 0.01, 0.06)
    _second_mode(rng, draft)
    if _chance(rng, 0.5):
        _dry(rng, draft, 0.03, 0.15)
        _stribeck(rng, draft)
    if _chance(rng, 0.4):
        _lag(rng, draft, 5e-4, 2e-3)
    draft.motor = Sensor(int(rng.integers(12, 16)))
    draft.link = Sensor(int(rng.integers(12, 15))) if _chance(rng, 0.6) else _converter(rng, 10)
    return draft


_TORQUES = (
    "near_inertia",
    "motor_inertia",
    "joint_stiffness",
    "joint_damping",
    "motor_viscous",
    "gravity_torque",
)
"""Fields of the plant that are proportional to the size of a drive."""


def _harmonic_rig(rng: Generator) -> Draft:
    draft = _basic(rng, (50.0, 130.0), (500, 1000), 1.0)
    size = _log(rng, 5e3, 3e4) / draft.plant.joint_stiffness
    draft.change(**{name: size * getattr(draft.plant, name) for name in _TORQUES})
    _dry(rng, draft, 0.1, 0.3)
    _warming(rng, draft)
    if _chance(rng, 0.5):
        _stribeck(rng, draft)
    _ripple(rng, draft, 2.0 * float(rng.integers(50, 161)), 0.01, 0.03)
    _lag(rng, draft, 5e-4, 2e-3)
    draft.sins["eccentricity"] = draft.eccentricity = rng.uniform(0.005, 0.03)
    draft.highest, draft.largest = 0.5 * draft.highest, 0.015
    draft.motor, draft.link = Sensor(rng.uniform(17.0, 20.0)), Sensor(int(rng.integers(16, 20)))
    return draft


def _poor_logger(rng: Generator) -> Draft:
    draft = _basic(rng, (8.0, 25.0), (50, 100, 200), 0.8)
    if _chance(rng, 0.6):
        draft.sins["dropped"] = draft.dropped = rng.uniform(0.005, 0.03)
    else:
        draft.sins["jitter"] = draft.jitter = rng.uniform(0.05, 0.25)
    others = (
        lambda: (_dry(rng, draft, 0.03, 0.15), _stribeck(rng, draft), _warming(rng, draft)),
        lambda: _ripple(rng, draft, float(rng.integers(6, 61)), 0.01, 0.03),
        lambda: _pushes(rng, draft, 0.01, 0.04),
        lambda: _second_mode(rng, draft),
        lambda: _lag(rng, draft, 5e-4, 3e-3),
        lambda: _cable(rng, draft),
    )
    for place in rng.choice(len(others), int(rng.integers(1, 3)), replace=False):
        others[place]()
    coarse = _chance(rng, 0.5)
    draft.motor = _converter(rng, 10) if coarse else Sensor(int(rng.integers(12, 16)))
    draft.link = _converter(rng, 10) if coarse else Sensor(int(rng.integers(12, 15)))
    return draft


_ALL = (
    RealisticFamily(
        "voltage_drive",
        "motor on a logged voltage: amplifier, back-EMF, coil, 8 to 12 bit converters",
        _voltage_drive,
    ),
    RealisticFamily(
        "strain_gauge_arm",
        "horizontal arm with a potentiometer and a strain gauge, on a logged voltage; second "
        "bending mode",
        _strain_gauge_arm,
    ),
    RealisticFamily(
        "current_drive",
        "torque from a current that lags, ripple, friction that falls off and drifts, cable",
        _current_drive,
    ),
    RealisticFamily(
        "disturbed_arm", "coloured torques on link and motor, second bending mode", _disturbed_arm
    ),
    RealisticFamily(
        "harmonic_rig",
        "harmonic drive: friction that drifts, ripple twice per turn of the input shaft, an "
        "eccentric encoder, a current that lags",
        _harmonic_rig,
    ),
    RealisticFamily(
        "poor_logger",
        "50 to 200 samples per second; samples dropped and the time rebuilt, or jitter; one or two "
        "other imperfections",
        _poor_logger,
    ),
)

REALISTIC: Mapping[str, RealisticFamily] = {family.name: family for family in _ALL}
"""Families by name."""
