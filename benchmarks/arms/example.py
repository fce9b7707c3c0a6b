"""``python -m benchmarks.arms.example FOLDER``: write a log of two joints and its arm file."""

import sys
from pathlib import Path

import numpy as np

from benchmarks.arms.arm import random_arm
from benchmarks.arms.log import random_motion, save, simulate


def main() -> None:
    folder, seed = Path(sys.argv[1]), 0
    rng = np.random.default_rng([seed, 2, False])
    arm, motion = random_arm(rng), random_motion(rng)
    save(simulate(arm, motion, rng), folder / "run.csv")
    lengths = [round(link.length, 12) for link in arm.links]
    text = f"[arm]\nlengths = {lengths}\ngravity = {list(map(float, arm.gravity))}\n"
    (folder / "arm.toml").write_text(text)
    for name, value in arm.truth().items():
        print(f"{name} {value:.6g}")


if __name__ == "__main__":
    main()
