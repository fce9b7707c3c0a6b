"""A noisy joint with known parameters as a stream of samples, and sessions fed with it."""

from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flexid.library.watched import Watch
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run
from flexid.streaming.guard import Counts, Guard
from flexid.streaming.options import StreamChannels, WatchOptions, options_of_stream
from flexid.streaming.session import Session

TRUTH = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
"""Huang (2003), Table I, and the inverse of the motor's inertia."""

H = 2e-3
NOISE = 1e-4
TERMS = ("gravity", "motor_viscous")
SYSTEM = flexible_joint(TERMS)
OPTIONS = WatchOptions(H, TERMS, hold="linear")
CHOSEN = {"terms": TERMS, "hold": "linear", "sample_time": H}
"""Settings that give these options; the stream's columns determine the rest."""

TIME, LINK, MOTOR, TORQUE = 0, 1, 2, 3  # columns of a sample


def torque(time):
    """Return the sum of two sines, in N m."""
    return 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time)


@cache
def _clean(duration: float) -> np.ndarray:
    time = H * np.arange(round(duration / H) + 1)
    u = torque(time)
    states = free_run(SYSTEM, TRUTH, np.zeros(4), u[:, None], H)
    return np.column_stack((time, states[:, 0], states[:, 2], u))


def stream(duration: float = 8.0, seed: int = 1) -> np.ndarray:
    """Return samples, shape (n, 4): time, link, motor, torque; encoders are noisy."""
    samples = _clean(duration).copy()
    generator = np.random.default_rng(seed)
    samples[:, [LINK, MOTOR]] += NOISE * generator.standard_normal((len(samples), 2))
    return samples


def loaded_stream(before: float, after: float, factor: float = 1.5, seed: int = 1) -> np.ndarray:
    """Return a stream in which the link's inertia and weight grow by a factor after a while."""
    n = round(before / H)
    time = H * np.arange(n + round(after / H))
    u = torque(time)[:, None]
    loaded = TRUTH | {"theta2": TRUTH["theta2"] / factor}  # gravity per inertia is kept
    first = free_run(SYSTEM, TRUTH, np.zeros(4), u[: n + 1], H)
    second = free_run(SYSTEM, loaded, first[-1], u[n:], H)
    positions = np.vstack((first[:-1], second))[:, ::2]
    positions = positions + NOISE * np.random.default_rng(seed).standard_normal(positions.shape)
    return np.column_stack((time, positions, u))


def options_of(made: Any = None, kind: Any = "flexible", unit="N m", h=H, **chosen) -> WatchOptions:
    """Return the options of a stream, with or without an estimate."""
    return options_of_stream(chosen, made, StreamChannels(kind, unit, False, ()), h)


def watched(samples: np.ndarray, options: WatchOptions = OPTIONS) -> Session:
    """Return a session fed with all samples."""
    session = Session(options)
    session.feed(samples)
    return session


def log_text(samples: np.ndarray, *columns: int) -> str:
    """Return a log of some columns of the samples, with all digits."""
    names = ("time", "link_position", "motor_position", "motor_torque")
    rows = [",".join(map(repr, row)) for row in samples[:, columns].tolist()]
    return "\n".join([",".join(names[column] for column in columns), *rows, ""])


def followed(path: Path, chosen: dict[str, Any] | None = None, **options: Any) -> Watch:
    """Return the watch of a log, followed to its end."""
    watch = Watch(str(path), chosen or CHOSEN, stop_at_end=True, **options)
    assert sum(watch.turns()) > 0
    return watch


def counted(guard: Guard, *columns: np.ndarray) -> Counts:
    """Return a guard's counts for times and encoder readings, with a sine as the input."""
    samples = np.column_stack((*columns, np.sin(columns[0]))).astype(np.float64)
    return guard.counts(guard.guard(guard.first_state(), samples)[0])


def errors(session: Session, truth=None) -> np.ndarray:
    """Return relative errors of the coefficients."""
    right = np.array(list((truth or TRUTH).values()))
    return np.abs(session.learner.values(session.now.states) / right - 1.0)


def all_hold(session: Session, truth=None) -> bool:
    """Return whether every coefficient's interval contains the true value."""
    found = session.coefficients
    return all(
        found[name].interval[0] <= value <= found[name].interval[1]
        for name, value in (truth or TRUTH).items()
    )


def same(one: Session | None, other: Session) -> bool:
    """Return whether two sessions have the same state, bit for bit."""
    return all(_plain(getattr(one, name)) == _plain(getattr(other, name)) for name in _KNOWN)


_KNOWN = ("fed", "guard_state", "now", "newer", "older", "recent", "suspected", "changes")


def _plain(value: Any) -> Any:
    """Return a value with arrays as bytes, at any depth."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if is_dataclass(value):
        return [_plain(getattr(value, f.name)) for f in fields(value)]
    return value
