"""Force error of the EMPS slide by its publishers' protocol: fit and cross test.

    python -m benchmarks.emps [FOLDER]

FOLDER contains ``emps_train.csv`` and ``emps_pulses.csv`` (columns t_s, position_m, force_N).
Without it, both logs are simulated with the published constants.

A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019: the position is
filtered forwards and backwards and differentiated, and the model gives the force. Both forces are
low-pass filtered. The error is the norm of their difference over the norm of the force.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

import flexid
from benchmarks.size import sized
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.models.flexible_joint import rigid_joint
from flexid.simulation.free_run import free_run

BANDS = (5.0, 10.0, 20.0, 40.0)  # Hz, of the low-pass filter of both forces
POSITION_BAND = 100.0  # Hz
SIGN_VELOCITY = 2e-3  # m/s, for the smooth sign of friction
ENDS = 0.5  # s at either end, left out because of filter transients
PUBLISHED = {"M": 95.109, "viscous": 203.5, "coulomb": 20.39, "asymmetry": -36.85}
LOGS = ("emps_train.csv", "emps_pulses.csv")

Log = Mapping[str, NDArray[np.float64]]


def main() -> None:
    """Identify the first log, and print the force errors on both."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.emps", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, metavar="FOLDER")
    folder = parser.parse_args().folder
    logs = [
        _simulated(k) if folder is None else _read(folder / name) for k, name in enumerate(LOGS)
    ]
    channels = {
        "time [s]": logs[0]["t_s"],
        "motor_position [m]": logs[0]["position_m"],
        "motor_torque [N]": logs[0]["force_N"],
    }
    found = flexid.identify(channels, model="rigid")
    for name, value in found.parameters.items():
        low, high = value.interval
        print(f"{name:28} {value.value:10.4g} [{low:.4g}, {high:.4g}]  {value.verdict}")
    delay = found.result.choices.alignment.input_delay.value
    print(f"\nForce error (%), input {1e3 * delay:.2f} ms late\nband (Hz)   fit  cross test")
    for band in BANDS:
        errors = [force_error(log, found.coefficients, delay, band) for log in logs]
        print(f"{band:9.0f} {errors[0]:5.2f} {errors[1]:11.2f}")


def force_error(
    log: Log, coefficients: Mapping[str, ValueEstimate], delay: float, band: float
) -> float:
    """Return the norm of the unexplained force over the norm of the force, in per cent."""
    step = float(log["t_s"][1] - log["t_s"][0])
    position = _low_passed(log["position_m"], POSITION_BAND, step)
    speed = np.gradient(position, step)
    values = {name: c.value for name, c in coefficients.items()}
    force = (
        np.gradient(speed, step)
        + values.get("gamma_viscous", 0.0) * speed
        + values.get("gamma_asymmetry", 0.0) * np.abs(speed)
        + values.get("gamma_coulomb", 0.0) * np.tanh(speed / SIGN_VELOCITY)
        - values.get("gamma_offset", 0.0)
    ) / values["beta1"]
    acting = np.interp(log["t_s"] - delay, log["t_s"], log["force_N"])
    inner = slice(round(ENDS / step), -round(ENDS / step))
    measured, model = (_low_passed(each, band, step)[inner] for each in (acting, force))
    return float(100.0 * np.linalg.norm(measured - model) / np.linalg.norm(measured))


def _low_passed(values: NDArray[np.float64], band: float, step: float) -> NDArray[np.float64]:
    return sosfiltfilt(butter(4, band, fs=1.0 / step, output="sos"), values)


def _read(path: Path) -> Log:
    columns = np.genfromtxt(path, delimiter=",", names=True)
    return {name: columns[name] for name in ("t_s", "position_m", "force_N")}


def _simulated(seed: int) -> Log:
    """Simulate a slide with the published constants, which a force moves to and fro."""
    rng = np.random.default_rng(seed)
    time = 1e-3 * np.arange(sized(20_000, 4000))
    force = 60.0 * np.sin(2.0 * np.pi * 0.4 * time) + 25.0 * np.sin(2.0 * np.pi * 1.1 * time + seed)
    mass = PUBLISHED["M"]
    values = {
        "gamma_viscous": PUBLISHED["viscous"] / mass,
        "gamma_asymmetry": PUBLISHED["asymmetry"] / mass,
        "gamma_coulomb": PUBLISHED["coulomb"] / mass,
        "beta1": 1.0 / mass,
    }
    system = rigid_joint(
        ("viscous", "viscous_asymmetry", "coulomb"), coulomb_velocity=SIGN_VELOCITY
    )
    states = free_run(system, values, np.zeros(2), force[:, None], 1e-3)
    position = states[:, 0] + 1e-6 * rng.standard_normal(len(time))
    return {"t_s": time, "position_m": position, "force_N": force}


if __name__ == "__main__":
    main()
