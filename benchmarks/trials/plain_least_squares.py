"""Plain method of a practitioner who knows the terms: filter, differentiate, least squares.

All signals pass the same low-pass filter forwards and backwards, which adds no delay and cancels
from the equations. Both equations are linear in the physical parameters and are solved together.
The terms, hold, delays and the joint's resonance are given. Backlash, eccentric gears and
saturation of the torque are not modelled.
"""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.trials.generate import Trial
from flexid.arrays import FloatArray

_CUTOFF = 2.0  # times the resonance
_MOST = 0.3  # largest cutoff, over the sampling rate
_EDGE = 0.03  # of the log at either end, left out because of filter transients


def plain_least_squares(trial: Trial) -> dict[str, float]:
    """Return the physical parameters by flexid's names."""
    sample = float(trial.metadata["sample_time"])
    time = np.arange(trial.time[0], trial.time[-1], sample)
    link = np.interp(time + trial.truth["link_delay"], trial.time, trial.link_position)
    motor = np.interp(time, trial.time, trial.motor_position)
    later = trial.truth["input_delay"] + (0.5 * sample if trial.hold == "zero" else 0.0)
    torque = np.interp(time - later, trial.time, trial.torque)

    cutoff = min(_CUTOFF * float(trial.metadata["resonance"]) / (2.0 * np.pi), _MOST / sample)
    sections = butter(4, cutoff, fs=1.0 / sample, output="sos")
    edge = int(_EDGE * len(time))

    def smooth(values: FloatArray) -> FloatArray:
        return np.asarray(sosfiltfilt(sections, values))[edge:-edge]

    def rate(values: FloatArray) -> FloatArray:
        return np.gradient(values, sample)

    w, v = rate(np.asarray(sosfiltfilt(sections, link))), rate(sosfiltfilt(sections, motor))
    zero, one = np.zeros_like(time), np.ones_like(time)
    spring = link - motor
    columns = {  # regressors of each parameter in the link's and the motor's equation
        "link_inertia": (rate(w), zero),
        "motor_inertia": (zero, rate(v)),
        "joint_stiffness": (spring, -spring),
    }
    extra = {
        "gravity": ("sine", np.sin(link), zero),
        "gravity_cosine": ("cosine", np.cos(link), zero),
        "motor_viscous": ("motor_viscous_friction", zero, v),
        "link_viscous": ("link_viscous_friction", w, zero),
        "joint_damping": ("joint_damping", w - v, v - w),
        "motor_coulomb": ("motor_coulomb_friction", zero, np.sign(v)),
        "link_coulomb": ("link_coulomb_friction", np.sign(w), zero),
        "cubic_stiffness": ("cubic_joint_stiffness", spring**3, -(spring**3)),
        "spring_hysteresis": ("spring_hysteresis", np.sign(w - v), np.sign(v - w)),
        "link_offset": ("link_offset_torque", -one, zero),
        "motor_offset": ("motor_offset_torque", zero, -one),
    }
    columns |= {extra[term][0]: extra[term][1:] for term in trial.terms if term in extra}
    rows = [np.concatenate([smooth(side) for side in sides]) for sides in columns.values()]
    solved = np.linalg.lstsq(np.array(rows).T, np.append(smooth(zero), smooth(torque)))[0]
    found = dict(zip(columns, solved.tolist(), strict=True))
    sine, cosine = found.pop("sine", None), found.pop("cosine", 0.0)
    if sine is None:
        return found
    return found | {
        "gravity_torque": float(np.hypot(sine, cosine)),
        "gravity_angle": float(-np.arctan2(cosine, sine)),
    }
