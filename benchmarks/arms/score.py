"""Score of an arm's estimate against the truth."""

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.arms.arm import Arm, random_arm
from benchmarks.arms.log import Motion, random_motion, save, simulate
from flexid.arms.identify import carried_inertia, identify_arm
from flexid.arms.result import ArmIdentification
from flexid.errors import FlexidError
from flexid.models.planar_arm import PlanarArm


@dataclass(frozen=True)
class Score:
    """Score of one arm: relative errors of stiffnesses, and intervals that contain the truth."""

    seed: int
    arm: Arm
    motion: Motion
    seconds: float
    processor: float  # processor time in s, of all cores
    stiffness_errors: tuple[float, ...] = ()
    stiffness_verdicts: tuple[str, ...] = ()
    determined: int = 0
    held: int = 0
    missed: tuple[str, ...] = ()
    failure: str = ""


def trial(seed: int, joints: int, harsh: bool, slides: bool) -> Score:
    """Draw and simulate an arm, and identify it from its log file."""
    rng = np.random.default_rng([seed, joints, harsh])
    arm, motion = random_arm(rng, joints, harsh, slides), random_motion(rng, harsh)
    log = simulate(arm, motion, rng)
    known = arm.known
    with TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        save(log, path)
        began, worked = time.perf_counter(), time.process_time()
        try:
            found = identify_arm(path, known)
        except FlexidError as error:
            spent = time.perf_counter() - began, time.process_time() - worked
            return Score(seed, arm, motion, *spent, failure=str(error))
        spent = time.perf_counter() - began, time.process_time() - worked
    return _scored(Score(seed, arm, motion, *spent), known, found)


def _scored(score: Score, known: PlanarArm, found: ArmIdentification) -> Score:
    truth = score.arm.truth()
    for joint in range(1, score.arm.joints + 1):
        carried = carried_inertia(known, joint).items()
        inertia = sum(weight * truth[name] for name, weight in carried)
        truth[f"stiffness_over_inertia_{joint}"] = truth[f"joint_stiffness_{joint}"] / inertia
    stiffness = [f"joint_stiffness_{i}" for i in range(1, score.arm.joints + 1)]
    own = [found.parameters[name] for name in stiffness]
    determined = [p for p in found.parameters.values() if p.verdict == "determined"]
    held = [p for p in determined if p.interval[0] <= truth[p.name] <= p.interval[1]]
    missed = []
    for p in determined:
        half = 0.5 * (p.interval[1] - p.interval[0])
        times = abs(p.value - truth[p.name]) / half if half else np.inf
        if times > 1.0:
            missed.append(f"{p.name} {times:.1f}")
    return Score(
        score.seed,
        score.arm,
        score.motion,
        score.seconds,
        score.processor,
        tuple(p.value / truth[p.name] - 1.0 for p in own),
        tuple(p.verdict for p in own),
        len(determined),
        len(held),
        tuple(missed),
    )
