"""One realistic trial: a log with several imperfections at once, and its truth.

The truth is the set of low-frequency parameters of the channels as logged. Nothing here imports
flexid.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.trials.arrays import FloatArray
from benchmarks.trials.realistic.drafts import Draft, Size, realised, sensor_steps, truth_of
from benchmarks.trials.realistic.drive import Plant
from benchmarks.trials.realistic.families import REALISTIC
from benchmarks.trials.realistic.play import Play, Scale, draw_play, run_play
from benchmarks.trials.realistic.sensors import logged

_TRIES, _MOTIONS, _TURNS = 300, 3, 7
_FARTHEST = 2.0  # rad from hanging straight down
_FASTEST = 60.0  # rad/s
_SMALLEST_DEFLECTION = 3e-4  # rad, root mean square
_FEWEST_STEPS = 25.0  # least range of the deflection, in steps of the coarser sensor


@dataclass(frozen=True, eq=False)
class RealisticTrial:
    """A log with its truth.

    Parameters
    ----------
    family, seed
        Family and seed of the draw.
    columns : mapping of str to (n,) ndarray
        Recorded columns, by the headers of the file.
    truth : mapping of str to float
        Low-frequency parameters by flexid's names. A parameter that does not act is zero. One that
        the imperfections make undefined is missing.
    core : tuple of str
        Inertias and stiffness, or their ratios if a voltage is logged.
    sins : mapping of str to float
        Imperfections by name.
    about : mapping of str to float or str
        Resonance in rad/s, samples per second, motion, and sizes.
    """

    family: str
    seed: int
    columns: Mapping[str, FloatArray]
    truth: Mapping[str, float]
    core: tuple[str, ...]
    sins: Mapping[str, float]
    about: Mapping[str, float | str]

    def write_csv(self, path: Path) -> None:
        """Write only the log, without its truth."""
        np.savetxt(
            path,
            np.column_stack(list(self.columns.values())),
            fmt=["%.6f"] + ["%.9g"] * (len(self.columns) - 1),
            delimiter=",",
            header=",".join(self.columns),
            comments="",
        )


class Recorded(NamedTuple):
    """A log with its draft, plant, motion and run."""

    trial: RealisticTrial
    draft: Draft
    plant: Plant
    play: Play
    scale: Scale
    run: FloatArray


def make_realistic(family: str, seed: int) -> RealisticTrial:
    """Draw a log, which depends only on family and seed."""
    return record(family, seed).trial


def record(family: str, seed: int) -> Recorded:
    """Draw a log and return it with its draft, plant, motion and run.

    Raises
    ------
    RuntimeError
        If no suitable drive and motion are found; this did not happen with any seed tried.
    """
    rng = np.random.default_rng((seed, zlib.crc32(family.encode()), 2))
    for _ in range(_TRIES):
        draft = REALISTIC[family].draw(rng)
        for _ in range(_MOTIONS):
            play = draw_play(rng, draft)
            found = _sized(draft, play)
            if found is not None:
                trial = _trial(rng, family, seed, draft, play, *found)
                plant, scale, run = found
                return Recorded(trial, draft, plant, play, scale, run)
    raise RuntimeError(f"{family} {seed}: no motion found")


def _sized(draft: Draft, play: Play) -> tuple[Plant, Scale, FloatArray] | None:
    """Find a run with the desired range of the motor; return None if it is not found.

    Friction, disturbances and the converters' ranges depend on the size of the previous run.
    """
    target = draft.target
    scale = Scale(play.first_guess * target, Size(0.0, 0.0, 0.0, target, target, target, target))
    for turn in range(_TURNS):
        plant = realised(draft, scale.size) if turn else draft.plant
        run = run_play(draft, plant, play, scale)
        if not np.all(np.isfinite(run)) or np.abs(run[:, :5]).max() > 1e3:
            return None
        size = _size_of(draft, plant, run[play.first :])
        reached = size.half_range / target
        settled = turn > 1 and _near(size.torque, scale.size.torque)
        settled &= _near(size.peak, scale.size.peak) and _near(size.spring, scale.size.spring)
        if settled and 0.7 < reached < 1.4:
            return (plant, scale, run) if _accepted(draft, play, scale, run) else None
        factor = float(np.clip(1.0 / max(reached, 1e-6), 0.2, 5.0)) ** 0.8
        scale = Scale(factor * scale.amplitude, size)
    return None


def _near(value: float, other: float) -> bool:
    return abs(value - other) < 0.15 * value


def _size_of(draft: Draft, plant: Plant, run: FloatArray) -> Size:
    deflection = run[:, 0] - run[:, 2]
    return Size(
        torque=float(run[:, 5].std()),
        peak=float(np.abs(run[:, 5]).max()),
        spring=float(plant.joint_stiffness * deflection.std()),
        link=float(np.abs(run[:, 0]).max()),
        motor=float(np.abs(run[:, 2]).max()),
        gauge=float(draft.gauge_scale * np.abs(run[:, 4]).max()),
        half_range=0.5 * float(np.ptp(run[:, 2])),
    )


def _accepted(draft: Draft, play: Play, scale: Scale, run: FloatArray) -> bool:
    """Whether a run is realistic enough to be recorded."""
    kept = run[play.first :]
    deflection = kept[:, 0] - kept[:, 2]
    farthest = float(np.abs(kept[:, 0]).max())
    size = scale.size
    in_range = not draft.motor.range or np.abs(kept[:, 2]).max() < draft.motor.range * size.motor
    if draft.link.range:
        reading, known = (kept[:, 4], size.gauge) if draft.has_gauge else (kept[:, 0], size.link)
        in_range &= bool(np.abs(reading).max() < draft.link.range * known)
    return bool(
        in_range
        and (draft.plant.gravity_torque == 0.0 or farthest < _FARTHEST)
        and np.ptp(deflection) > _FEWEST_STEPS * max(sensor_steps(draft, size))
        and _SMALLEST_DEFLECTION < deflection.std() < draft.largest
        and np.abs(kept[:, (1, 3)]).max() < _FASTEST
    )


def _trial(
    rng: np.random.Generator,
    family: str,
    seed: int,
    draft: Draft,
    play: Play,
    plant: Plant,
    scale: Scale,
    run: FloatArray,
) -> RealisticTrial:
    """Return the log of a run, with its truth."""
    kept = run[play.first :]
    gain = float(np.abs(kept[:, 5]).max()) / draft.volts if draft.volts else 1.0
    steps = sensor_steps(draft, scale.size)
    truth, core = truth_of(draft, plant, gain)
    about = {
        "resonance": draft.resonance,
        "pace": draft.pace,
        "motion": draft.motion,
        "deflection_rms": float((kept[:, 0] - kept[:, 2]).std()),
        "link_step": steps[0],
        "motor_step": steps[1],
        "input_rms": float(kept[:, 5].std()) / gain,
    }
    columns = logged(rng, draft, play, run, steps, gain)
    return RealisticTrial(family, seed, columns, truth, core, dict(draft.sins), about)
