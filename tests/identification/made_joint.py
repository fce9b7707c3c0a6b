"""Logs of a flexible joint, simulated by the integrators of the trials, and fits to them.

Friction, play and the like are fields of `Drive`. The torque is a sum of tones and the encoders
have white noise. A joint under disturbances is a `Plant`.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from benchmarks.trials.realistic.drive import Plant
from benchmarks.trials.realistic.drive import simulate as simulate_plant
from scipy.stats import t

from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import Timing
from flexid.identification.estimation.disturbed import Disturbed, fit_disturbed
from flexid.identification.full_model.fits_by_length import FitsByLength
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Data, Fitted, Structure, data_of
from flexid.identification.preparation.joint import flexible
from flexid.identification.result import Identification
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.models.physical import joint_coefficients
from flexid.recording.recording import Hold, Log, Recording
from flexid.recording.velocities import with_velocities

TRUTH = {
    "link_inertia": 1.0,
    "motor_inertia": 0.3,
    "joint_stiffness": 100.0,
    "gravity_torque": 5.0,
    "motor_viscous_friction": 0.2,
}
"""Parameters of every log, by flexid's names in SI units; Table I of Huang (2003)."""

COEFFICIENTS = joint_coefficients(TRUTH)
CORE = {name: TRUTH[name] for name in ("link_inertia", "motor_inertia", "joint_stiffness")}

SAMPLE_TIME = 2e-3
NOISE = 1e-5  # rad

TONES = np.array([0.7, 3.3, 5.3, 8.1, 12.0, 17.0, 21.0, 25.0, 31.0])  # rad/s
AMPLITUDES = np.array([2.5, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0, 6.0, 8.0])  # N m

_TABLE_STEP = 1e-4  # s
_LONGEST = 5e-4  # s, longest integration step


def made(
    seed: int,
    duration: float = 10.0,
    *,
    noise: float = NOISE,
    held: bool = False,
    input_delay: float = 0.0,
    link_delay: float = 0.0,
    torque_noise: float = 0.0,
    size: float = 1.0,
    torque: Any = None,  # N m, a function of time that replaces the tones
    motor_scale: float = 1.0,  # of the motor's encoder
    **more: float,
) -> Recording:
    """Return a recording (rad, N m, s) without the torque's noise; `more` are fields of `Drive`."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(TONES))
    times = SAMPLE_TIME * np.arange(1, round(duration / SAMPLE_TIME) + 1)

    def tones(at: np.ndarray) -> np.ndarray:
        return size * np.sin(np.outer(at, TONES) + phases) @ AMPLITUDES

    torque = torque or tones
    table = torque(np.arange(-0.02, duration + 0.04, _TABLE_STEP))
    smooth = Smooth(np.empty(0) if held else table, input_delay - 0.02, _TABLE_STEP)
    acting = {name.removesuffix("_friction"): value for name, value in TRUTH.items()}
    states, link = simulate(
        Drive(**{**acting, **more}),
        times,
        times - link_delay,
        times + input_delay,
        torque(times),
        torque_noise * rng.standard_normal(len(times)),
        smooth,
        Law(),
        np.zeros((len(times), 3)),
        0.0,
        _LONGEST,
    )
    errors = noise * rng.standard_normal((2, len(times)))
    link, motor = link + errors[0], motor_scale * states[:, 2] + errors[1]
    return recording(times, link, motor, torque(times), seed)


def recording(
    times: np.ndarray, link: np.ndarray, motor: np.ndarray, inputs: np.ndarray, name: object = ""
) -> Recording:
    """Return a recording with a torque in N m."""
    sample_time, start = float(times[1] - times[0]), float(times[0])
    return Recording(sample_time, start, link, motor, inputs, "N m", source=f"made {name}")


PUSHED = {"theta2": 150.0, "alpha1": 250.0, "alpha2": 1.5, "beta1": 5 / 3}
"""Coefficients of a disturbed drive with its resonance at 20 rad/s."""

FINE_NOISE = 2e-5  # rad
_INERTIA = 0.6  # kg m², inertia of the motor; the link has 1
_FINE_STEP = 5e-4  # s, step over which torque and disturbances are linear
_PUSHED_TONES = np.geomspace(1.0, 26.0, 15)  # rad/s, from below the resonance to above it


def pushed(
    seed: int,
    duration: float = 12.0,
    *,
    every: int = 1,
    size: float = 1.0,
    link_push: float = 0.0,
    motor_push: float = 0.0,
    chatter: float = 0.0,
    load: float = 0.0,
    **more: float,
) -> Recording:
    """Return a disturbed drive (RMS pushes in rad/s²), sampled at 500 Hz / `every`.

    `chatter` is the standard deviation of white noise in N m that a controller adds to the torque.
    A constant `load` in N m on the link is overcome by 2.5 times as much torque.
    """
    rng = np.random.default_rng(seed)
    times = _FINE_STEP * np.arange(round(duration / _FINE_STEP))
    phases = rng.uniform(0.0, 2.0 * np.pi, len(_PUSHED_TONES))
    torque = 2.4 * size * np.sin(np.outer(times, _PUSHED_TONES) + phases).sum(axis=1)
    own = np.random.default_rng([seed, 1]).standard_normal(len(times) // 4)
    torque += chatter * np.interp(times, times[::4], own)
    pushes = np.zeros((len(times), 2))
    keep = np.exp(-_FINE_STEP / 0.1)
    shocks = np.sqrt(1.0 - keep**2) * rng.standard_normal((len(times), 2))
    for i in range(1, len(times)):
        pushes[i] = keep * pushes[i - 1] + shocks[i]
    pushes *= [link_push, _INERTIA * motor_push]
    torque += 2.5 * load
    pushes[:, 0] -= load
    pushes[:, 1] += torque
    plant = Plant(1.0, _INERTIA, 150.0, motor_viscous=0.9, **more)
    # Contiguous arrays, since another layout is another kernel.
    held, course = np.zeros(len(times)), np.zeros((len(times), 3))
    states = simulate_plant(plant, times, held, Law(), course, pushes, 0.0, _FINE_STEP)[::4]
    noisy = states[:, [0, 2]] + FINE_NOISE * rng.standard_normal((len(states), 2))
    link, motor = noisy[::every].T
    return recording(times[::4][::every], link, motor, torque[::4][::every], seed)


def stopping(seed: int, duration: float = 24.0) -> Recording:
    """Return a log of that drive with dry friction; a controller moves it from stop to stop."""
    rng = np.random.default_rng(seed)
    times = SAMPLE_TIME * np.arange(1, round(duration / SAMPLE_TIME) + 1)
    course = np.zeros((len(times), 3))
    goals = np.repeat(rng.uniform(-1.5, 1.5, 40), round(1.2 / SAMPLE_TIME))
    keep = np.exp(-SAMPLE_TIME / 0.08)  # the motor follows in a fraction of a second
    for k in range(1, len(times)):
        course[k, 0] = keep * course[k - 1, 0] + (1.0 - keep) * goals[k]
    friction = {"motor_coulomb_up": 2.4, "motor_coulomb_down": 2.4, "motor_static": 1.2}
    acting = Drive(1.0, _INERTIA, 150.0, motor_viscous=0.9, stribeck_velocity=0.15, **friction)
    inputs, law = np.zeros(len(times)), Law(96.0, 9.6)
    smooth = Smooth(np.empty(0), 0.0, _TABLE_STEP)
    rest = inputs.copy(), smooth, law, course, 0.0, _LONGEST
    states, link = simulate(acting, times, times, times, inputs, *rest)
    errors = FINE_NOISE * rng.standard_normal((2, len(times)))
    return recording(times, link + errors[0], states[:, 2] + errors[1], inputs, seed)


def log(*recordings: Recording) -> Log:
    """Return a log of these recordings."""
    return Log(recordings, (), recordings[0].source, recordings[0].source)


JOINT = flexible()


def structure(*terms: str, hold: Hold = "cubic", sought: tuple[str, ...] = ()) -> Structure:
    """Return the flexible joint with these terms alone, and with these delays unknown."""
    on = {coefficient for term in terms for coefficient in JOINT.terms[term]}
    return Structure(JOINT, frozenset(JOINT.optional - on), Timing(hold, sought=sought))


PAPER, WITHOUT = structure(*PAPER_TERMS), structure()


def data(*recordings: Recording) -> Data:
    """Return recordings in the form that fits take, each as a log of its own."""
    with_speeds = [with_velocities(recording) for recording in recordings]
    return data_of(JOINT, with_speeds, range(len(recordings)))


def seen(recording: Recording, link: np.ndarray, motor: np.ndarray) -> Recording:
    """Return the recording with these deviations added to its positions."""
    positions = recording.needed_link_position + link, recording.motor_position + motor
    return replace(recording, link_position=positions[0], motor_position=positions[1])


def turned(recording: Recording, turns: int) -> Recording:
    """Return the recording shifted by whole turns, where gravity is the same."""
    away = np.full(len(recording), 2.0 * np.pi * turns)
    return seen(recording, away, away)


def posed(
    recording: Recording,
    *terms: str,
    widths: Mapping[str, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Structure, Data]:
    """Return the paper's model with more terms, and the data; widths fit the data or are given."""
    own = data(recording)
    joint = JOINT.scaled(own.samples).with_widths(dict(widths or {}))
    absent = structure(*PAPER_TERMS, *terms).absent
    return Structure(joint, absent, Timing("cubic"), dict(fixed or {}), dict(bounds or {})), own


def fitted(recording: Recording, *terms: str, **about: Any) -> Fitted:
    """Return that model, fitted over segments of one second."""
    return fit_to(*posed(recording, *terms, **about), COEFFICIENTS, 1.0)[0]


def among_disturbances(structure: Structure, data: Data) -> Disturbed:
    """Return the fit with disturbances of a structure, without a search for shapes."""
    return fit_disturbed(structure, data, (), ("cubic",), THRESHOLDS, with_shapes=False)


def diverging(*_: Any, **__: Any) -> Any:
    """Fail like a fit whose motion diverges."""
    raise ConvergenceError("prediction error", "the motion diverges")


def assert_holds(
    found: Identification, truth: Mapping[str, float], width: float = np.inf, verdict: str = ""
) -> None:
    """Assert that each interval holds the true value, with a relative width and a verdict."""
    for name, value in truth.items():
        low, high = found.parameters[name].interval
        assert low < value < high, name
        assert high - low < width * abs(value), name
        assert verdict in ("", found.parameters[name].verdict), name


def half_widths(estimate: Any) -> np.ndarray:
    """Return half the 95 % interval of each value of an estimate or a fit."""
    return t.ppf(0.975, np.array(estimate.degrees_of_freedom)) * estimate.deviations


def made_fit(
    excess: float = 1.0, *, cost: float = 0.0, segments: Any = range(4), states: Any = None, **more
) -> Any:
    """Return a stand-in for a fit without optional terms, with the fields that a choice reads."""
    minimum = SimpleNamespace(
        equations=SimpleNamespace(cost=cost), point=SimpleNamespace(initial_states=states)
    )
    usual = {"duration": 1.0, "structure": WITHOUT, "by_name": {}, "data": None, "unexplained": 0.0}
    problem = SimpleNamespace(segments=segments, degrees_of_freedom=1000)
    fields = {"minimum": minimum, "problem": problem, **usual, **more}
    found: Any = SimpleNamespace(excess=excess, **fields)
    found.unexplained_over = lambda length: Fitted.unexplained_over(found, length)
    return found


def by_length_of(*fits: Any, divisions: Any = (range(4),)) -> FitsByLength:
    """Return fits over segments of growing length, stand-ins or not."""
    return FitsByLength(fits, divisions, True, ("cubic",), "")


def over(segments: int, excess: float, structure: Structure = WITHOUT) -> Any:
    """Return such a stand-in fit over this number of segments, 2 s in all."""
    return made_fit(excess, segments=range(segments), duration=2.0 / segments, structure=structure)
