"""Several logs of one drive, unchanged or changed. Nothing here imports flexid."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.trials.drafts import Draft
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import TRIES, Recorded, Trial, record, run_play, trial_of
from benchmarks.trials.integrator import Drive
from benchmarks.trials.sensors import draw_noise


def make_repeated(family: str, seed: int, changes: Sequence[Mapping[str, float]]) -> list[Trial]:
    """Draw logs of one drive, each with another motion, encoder and noise.

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    seed : int
    changes : sequence of mapping of str to float
        Factors for fields of `Drive`, for each log.

    Returns
    -------
    list of Trial
        One for each change, and the first again with its motion and encoders, but other noise and
        zeros.

    Raises
    ------
    RuntimeError
        If no suitable drive and motion are found.
    """
    chosen = FAMILIES[family]
    rng = np.random.default_rng((seed, zlib.crc32(family.encode()), 1))
    for _ in range(TRIES):
        draft = chosen.draw(rng)
        first = record(rng, family, seed, draft)
        if first is None:
            continue
        draft = _settled(draft, first.drive)
        found = [record(rng, family, seed, _changed(draft, change)) for change in changes]
        logs = [log for log in found if log is not None]
        if len(logs) == len(changes):
            again = _same_motion(rng, family, seed, _changed(draft, changes[0]), logs[0])
            return [*(log.trial for log in logs), again]
    raise RuntimeError(f"{family} {seed}: no motions found")


def _changed(draft: Draft, change: Mapping[str, float]) -> Draft:
    factors = {name: getattr(draft.base, name) * factor for name, factor in change.items()}
    return replace(draft, base=draft.base._replace(**factors))


def _same_motion(
    rng: np.random.Generator, family: str, seed: int, draft: Draft, first: Recorded
) -> Trial:
    _, drive, sensors, play, size = first
    sensors = replace(sensors, zeros=tuple(sensors.count * rng.random(2)))
    noise = draw_noise(rng, draft, sensors)
    times = sensors.instants + sensors.sample_time * noise.jitter
    run = run_play(draft, drive, play, times, noise, size.torque, draft.longest)
    return trial_of(rng, family, seed, draft, drive, sensors, play, size, noise, run)


def _settled(draft: Draft, drive: Drive) -> Draft:
    """Return the draft with the drive's values fixed, independent of the size of the motion."""
    return replace(
        draft, base=drive, of_torque={}, cubic=0.0, hysteresis=0.0, bend=0.0, presliding=0.0
    )
