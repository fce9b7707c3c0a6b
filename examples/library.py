# pyright: strict
"""flexid from Python: what a user writes, with every type known to a checker.

Run it in the root of the repository: ``python examples/library.py [LOG [FOLDER]]``.
"""

import sys
from pathlib import Path

import numpy as np

import flexid

HERE = Path(__file__).parent


def identify(log: Path) -> flexid.JointEstimate:
    """Parameters of the joint, with intervals and verdicts."""
    estimate = flexid.identify(log, known={"motor_inertia": (0.3, 0.01)}, progress=print)
    for name, parameter in estimate.parameters.items():
        low, high = parameter.interval_at(0.99)
        print(f"{name}: {parameter.value:.3f} [{low:.3f}, {high:.3f}] {parameter.unit}")
        if parameter.verdict != "determined":
            print(f"  {parameter.verdict}: {parameter.reason}")
    for warning in estimate.warnings:
        print(f"warning: {warning}")
    return estimate


def resonance(estimate: flexid.JointEstimate) -> float:
    """Angular frequency in rad/s of the joint with its motor locked, √(k/J)."""
    values = estimate.parameters
    stiffness, inertia = values["joint_stiffness"].value, values["link_inertia"].value
    return float(np.sqrt(stiffness / inertia))


def from_arrays(log: Path) -> flexid.Log:
    """A log whose samples are arrays: names as columns have them, or with a map of the columns."""
    (recorded,) = flexid.read_log(log).recordings
    return flexid.read_log(
        {
            "time [s]": recorded.time,
            "potentiometer": np.rad2deg(recorded.needed_link_position) / 36.0,
            "motor_position [rad]": recorded.motor_position,
            "motor_torque [N m]": recorded.needed_input,
        },
        columns={"link_position": {"column": "potentiometer", "scale": 36.0, "unit": "deg"}},
    )


def test_on(estimate: flexid.JointEstimate, log: flexid.Log) -> float:
    """How much of the deflection five seconds of prediction repeat, in per cent."""
    found = flexid.validate(estimate, log)
    off = found.series["deflection"] - found.series["predicted_deflection"]
    print(f"free run: the deflection is off by {np.sqrt(np.mean(off**2)):.1e} rad")
    return found.horizons[5.0]["deflection"]


def keep(estimate: flexid.JointEstimate, folder: Path) -> flexid.JointEstimate:
    """Figures, the page and numbers on the disk, and the numbers from there again."""
    estimate.save_figures(folder)
    estimate.report(folder / "report.html")
    estimate.save(folder / "estimate.json")
    return flexid.load(folder / "estimate.json")


def beside_a_drive(log: flexid.Log) -> dict[str, float]:
    """An estimator that takes one sample at a time, and remembers nothing but its state."""
    system = flexid.flexible_joint(("gravity", "motor_viscous"))
    (samples,) = flexid.samples(log)
    estimator: flexid.OnlineEstimator = flexid.recursive_least_squares(
        system, samples.sample_time, hold="zero"
    )
    state = estimator.init()
    for sample in estimator.pack(samples)[:2000]:
        state, info = estimator.step(state, sample)
        if info[-1] == flexid.Status.REJECTED:
            print("a sample was no number")
    return dict(zip(system.coefficients, estimator.coefficients(state).tolist(), strict=True))


def main(log: Path, folder: Path) -> None:
    """All of it, on one log."""
    try:
        estimate = identify(log)
    except flexid.FlexidError as error:
        sys.exit(f"{log} cannot be used: {error}")
    print(f"resonance with the motor locked: {resonance(estimate):.3f} rad/s")
    arrays = from_arrays(log)
    print(f"prediction over 5 s: {test_on(estimate, arrays):.1f} %")
    print(keep(estimate, folder))
    print(beside_a_drive(arrays))


if __name__ == "__main__":
    given = [Path(argument) for argument in sys.argv[1:]]
    main(*given, *(HERE / "flexible_joint.csv", Path("results"))[len(given) :])
