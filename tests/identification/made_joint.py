"""Logs of a flexible joint from the integrator of the blind trials, which is not flexid's.

Whatever acts is given by the names of its drive; a smooth torque of many tones, encoders with
white noise.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from scipy.stats import t

from flexid.estimators.channel_timing import Timing
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Data, Fitted, Structure, data_of
from flexid.identification.preparation.joint import flexible
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.recording.recording import Hold, Log, Recording
from flexid.recording.velocities import with_velocities

ACTING = {
    "link_inertia": 1.0,
    "motor_inertia": 0.3,
    "joint_stiffness": 100.0,
    "gravity_torque": 5.0,
    "motor_viscous": 0.2,
}
"""What acts in every log, in SI units; Table I of Huang (2003)."""

TRUTH = {
    "link_inertia": 1.0,
    "motor_inertia": 0.3,
    "joint_stiffness": 100.0,
    "gravity_torque": 5.0,
    "motor_viscous_friction": 0.2,
}
"""The same by flexid's names."""

COEFFICIENTS = {
    "theta1": 5.0,
    "theta2": 100.0,
    "alpha1": 1000 / 3,
    "alpha2": 2 / 3,
    "beta1": 10 / 3,
}

SAMPLE_TIME = 2e-3
NOISE = 1e-5  # rad

TONES = np.array([0.7, 3.3, 5.3, 8.1, 12.0, 17.0, 21.0, 25.0, 31.0])  # rad/s
AMPLITUDES = np.array([2.5, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0, 6.0, 8.0])  # N m

_TABLE_STEP = 1e-4  # s
_LONGEST = 5e-4  # s, steps


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
    **more: float,
) -> Recording:
    """One recording.

    The seed is that of the tones' phases and of all noise. Noise is in rad and N m, the torque's in
    no log; times are in s. What else acts, or acts otherwise, are fields of `Drive`.
    """
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(TONES))
    times = SAMPLE_TIME * np.arange(1, round(duration / SAMPLE_TIME) + 1)

    def torque(at: np.ndarray) -> np.ndarray:
        return size * np.sin(np.outer(at, TONES) + phases) @ AMPLITUDES

    table = torque(np.arange(-0.02, duration + 0.04, _TABLE_STEP))
    smooth = Smooth(np.empty(0) if held else table, input_delay - 0.02, _TABLE_STEP)
    states, link = simulate(
        Drive(**{**ACTING, **more}),
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
    return Recording(
        SAMPLE_TIME,
        float(times[0]),
        link + errors[0],
        states[:, 2] + errors[1],
        torque(times),
        "N m",
        source=f"made {seed}",
    )


def log(recording: Recording) -> Log:
    """A log of one recording."""
    return Log((recording,), (), recording.source, recording.source)


JOINT = flexible()


def structure(*terms: str, hold: Hold = "cubic") -> Structure:
    """The flexible joint with these terms alone, nothing sought of its timing."""
    on = {coefficient for term in terms for coefficient in JOINT.terms[term]}
    return Structure(JOINT, frozenset(JOINT.optional - on), Timing(hold))


PAPER = structure(*PAPER_TERMS)


def data(*recordings: Recording) -> Data:
    """Recordings as a fit takes them, each of its own log."""
    with_speeds = [with_velocities(recording) for recording in recordings]
    return data_of(JOINT, with_speeds, range(len(recordings)))


def turned(recording: Recording, turns: int) -> Recording:
    """The same motion that many turns further, where gravity is the same."""
    away = 2.0 * np.pi * turns
    assert recording.link_position is not None
    link, motor = recording.link_position + away, recording.motor_position + away
    return replace(recording, link_position=link, motor_position=motor)


def posed(
    recording: Recording,
    *terms: str,
    widths: Mapping[str, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Structure, Data]:
    """The paper's model with more terms, of shapes that suit a recording or are given."""
    own = data(recording)
    joint = JOINT.scaled(own.samples).with_widths(dict(widths or {}))
    on = {coefficient for term in (*PAPER_TERMS, *terms) for coefficient in joint.terms[term]}
    absent = frozenset(joint.optional - on)
    return Structure(joint, absent, Timing("cubic"), dict(fixed or {}), dict(bounds or {})), own


def fitted(recording: Recording, *terms: str, **about: Any) -> Fitted:
    """That model fitted over segments of a second."""
    return fit_to(*posed(recording, *terms, **about), COEFFICIENTS, 1.0)[0]


def half_widths(estimate: Any) -> np.ndarray:
    """Half the 95 % interval of each value of an estimate or a fit."""
    return t.ppf(0.975, np.array(estimate.degrees_of_freedom)) * estimate.deviations
