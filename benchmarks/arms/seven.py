"""Seven joints: time of the equations, their compilation, and one step of the fit."""

import time

import numpy as np

from benchmarks.arms.arm import random_arm
from benchmarks.arms.log import Motion, simulate
from flexid.arms.identify import fixed_parameters
from flexid.arms.starts import starts
from flexid.arms.units import ArmUnits
from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import Point, motion_kernel
from flexid.identification.preparation.joint import ElasticArm
from flexid.models.planar_arm import planar_arm
from flexid.recording.velocities import position_noise


def seven_joints(seed: int, joints: int = 7) -> None:
    """Print times and errors for an arm with a number of joints."""
    rng = np.random.default_rng([seed, joints])
    arm = random_arm(rng, joints)
    log = simulate(arm, Motion(amplitude=0.3, bits=18), rng)
    known = arm.known
    balance = planar_arm(known)
    positions = np.stack((log.link, log.motor), axis=2).reshape(len(log.time), -1)
    samples = Samples(positions, None, log.torque, float(log.time[1]))
    fixed = fixed_parameters(known, ArmUnits(known.types, ("N m",) * joints))
    truth = arm.truth()
    names = [f"joint_stiffness_{i}" for i in range(1, joints + 1)]
    clock = _Clock()
    motion_kernel(balance)
    clock.say("equations derived")
    first = next(iter(starts(balance, [samples], fixed)))
    clock.say("columns compiled, least squares")
    values = dict(first)
    segments = divide([samples], 0.1)
    model = ElasticArm(balance)
    problem = model.motion(segments, Timing("zero"), model.unknowns((), fixed))
    noise = np.array([position_noise(column) for column in positions.T])
    candidates = []
    for start in starts(balance, [samples], fixed):
        point = Point(np.array([start[name] for name in problem.names]), problem.start_states)
        own = problem.at(point, 1.0 / noise)
        candidates.append((own.equations(point, "nothing").cost, start, own, point))
    clock.say("motion compiled, all starts compared")
    _, values, own, point = min(candidates, key=lambda each: each[0])
    _errors("least squares", values, truth, names)
    step = own.solve(own.equations(point))
    clock.say("one step of Gauss and Newton")
    moved = dict(zip(problem.names, (point.values + step.values_step).tolist(), strict=True))
    _errors("after one step", moved, truth, names)


class _Clock:
    def __init__(self) -> None:
        self.began = time.perf_counter()

    def say(self, what: str) -> None:
        now = time.perf_counter()
        print(f"{what}: {now - self.began:.1f} s", flush=True)
        self.began = now


def _errors(what: str, values: dict[str, float], truth: dict[str, float], names: list[str]) -> None:
    errors = [100.0 * (values[name] / truth[name] - 1.0) for name in names]
    print(f"{what}, error of the stiffnesses: {', '.join(f'{e:+.2f} %' for e in errors)}")
