"""One blind trial: a log and its truth. Nothing here imports flexid."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.trials.arrays import FloatArray
from benchmarks.trials.drafts import Draft, Size, acting, realised, truth
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from benchmarks.trials.motions import Motion, draw_moves, draw_reference, draw_steps, draw_torque
from benchmarks.trials.sensors import (
    Noise,
    Sensors,
    draw_noise,
    draw_sensors,
    faint,
    with_losses,
)

HEADER = "time [s],link_position [rad],motor_position [rad],motor_torque [N m]"

_TABLE_STEP = 1e-4  # s, of a smooth torque
_COARSE = 2.5e-4  # s, steps during the search for the amplitude
TRIES, _MOTIONS, _PLAYS = 500, 4, 7
_FARTHEST = 2.2  # rad from hanging straight down, so that no link turns over
_FASTEST = 60.0  # rad/s
_LARGEST_DEFLECTION = 0.1  # rad, root mean square


@dataclass(frozen=True, eq=False)
class Trial:
    """A log with its truth.

    Parameters
    ----------
    family, seed
        Family and seed of the draw.
    time, link_position, motor_position, torque : (n,) ndarray
        As recorded.
    truth : mapping of str to float
        Physical parameters by flexid's names, zero if they do not act; ``gravity_angle`` is missing
        without gravity. Also ``input_delay`` and ``link_delay`` in s.
    terms : tuple of str
        Acting terms by flexid's names.
    hold : {"zero", "smooth"}
        Whether the torque was constant between samples or continuous.
    in_class : bool
        Whether flexid's terms describe the drive exactly.
    metadata : mapping
        Other random choices.
    """

    family: str
    seed: int
    time: FloatArray
    link_position: FloatArray
    motor_position: FloatArray
    torque: FloatArray
    truth: Mapping[str, float]
    terms: tuple[str, ...]
    hold: str
    in_class: bool
    metadata: Mapping[str, Any]  # numbers and texts

    def write_csv(self, path: Path) -> None:
        """Write only the log, without its truth."""
        columns = (self.time, self.link_position, self.motor_position, self.torque)
        np.savetxt(
            path,
            np.column_stack(columns),
            fmt=("%.9f", "%.9f", "%.9f", "%.9g"),
            delimiter=",",
            header=HEADER,
            comments="",
        )


@dataclass(frozen=True)
class Play:
    """A motion with its amplitude, controller and hold.

    Parameters
    ----------
    motion : Motion
    amplitude : float
    law : Law
    hold : {"zero", "smooth"}
    """

    motion: Motion
    amplitude: float
    law: Law
    hold: str


@dataclass(frozen=True)
class Run:
    """Result of a run: states (n, 4), link at its encoder's instants, commanded torque."""

    states: FloatArray
    link: FloatArray
    torque: FloatArray


class Recorded(NamedTuple):
    """A log with its drive, sensors and motion."""

    trial: Trial
    drive: Drive
    sensors: Sensors
    play: Play
    size: Size


def make_trial(family: str, seed: int) -> Trial:
    """Draw a log, which depends only on family and seed.

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    seed : int

    Returns
    -------
    Trial

    Raises
    ------
    RuntimeError
        If no suitable drive and motion are found; this did not happen with any seed tried.
    """
    chosen = FAMILIES[family]
    rng = np.random.default_rng((seed, zlib.crc32(family.encode())))
    for _ in range(TRIES):
        recorded = record(rng, family, seed, chosen.draw(rng))
        if recorded is not None:
            return recorded.trial
    raise RuntimeError(f"{family} {seed}: no motion found")


def record(rng: np.random.Generator, family: str, seed: int, draft: Draft) -> Recorded | None:
    """Record a log of a drive; return None if no motion suits it."""
    sensors = draw_sensors(rng, draft)
    for _ in range(_MOTIONS):
        play, size = _draw_play(rng, draft, sensors)
        noise = draw_noise(rng, draft, sensors)
        found = _sized(draft, sensors, play, size, noise)
        if found is None:
            continue
        play, size, drive = found
        if draft.faint:
            sensors = faint(draft, sensors, size.deflection / draft.faint)
            noise = draw_noise(rng, draft, sensors)
        times = sensors.instants + sensors.sample_time * noise.jitter
        run = run_play(draft, drive, play, times, noise, size.torque, draft.longest)
        if _accepted(draft, drive, sensors, run):
            trial = trial_of(rng, family, seed, draft, drive, sensors, play, size, noise, run)
            return Recorded(trial, drive, sensors, play, size)
    return None


def _draw_play(rng: np.random.Generator, draft: Draft, sensors: Sensors) -> tuple[Play, Size]:
    """Draw a motion with a first guess of its amplitude."""
    base = draft.base
    motion = _draw_motion(rng, draft, sensors)
    inertia = base.link_inertia + base.motor_inertia
    if draft.controlled:
        bandwidth = min(draft.resonance, 30.0) * rng.uniform(0.25, 0.6)
        proportional = inertia * bandwidth**2
        law = Law(
            proportional=proportional,
            derivative=2.0 * rng.uniform(0.4, 1.0) * inertia * bandwidth,
            integral=float(rng.choice([0.0, 0.15])) * proportional * bandwidth,
            smoothing=1.0 - np.exp(-sensors.sample_time * rng.uniform(100.0, 400.0)),
            count=sensors.count,
            zero=sensors.zeros[1],
        )
        play = Play(motion, draft.target / _half_range(motion.at(sensors.instants)), law, "zero")
        torque = draft.target * max(inertia * 9.0, base.gravity_torque)
    else:
        torque = draft.target * (inertia * (0.2 * draft.band) ** 2 + base.gravity_torque)
        play = Play(
            motion, torque / motion.at(sensors.instants).std(), Law(), str(rng.choice(draft.holds))
        )
    deflection = torque / base.joint_stiffness
    return play, Size(torque, 2.0 * torque, deflection, 2.0 * deflection)


def _draw_motion(rng: np.random.Generator, draft: Draft, sensors: Sensors) -> Motion:
    begin = float(sensors.instants[0])
    if draft.motion == "steps":
        return draw_steps(rng, draft.resonance, begin, sensors.duration, draft.jolted)
    if draft.motion == "moves":
        return draw_moves(rng, begin, sensors.duration)
    if draft.controlled:
        return draw_reference(rng, draft.resonance)
    return draw_torque(rng, draft.band, sensors.duration)


def _sized(
    draft: Draft, sensors: Sensors, play: Play, size: Size, noise: Noise
) -> tuple[Play, Size, Drive] | None:
    """Find the amplitude for the desired range of the link; return None if it is not found."""
    for turn in range(_PLAYS):
        drive = realised(draft, size)
        drive = drive._replace(  # Coulomb friction gives the same range without LuGre's short steps
            motor_coulomb_up=drive.motor_coulomb_up + drive.bristle_coulomb,
            motor_coulomb_down=drive.motor_coulomb_down + drive.bristle_coulomb,
            bristle_stiffness=0.0,
            bristle_damping=0.0,
        )
        held = Play(play.motion, play.amplitude, play.law, "zero")
        run = run_play(draft, drive, held, sensors.instants, noise, 0.0, _COARSE)
        kept = run.states[sensors.before :]
        if not np.all(np.isfinite(kept)) or np.abs(kept).max() > 1e3:
            return None
        reached = _half_range(kept[:, 0]) / draft.target
        before, size = size, _size(kept, run.torque[sensors.before :])
        settled = abs(size.torque / before.torque - 1.0) < 0.1
        settled &= abs(size.deflection / before.deflection - 1.0) < 0.1
        if turn > 1 and settled and 0.8 < reached < 1.25:
            if not draft.faint and not _visible(draft, sensors, size):
                return None
            return play, size, realised(draft, size)
        factor = np.clip(1.0 / max(reached, 1e-6), 0.2, 5.0) ** 0.8
        play = Play(play.motion, play.amplitude * float(factor), play.law, play.hold)
    return None


def _half_range(values: FloatArray) -> float:
    return 0.5 * float(np.ptp(values))


def _size(states: FloatArray, torque: FloatArray) -> Size:
    deflection = states[:, 0] - states[:, 2]
    return Size(
        float(np.sqrt(np.mean(torque**2))),
        float(np.abs(torque).max()),
        float(deflection.std()),
        float(np.abs(deflection).max()),
    )


def run_play(
    draft: Draft,
    drive: Drive,
    play: Play,
    times: FloatArray,
    noise: Noise,
    disturbing: float,
    longest: float,
) -> Run:
    """Simulate a drive; `disturbing` scales the unlogged torque, in N m."""
    count = len(times)
    course = np.zeros((count, 3))
    empty = Smooth(np.empty(0), 0.0, 1.0)
    torque, smooth = np.zeros(count), empty
    if draft.controlled:
        wanted = play.amplitude * play.motion.at(times) + drive.gravity_angle
        rate = play.amplitude * play.motion.rate_at(times)
        course = np.column_stack((wanted, rate, noise.motor))
    else:
        torque = play.amplitude * play.motion.at(times)
    if play.hold == "smooth":
        first, last = times[0] - 0.02, times[-1] + 0.02
        grid = first + _TABLE_STEP * np.arange(int((last - first) / _TABLE_STEP) + 1)
        values = play.amplitude * play.motion.at(grid)
        smooth = Smooth(values, first + draft.input_delay, _TABLE_STEP)
    states, link = simulate(
        drive,
        times,
        times - draft.link_delay,
        times + draft.input_delay,
        torque,
        disturbing * noise.torque,
        smooth,
        play.law,
        course,
        drive.gravity_angle,
        longest,
    )
    return Run(states, link, torque)


def _visible(draft: Draft, sensors: Sensors, size: Size) -> bool:
    """Whether the deflection is large enough for the encoders and small enough for a joint."""
    low, high = draft.visible
    return bool(
        low < size.deflection / sensors.error < high
        and draft.smallest < size.deflection < _LARGEST_DEFLECTION
    )


def _accepted(draft: Draft, drive: Drive, sensors: Sensors, run: Run) -> bool:
    """Whether a run is realistic enough to be recorded."""
    states = run.states[sensors.before :]
    if not np.all(np.isfinite(states)):
        return False
    size = _size(states, run.torque[sensors.before :])
    away = np.abs(run.states[:, 0] - drive.gravity_angle).max()
    hangs = drive.gravity_torque == 0.0 or away < _FARTHEST
    return bool(
        _visible(draft, sensors, size)
        and hangs
        and 0.7 < _half_range(states[:, 0]) / draft.target < 1.4
        and np.abs(states[:, (1, 3)]).max() < _FASTEST
    )


def trial_of(
    rng: np.random.Generator,
    family: str,
    seed: int,
    draft: Draft,
    drive: Drive,
    sensors: Sensors,
    play: Play,
    size: Size,
    noise: Noise,
    run: Run,
) -> Trial:
    """Return the log of a run, with its truth."""
    log = slice(sensors.before, None)
    stamps = sensors.instants[log]
    if draft.jitter and draft.stamps == "true":
        stamps = stamps + sensors.sample_time * noise.jitter[log]
    columns = np.column_stack(
        (
            stamps,
            sensors.read(run.link, noise.link, 0)[log] + draft.link_zero,
            sensors.read(run.states[:, 2], noise.motor, 1)[log] + draft.motor_zero,
            run.torque[log] + draft.torque_zero * size.torque,
        )
    )
    columns = with_losses(rng, draft.lost, columns)
    values = truth(draft, drive, size)
    return Trial(
        family,
        seed,
        *columns.T.copy(),
        truth=values,
        terms=acting(values),
        hold=play.hold,
        in_class=FAMILIES[family].in_class,
        metadata=_metadata(draft, drive, sensors, play, size),
    )


def _metadata(
    draft: Draft, drive: Drive, sensors: Sensors, play: Play, size: Size
) -> dict[str, float | str]:
    """Return the random choices: acting values of the drive, sensors, motion and its size."""
    usual = Drive._field_defaults
    acts = {name: v for name, v in drive._asdict().items() if v != usual.get(name)}
    return acts | {
        "resonance": draft.resonance,
        "sample_time": sensors.sample_time,
        "encoder_count": sensors.count,
        "encoder_noise": sensors.noise,
        "motion": play.motion.kind,
        "hold": play.hold,
        "torque_rms": size.torque,
        "deflection_rms": size.deflection,
        "torque_noise": draft.torque_noise * size.torque,
        "jitter": draft.jitter,
        "stamps": draft.stamps,
        "lost": draft.lost,
    }
