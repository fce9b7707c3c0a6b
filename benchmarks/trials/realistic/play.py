"""Excitation of a realistic drive: motion, controller, dither and disturbances."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.trials.arrays import FloatArray
from benchmarks.trials.integrator import Law
from benchmarks.trials.motions import Motion, Sines, Steps, draw_moves, draw_reference
from benchmarks.trials.realistic.drafts import Draft, Size, sensor_steps
from benchmarks.trials.realistic.drive import Plant, simulate

STEP = 1e-4  # s, longest step of the integrator
_SLOWEST_CONTROL = 500.0  # 1/s, of a controller faster than the log
_LEAD = 0.5  # s, from the start of the motion to the start of the log
_CENTRING = 0.04  # bandwidth of a centring controller, over the resonance


@dataclass(frozen=True, eq=False)
class Play:
    """A motion of unit size with all random signals, at n instants.

    Parameters
    ----------
    times : (n,) ndarray
        Instants of the controller in s; the log begins at zero.
    every : int
        Number of the controller's periods per sample of the log.
    unit, rate : (n,) ndarray
        Motion and its derivative: a torque, or the reference of a controller.
    first_guess : float
        First scale of the unit: torque over inertia and angle, or 1.
    dither : (n,) ndarray
        Torque of unit root mean square, added to the controller's.
    law : Law
    pushes : (n, 2) ndarray
        Disturbing torques on link and motor, of unit root mean square.
    noise : (n, 2) ndarray
        Noise of the link's and motor's sensor, in steps.
    """

    times: FloatArray
    every: int
    unit: FloatArray
    rate: FloatArray
    first_guess: float
    dither: FloatArray
    law: Law
    pushes: FloatArray
    noise: FloatArray

    @property
    def period(self) -> float:
        """Period of the controller in s."""
        return float(self.times[1] - self.times[0])

    @property
    def first(self) -> int:
        """Index of time zero."""
        return int(np.searchsorted(self.times, -0.5 * self.period))


class Scale(NamedTuple):
    """Amplitude of a play, and size of its motion."""

    amplitude: float
    size: Size


def draw_play(rng: np.random.Generator, draft: Draft) -> Play:
    """Draw the excitation for a draft."""
    every = 1 if draft.held else int(np.ceil(_SLOWEST_CONTROL / draft.pace))
    period = 1.0 / (every * draft.pace)
    before = every * int(np.ceil(_LEAD * draft.pace))
    last = every * round(draft.duration * draft.pace)
    times = period * np.arange(-before, last + 1, dtype=np.float64)
    motion = _draw_motion(rng, draft)
    dither = _multisine(rng, 0.3 * draft.resonance, draft.highest * draft.resonance, 12)
    return Play(
        times,
        every,
        motion.at(times + 1e-9),
        motion.rate_at(times),
        1.0 if draft.is_controlled else _guess(motion, draft),
        dither.at(times),
        _draw_law(rng, draft, period),
        np.column_stack([coloured(rng, times, draft.push_time) for _ in range(2)]),
        rng.standard_normal((len(times), 2)) * (draft.link.noise, draft.motor.noise),
    )


def run_play(
    draft: Draft, plant: Plant, play: Play, scale: Scale, longest: float = STEP
) -> FloatArray:
    """Simulate a drive with a play; return the result of `simulate`."""
    amplitude, size = scale
    count = sensor_steps(draft, size)[1]
    course = np.zeros((len(play.times), 3))
    course[:, 2] = count * play.noise[:, 1]
    if draft.is_controlled:
        course[:, 0], course[:, 1] = amplitude * play.unit, amplitude * play.rate
        extra = draft.dither * size.torque * play.dither
    else:
        extra = amplitude * play.unit
    shares = np.array([draft.shares.get(name, 0.0) for name in ("link_push", "motor_push")])
    pushes = size.torque * shares * play.pushes
    law = play.law._replace(count=count)
    return simulate(plant, play.times, extra, law, course, pushes, 0.0, longest)


def _guess(motion: Motion, draft: Draft) -> float:
    """Return the torque that moves both inertias as one body by about a rad."""
    plant = draft.plant
    inertia = plant.near_inertia + plant.tip_inertia + plant.motor_inertia
    if isinstance(motion, Sines):
        hardness = float(motion.frequencies.min() ** 2)
    else:
        assert isinstance(motion, Steps)
        hardness = float(2.0 / np.median(np.diff(motion.instants)) ** 2)
    return inertia * hardness + plant.gravity_torque


def _draw_motion(rng: np.random.Generator, draft: Draft) -> Motion:
    begin, end = -_LEAD, draft.duration
    if draft.motion == "multisine":
        low = draft.resonance * rng.uniform(0.05, 0.2)
        return _multisine(rng, low, draft.highest * draft.resonance, int(rng.integers(6, 25)))
    if draft.motion == "tracking":
        return draw_reference(rng, draft.resonance)
    if draft.motion == "moves":
        return draw_moves(rng, begin, end)
    if draft.motion == "square":
        half = np.pi / (draft.resonance * rng.uniform(0.1, 0.35))
    else:
        half = np.pi / draft.resonance * rng.uniform(0.3, 2.0)
    samples = max(round(half * draft.pace), 2)
    begins = np.append(0, samples // 2 + samples * np.arange(int((end - begin) / half) + 1))
    levels = np.where(np.arange(len(begins)) % 2, 1.0, -1.0)
    if draft.motion == "binary":
        levels = rng.choice([-1.0, 1.0], len(begins))
    first = -np.ceil(_LEAD * draft.pace)
    return Steps((first + begins) / draft.pace, levels, draft.motion)


def _multisine(rng: np.random.Generator, low: float, high: float, count: int) -> Sines:
    """Return equal tones of total RMS 1, with geometric frequencies and random phases."""
    return Sines(
        np.full(count, np.sqrt(2.0 / count)),
        np.geomspace(low, high, count),
        np.zeros(count),
        rng.uniform(0.0, 2.0 * np.pi, count),
        "multisine",
    )


def _draw_law(rng: np.random.Generator, draft: Draft, period: float) -> Law:
    """Draw a tracking controller, or a slow centring one."""
    plant = draft.plant
    inertia = plant.near_inertia + plant.tip_inertia + plant.motor_inertia
    share = rng.uniform(0.25, 0.6) if draft.is_controlled else _CENTRING
    bandwidth = share * min(draft.resonance, 40.0)
    damping = 2.0 * rng.uniform(0.5, 1.0) * inertia * bandwidth
    corner = bandwidth * rng.uniform(6.0, 12.0)  # of the velocity filter
    return Law(
        proportional=inertia * bandwidth**2,
        derivative=max(damping - plant.motor_viscous - plant.back_emf, 0.0),
        smoothing=1.0 - float(np.exp(-period * corner)),
    )


def coloured(rng: np.random.Generator, times: FloatArray, correlation: float) -> FloatArray:
    """Draw an Ornstein-Uhlenbeck process of unit variance at evenly spaced times."""
    keep = np.exp(-(times[1] - times[0]) / correlation)
    found = rng.standard_normal(len(times))
    found[1:] *= np.sqrt(1.0 - keep**2)
    for i in range(1, len(found)):
        found[i] += keep * found[i - 1]
    return found
