"""``python -m benchmarks.arms``: identify random two-joint arms simulated in MuJoCo."""

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks.arms.score import Score, trial
from benchmarks.size import sized


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--joints", type=int, default=2)
    parser.add_argument("--harsh", action="store_true", help="poor motions, wide ranges, noise")
    parser.add_argument("--slides", action="store_true", help="joints of which some slide")
    parser.add_argument("--seven", action="store_true", help="seven joints: one step of the fit")
    options = parser.parse_args()
    if options.seven:
        from benchmarks.arms.seven import seven_joints

        seven_joints(options.first_seed)
        return
    kind = options.joints, options.harsh, options.slides
    if sized(True, False):
        trial(options.first_seed, *kind)  # compiles
    scores = []
    for seed in range(options.first_seed, options.first_seed + options.arms):
        scores.append(trial(seed, *kind))
        print(_line(scores[-1]), flush=True)
    print(_summary(scores))


def _line(score: Score) -> str:
    about = f"{score.seed:4d} {score.seconds:6.1f} s {score.processor:6.1f} s"
    if score.failure:
        return f"{about}  FAILED: {score.failure}"
    stiffness = ", ".join(
        f"{100.0 * e:+.3f} % {word}"
        for e, word in zip(score.stiffness_errors, score.stiffness_verdicts, strict=True)
    )
    missed = f"; missed (half intervals): {', '.join(score.missed)}" if score.missed else ""
    return f"{about}  {stiffness}  {score.held}/{score.determined}{missed}"


def _summary(scores: Sequence[Score]) -> str:
    done = [s for s in scores if not s.failure]
    words = [word for s in done for word in s.stiffness_verdicts]
    errors = np.abs([e for s in done for e in s.stiffness_errors])
    known = errors[np.array(words) == "determined"]
    held, determined = sum(s.held for s in done), sum(s.determined for s in done)
    lines = [
        f"arms {len(scores)}, failed {len(scores) - len(done)}",
        f"stiffnesses determined {len(known)} of {len(errors)}",
        f"error of these: median {100 * np.median(known):.3f} %, "
        f"largest {100 * known.max(initial=0.0):.3f} %",
        f"determined intervals that contain the truth: {held} of {determined}, "
        f"{100 * held / max(determined, 1):.1f} %",
        f"time: median {np.median([s.seconds for s in done]):.1f} s, longest "
        f"{max(s.seconds for s in done):.1f} s; of the processor at most "
        f"{max(s.processor for s in done):.1f} s",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
