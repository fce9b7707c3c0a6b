"""Coverage of the intervals of `flexid watch` on random logs, and its speed.

``python -m benchmarks.watching --seeds 3`` prints both tables. The logs are those of the blind
trials with other seeds. The watch has the usual terms, or those that act.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Iterator

import numpy as np

import flexid
from benchmarks.size import sized
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import HEADER, Trial, make_trial
from benchmarks.trials.score import CORE
from flexid.arrays import FloatArray
from flexid.streaming.health import LIMITS, Health
from flexid.streaming.incoming import TextStream
from flexid.streaming.learner import departures
from flexid.streaming.options import USUAL_TERMS, WatchOptions
from flexid.streaming.session import Session

_FIRST_SEED = 5000  # beyond those of the blind trials


def samples_of(trial: Trial) -> FloatArray:
    """Return a trial's samples in the form for a session."""
    columns = (trial.time, trial.link_position, trial.motor_position, trial.torque)
    return np.column_stack(columns)


def watched(trial: Trial, terms: tuple[str, ...]) -> Session:
    """Return a session after the whole trial."""
    session = Session(WatchOptions(float(np.median(np.diff(trial.time))), terms))
    session.feed(samples_of(trial))
    return session


def coverage(seeds: int, *, with_terms: bool) -> None:
    """Print, for each family, the share of intervals that contain the truth, and the health."""
    totals: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
    print("family | inside | of | half-width, % | error, % | health at the end | changes")
    for family in sized([*FAMILIES], ["basic"]):
        held, widths, errors, healths, changes = [], [], [], [], 0
        for seed in range(_FIRST_SEED, _FIRST_SEED + seeds):
            trial = make_trial(family, seed)
            session = watched(trial, trial.terms if with_terms else USUAL_TERMS["revolute"])
            healths.append(session.health.health.words)
            changes += session.n_changes
            for name, claim in session.parameters.items():
                truth = trial.truth.get(name)
                if name in CORE and truth:
                    low, high = claim.interval
                    held.append(low <= truth <= high)
                    widths.append(50.0 * (high - low) / abs(truth))
                    errors.append(100.0 * abs(claim.value / truth - 1.0))
        for group in ("all", "in the class" if FAMILIES[family].in_class else "outside of it"):
            totals[group][0] += sum(held)
            totals[group][1] += len(held)
        print(
            f"{family} | {sum(held)} | {len(held)} | {np.median(widths):.3g} | "
            f"{np.median(errors):.2g} | {', '.join(healths)} | {changes}",
            flush=True,
        )
    for group, (good, count) in totals.items():
        print(f"{group}: {good} of {count}, {100.0 * good / count:.1f} %")


_SHIFTS = (0.0, 0.1, 0.2, 0.5)


def found_to_depart(session: Session, trial: Trial, name: str, less: float, half: bool) -> bool:
    """Return whether a parameter departs from an estimate that is larger by some share."""
    truth = trial.truth.get(name)
    if not truth:
        return False
    was = truth / (1.0 - less)
    share = 0.5 if half else 1.0
    return bool(
        departures(
            {name: (was, 0.01 * abs(was))},
            session.parameters,
            widths=share * LIMITS.departure,
            least=share * LIMITS.least_departure,
        )
    )


def departed(seeds: int) -> None:
    """Print how many drives are reported as departed, by the size of the difference.

    The estimate is the truth with an interval of 1 % to either side. Only the stiffness differs.
    With 0 % nothing differs, so every departure is wrong. In brackets, both limits are halved.
    """
    counts: defaultdict[tuple[float, bool], int] = defaultdict(int)
    drives = 0
    for family in sized([*FAMILIES], ["basic"]):
        for seed in range(_FIRST_SEED, _FIRST_SEED + seeds):
            trial = make_trial(family, seed)
            session = watched(trial, USUAL_TERMS["revolute"])
            drives += 1
            for less in _SHIFTS:
                for half in (False, True):
                    names = ("joint_stiffness",) if less else CORE
                    counts[less, half] += any(
                        found_to_depart(session, trial, name, less, half) for name in names
                    )
    for less in _SHIFTS:
        print(f"{less:.0%} less: {counts[less, False]} ({counts[less, True]}) of {drives} drives")


def rates() -> Iterator[tuple[str, float]]:
    """Print the time per sample in µs by kind of input; two encoders at 10 kHz, usual terms."""
    generator = np.random.default_rng(1)
    h, n = 1e-4, sized(100_000, 5_000)
    t = h * np.arange(n)
    motion = 0.5 * np.sin(2.0 * t) + 0.2 * np.sin(7.0 * t)
    positions = motion[:, None] + 1e-5 * generator.standard_normal((n, 2))
    samples = np.column_stack((t, positions, np.sin(3.0 * t))).astype(np.float64)
    text = "\n".join([HEADER, *(f"{a:.6f},{b:.7f},{c:.7f},{d:.6f}" for a, b, c, d in samples)])
    raw = text.encode()
    session = Session(WatchOptions(h))
    session.feed(samples[:10])  # compiles
    for name, size in (("blocks of 1000", 1000), ("blocks of 100", 100)):
        session, taken = Session(WatchOptions(h)), min(n, 20_000 * size)
        begun = time.perf_counter()
        for first in range(0, taken, size):
            session.feed(samples[first : first + size])
        yield name, 1e6 * (time.perf_counter() - begun) / taken
    watch, single = flexid.watch(sample_time=h), sized(20_000, 1_000)
    begun = time.perf_counter()
    for _, link, motor, torque in samples[:single].tolist():
        watch.feed(link_position=link, motor_position=motor, motor_torque=torque)
    yield "one by one, to flexid.watch", 1e6 * (time.perf_counter() - begun) / single
    session, text = Session(WatchOptions(h)), TextStream("text")
    begun = time.perf_counter()
    for first in range(0, len(raw), 40_000):  # a tenth of a second
        samples = text.samples(raw[first : first + 40_000])
        if not len(samples):
            continue
        session.feed(samples)
        assert session.health.health is not Health.SENSOR_FAULT
    yield "text, with the health ten times a second", 1e6 * (time.perf_counter() - begun) / n


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--with-terms", action="store_true", help="give the terms that act")
    parser.add_argument("--departures", action="store_true", help="measure departures alone")
    parser.add_argument("--rates", action="store_true", help="measure the rates alone")
    wanted = parser.parse_args()
    if wanted.departures:
        departed(wanted.seeds)
        return
    for name, microseconds in rates():
        print(f"{name}: {microseconds:.1f} us a sample, {1e3 / microseconds:.0f} kHz", flush=True)
    if not wanted.rates:
        coverage(wanted.seeds, with_terms=wanted.with_terms)


if __name__ == "__main__":
    main()
