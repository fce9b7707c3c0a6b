"""Motions: sums of sines, perhaps with a sweep; stepped torques; moves between targets."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from benchmarks.trials.arrays import FloatArray, IntArray


class Motion(Protocol):
    """Torque or reference over time."""

    @property
    def kind(self) -> str:
        """Name of the kind of motion."""
        ...

    def at(self, time: FloatArray, /) -> FloatArray:
        """Return the values at given times, shape (n,)."""
        ...

    def rate_at(self, time: FloatArray, /) -> FloatArray:
        """Return the derivatives at given times, shape (n,)."""
        ...


@dataclass(frozen=True)
class Sines:
    """Sum of sines, ``sum a sin(f t + s t^2 / 2 + phase)``.

    Parameters
    ----------
    amplitudes, frequencies, sweeps, phases : (k,) ndarray
        Frequencies in rad/s, sweeps in rad/s².
    kind : str
        Name of the kind of motion.
    """

    amplitudes: FloatArray
    frequencies: FloatArray
    sweeps: FloatArray
    phases: FloatArray
    kind: str

    def at(self, time: FloatArray) -> FloatArray:
        """Return the values at given times, shape (n,)."""
        total = np.zeros(len(time))
        for a, f, s, phase in self._parts():
            total += a * np.sin((f + 0.5 * s * time) * time + phase)
        return total

    def rate_at(self, time: FloatArray) -> FloatArray:
        """Return the derivatives at given times, shape (n,)."""
        total = np.zeros(len(time))
        for a, f, s, phase in self._parts():
            total += a * (f + s * time) * np.cos((f + 0.5 * s * time) * time + phase)
        return total

    def _parts(self) -> list[tuple[float, float, float, float]]:
        columns = (self.amplitudes, self.frequencies, self.sweeps, self.phases)
        return [
            (float(a), float(f), float(s), float(p)) for a, f, s, p in zip(*columns, strict=True)
        ]


@dataclass(frozen=True)
class Steps:
    """Stepped torque: each level holds from its instant on; zero before the first.

    Parameters
    ----------
    instants, levels : (k,) ndarray
        Instants in s, ascending.
    kind : str
    """

    instants: FloatArray
    levels: FloatArray
    kind: str

    def at(self, time: FloatArray) -> FloatArray:
        """Return the values at given times, shape (n,)."""
        return np.append(0.0, self.levels)[np.searchsorted(self.instants, time, side="right")]

    def rate_at(self, time: FloatArray) -> FloatArray:
        """Return zeros, the derivatives between the steps, shape (n,)."""
        return np.zeros(len(time))


@dataclass(frozen=True)
class Moves:
    """Moves between targets, with rests in between; they start at rest at zero.

    Parameters
    ----------
    begins, takes : (k,) ndarray
        Start and duration of each move in s; a move ends before the next begins.
    targets : (k,) ndarray
        Final position of each move.
    ramp : float
        Duration of the acceleration, and of the deceleration, over the move's duration: the speed
        is a trapezoid. Zero for moves of minimum jerk.
    """

    begins: FloatArray
    takes: FloatArray
    targets: FloatArray
    ramp: float

    @property
    def kind(self) -> str:
        """Shape of a move."""
        return "trapezoids" if self.ramp else "minimum jerk"

    def at(self, time: FloatArray) -> FloatArray:
        """Return the values at given times, shape (n,)."""
        move, share = self._place(time)
        if self.ramp:
            early = np.minimum(share, self.ramp)
            late = np.maximum(share - (1.0 - self.ramp), 0.0)
            gone = share - early + (early**2 - late**2) / (2.0 * self.ramp)
            gone /= 1.0 - self.ramp
        else:
            gone = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        return self._starts[move] + (self.targets - self._starts)[move] * gone

    def rate_at(self, time: FloatArray) -> FloatArray:
        """Return the derivatives at given times, shape (n,)."""
        move, share = self._place(time)
        if self.ramp:
            speed = np.clip(np.minimum(share, 1.0 - share) / self.ramp, 0.0, 1.0)
            speed /= 1.0 - self.ramp
        else:
            speed = 30.0 * (share * (1.0 - share)) ** 2
        return (self.targets - self._starts)[move] * speed / self.takes[move]

    @property
    def _starts(self) -> FloatArray:
        return np.append(0.0, self.targets[:-1])

    def _place(self, time: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the current or latest move at each time, and the elapsed share of its duration."""
        move = np.maximum(np.searchsorted(self.begins, time, side="right") - 1, 0)
        return move, np.clip((time - self.begins[move]) / self.takes[move], 0.0, 1.0)


def draw_torque(rng: np.random.Generator, resonance: float, duration: float) -> Sines:
    """Draw a torque of about unit size: two to four sines, a sweep, or filtered noise."""
    kind = str(rng.choice(["sines", "sines", "sines", "chirp", "noise"]))
    if kind == "sines":
        count = int(rng.integers(2, 5))
        low, high = np.array([0.08, 0.5]), np.array([0.35, 1.3])
        shares = np.exp(rng.uniform(np.log(low), np.log(high)))
        rest = np.exp(rng.uniform(np.log(0.08), np.log(1.3), count - 2))
        frequencies = resonance * np.append(shares, rest)
        amplitudes = rng.uniform(0.3, 1.0, count)
        sweeps = np.zeros(count)
    elif kind == "chirp":  # plus a slow sine that keeps the link moving
        first, last, slow = resonance * rng.uniform([0.1, 0.7, 0.08], [0.3, 1.5, 0.3])
        frequencies, sweeps = np.array([first, slow]), np.array([(last - first) / duration, 0.0])
        amplitudes = np.array([1.0, rng.uniform(0.2, 1.0)])
    else:
        frequencies = np.sort(resonance * rng.uniform(0.03, 1.3, 40))
        corner = resonance * rng.uniform(0.2, 0.8)
        amplitudes = rng.rayleigh(0.3, 40) / np.sqrt(1.0 + (frequencies / corner) ** 2)
        sweeps = np.zeros(40)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    return Sines(amplitudes, frequencies, sweeps, phases, kind)


def draw_reference(rng: np.random.Generator, resonance: float) -> Sines:
    """Draw a smooth reference of about unit size for a position controller."""
    count = int(rng.integers(3, 7))
    fastest = min(12.0, 0.6 * resonance)
    frequencies = np.exp(rng.uniform(np.log(0.4), np.log(fastest), count))
    amplitudes = rng.uniform(0.3, 1.0, count) / np.sqrt(1.0 + (frequencies / 3.0) ** 2)
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    return Sines(amplitudes, frequencies, np.zeros(count), phases, "tracking")


def draw_steps(
    rng: np.random.Generator, resonance: float, begin: float, end: float, jolted: bool
) -> Steps:
    """Draw a stepped torque, or one that switches between two levels by a clock.

    Parameters
    ----------
    rng : Generator
    resonance : float
        In rad/s; the clock's period is a fraction of the resonance's.
    begin, end : float
        Times in s, before and after zero, between which the torque acts.
    jolted : bool
        Whether the torque acts before time zero and steps then. Otherwise it starts some time after
        zero.
    """
    first = 0.0 if jolted else float(rng.uniform(0.1, 0.5))
    if rng.random() < 0.5:
        kind = "steps"
        spans = rng.uniform(0.1, 1.5, int((end - first) / 0.1) + 1)
        levels = rng.uniform(-1.0, 1.0, len(spans))
    else:
        kind = "binary"
        tick = rng.uniform(0.2, 2.0) * np.pi / resonance
        spans = np.full(int((end - first) / tick) + 1, tick)
        levels = rng.choice([-1.0, 1.0], len(spans))
    instants = first + np.append(0.0, np.cumsum(spans[:-1]))
    if jolted:  # different from the level at zero, so that there is a step
        instants = np.append(begin, instants)
        levels = np.append(-np.sign(levels[0]) * rng.uniform(0.3, 1.0), levels)
    return Steps(instants, levels, kind)


def draw_moves(rng: np.random.Generator, begin: float, end: float) -> Moves:
    """Draw a reference of about unit size with random targets and rests."""
    ramp = float(rng.choice([0.0, rng.uniform(0.15, 0.5)]))
    most = int((end - begin) / 0.5) + 1
    takes, rests = rng.uniform(0.3, 1.5, most), rng.uniform(0.2, 1.0, most)
    begins = begin + np.cumsum(rests) + np.append(0.0, np.cumsum(takes[:-1]))
    return Moves(begins, takes, rng.uniform(-1.0, 1.0, most), ramp)
