"""Many runs of the paper's closed loop: flexid's ensemble, single runs, SciPy and diffrax.

The ensemble is Table I with gains (1,2,3), k drawn from [10, 50] and every coefficient of the plant
within 20 % of its value, 30 s, at flexid's default tolerance. diffrax runs it as well, and the same
plants under PD control, which are not stiff.
"""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.comparison import AtLeast, AtMost, Comparison, Detail, Outcome, Side, duration
from benchmarks.ensemble_peers import (
    DURATION,
    Plant,
    diffrax_ensemble,
    nearness,
    scipy_pool,
)
from benchmarks.size import sized
from benchmarks.table1 import JR, TRUE
from benchmarks.timing import Timing, measure, timed
from flexid.paper.laws import pd_gravity
from flexid.simulation.closed_loop import ClosedLoop, simulate
from flexid.simulation.ensemble import Ensemble, simulate_ensemble
from flexid.studies.runs import table1_loop

_SEED = 1
_ACCURACY = 1e-5
_TIGHT = 1e-11  # relative tolerance of the reference
_TOLERANCE = 1e-6
_TOLERANCES = sized((1e-4, 3e-5, 1e-5, 1e-6), (1e-4,))  # of SciPy in error coordinates
_STIFF_SOLVERS = ("Kvaerno3", "Kvaerno5")


def run(quick: bool) -> Outcome:
    """Compare flexid's ensemble with single runs, with two threads, and with peers.

    Parameters
    ----------
    quick : bool
        Use fewer runs, and leave out SciPy in plain coordinates, which takes minutes.
    """
    plants = draw(sized(40, 8) if quick else 200)
    loops = [stiff_loop(plant) for plant in plants]
    own, details = _own(loops, 2 if quick else 7)
    scipy, scipy_lines = _scipy(plants, loops, quick)
    vmap, vmap_lines = _diffrax(plants, loops, quick)
    heads = ("peer", "rtol", "runs", "accuracy", "wall per run", "processor's time per run")
    remark = (
        "Accuracy is the worst parameter error of all runs, against flexid at rtol "
        f"{_TIGHT:g}, relative to its value, or to 1e-3 where that is smaller."
    )
    peers = Detail("Ensemble: peers", heads, [*scipy_lines, *vmap_lines], remark)
    return Outcome([*own, *scipy, *vmap], [details, peers])


def draw(count: int) -> list[Plant]:
    """Draw the ensemble's members."""
    generator = np.random.default_rng(_SEED)
    plants = []
    for _ in range(count):
        *true, beta1 = np.array([*TRUE, 1 / JR]) * generator.uniform(0.8, 1.2, 5)
        plants.append(Plant(float(generator.uniform(10.0, 50.0)), tuple(map(float, true)), beta1))
    return plants


def on_two_threads(loops: list[ClosedLoop], tolerance: float) -> list[Ensemble]:
    """Run the even and the odd members in two threads."""

    def run(part: list[ClosedLoop]) -> Ensemble:
        return simulate_ensemble(part, DURATION, relative_tolerance=tolerance)

    with ThreadPoolExecutor(2) as pool:
        return [*pool.map(run, (loops[::2], loops[1::2]))]


def stiff_loop(plant: Plant) -> ClosedLoop:
    """Return Table I's loop with gains (1,2,3) and a member's k and plant."""
    return with_plant(table1_loop((1, 2, 3), plant.k), plant)


def with_plant(loop: ClosedLoop, plant: Plant) -> ClosedLoop:
    """Return the loop with another plant, as a campaign does."""
    return loop.with_values(
        system=loop.system.with_constants({"beta1": plant.beta1}),
        coefficients=dict(zip(loop.coefficients, plant.true, strict=True)),
    )


def _own(loops: list[ClosedLoop], repetitions: int) -> tuple[list[Comparison], Detail]:
    count = len(loops)

    def singles() -> None:
        for loop in loops:
            simulate(loop, DURATION, DURATION, _TOLERANCE)

    def one() -> Ensemble:
        return simulate_ensemble(loops, DURATION, relative_tolerance=_TOLERANCE)

    def two() -> list[Ensemble]:
        return on_two_threads(loops, _TOLERANCE)

    first = one()
    for place, half in enumerate(two()):  # both must give the same results
        np.testing.assert_array_equal(first.final_states[place::2], half.final_states)
        np.testing.assert_array_equal(first.tracking_rms[place::2], half.tracking_rms)
    busy = os.getloadavg()[0]
    alone, single = measure(singles, one, repetitions=repetitions, clock=time.thread_time)
    one_wall, two_wall = measure(one, two, repetitions=repetitions)
    job = f"Table I, gains (1,2,3), k in [10, 50], plants ±20 %, {DURATION:g} s"
    comparisons = [
        Comparison(
            f"{job}, processor's time per run",
            Side(f"ensemble of {count}, one thread", single.per(count)),
            Side("the same runs by `simulate`, one by one", alone.per(count)),
            AtMost(1.3),
        ),
        Comparison(
            f"{job}, per run",
            Side(f"ensemble of {count}, two threads", two_wall.per(count)),
            Side("the same on one thread", one_wall.per(count)),
            AtLeast(1.8),
        ),
    ]
    (both,) = measure(two, repetitions=repetitions, clock=time.process_time)
    lines = [
        ("`simulate`, one by one", "–", duration(alone.per(count))),
        ("ensemble, one thread", duration(one_wall.per(count)), duration(single.per(count))),
        ("ensemble, two threads", duration(two_wall.per(count)), duration(both.per(count))),
    ]
    remark = (
        f"Per run. Every number of the ensemble is the same bit for bit on one thread and on two; "
        f"{np.mean(first.steps):.0f} steps per run; load average {busy:.2f} when this began: with "
        f"other work on the machine the second thread has no core to itself."
    )
    headings = ("what", "wall", "processor's time")
    return comparisons, Detail("Ensemble: wall and processor", headings, lines, remark)


def _scipy(
    plants: list[Plant], loops: list[ClosedLoop], quick: bool
) -> tuple[list[Comparison], list[tuple[str, ...]]]:
    """Compare with SciPy's Radau, its best stiff method here, in both sets of coordinates."""
    comparisons, lines = [], []
    kinds = [("error coordinates", False, sized(8, 2) if quick else 40, _TOLERANCES, None)]
    if not quick:
        kinds.append(("the equations as printed", True, 2, (1e-6, 1e-7, 1e-8), AtLeast(300)))
    for name, plain, count, tolerances, goal in kinds:
        reference = simulate_ensemble(loops[:count], DURATION, relative_tolerance=_TIGHT)
        accuracy, cpu = np.inf, np.nan
        for tolerance in tolerances:
            errors, wall, cpu = scipy_pool(plants[:count], plain, tolerance, 2)
            accuracy = nearness(errors, reference.final_errors)
            lines.append(
                _line(f"SciPy Radau, {name}", tolerance, count, accuracy, wall / count, cpu)
            )
            if accuracy <= _ACCURACY:
                break
        for used in (_TOLERANCE, 3e-7, 1e-7):
            ours = simulate_ensemble(loops[:count], DURATION, relative_tolerance=used)
            own = nearness(ours.final_errors, reference.final_errors)
            if own <= _ACCURACY:
                break
        repeated = loops[:count] * (40 // count)

        def ensemble(repeated: list[ClosedLoop] = repeated, used: float = used) -> None:
            on_two_threads(repeated, used)

        (timing,) = measure(ensemble, repetitions=5, clock=time.process_time)
        comparisons.append(
            Comparison(
                "the same, processor's time per run on two cores",
                Side(
                    f"ensemble, two threads, rtol {used:.0e}, accuracy {own:.1e}",
                    timing.per(len(repeated)),
                ),
                Side(
                    f"SciPy Radau, {name}, two processes, rtol {tolerance:.0e}, accuracy "
                    f"{accuracy:.1e}",
                    Timing(cpu, cpu, 1),
                ),
                goal,
            )
        )
    return comparisons, lines


def _diffrax(
    plants: list[Plant], loops: list[ClosedLoop], quick: bool
) -> tuple[list[Comparison], list[tuple[str, ...]]]:
    """Compare with diffrax's vmap on the ensemble and on a nonstiff one."""
    law = pd_gravity()
    calm = replace(table1_loop((1, 2, 3)), controller=law)
    easy = [with_plant(calm, plant) for plant in plants]
    gains = law.parameters["proportional"], law.parameters["derivative"]
    few = sized(8, 2) if quick else 16
    stiff = _Setting("the same", loops[:few], True, plants[:few], None, _STIFF_SOLVERS)
    plain = _Setting("the same plants under PD control, not stiff", easy, False, plants, gains)
    comparisons, lines = [], []
    for setting in (stiff, plain):
        try:
            comparison, tried = setting.compare(1 if quick or setting.stiff else 5)
        except ImportError:
            return [], [("diffrax, vmap", "–", "–", "not installed", "–", "–")]
        comparisons.append(comparison)
        lines += tried
    return comparisons, lines


@dataclass(frozen=True)
class _Setting:
    """One ensemble, for flexid and for diffrax."""

    name: str
    loops: list[ClosedLoop]
    stiff: bool
    plants: list[Plant]
    gains: tuple[float, float] | None
    solvers: tuple[str, ...] = ("Tsit5", "Dopri5", "Dopri8")

    def ensemble(self, tolerance: float = _TOLERANCE) -> Ensemble:
        return simulate_ensemble(
            self.loops, DURATION, relative_tolerance=tolerance, stiff=self.stiff
        )

    def compare(self, repetitions: int) -> tuple[Comparison, list[tuple[str, ...]]]:
        """Compare flexid on one thread with the fastest of diffrax's solvers, at one tolerance."""
        reference, count = self.ensemble(_TIGHT).final_errors, len(self.loops)
        calls = [
            diffrax_ensemble(self.plants, self.gains, _TOLERANCE, solver) for solver in self.solvers
        ]
        own, *others = measure(
            self.ensemble, *calls, repetitions=repetitions, clock=time.process_time
        )
        lines, sides = [], []
        for solver, call, timing in zip(self.solvers, calls, others, strict=True):
            name = f"diffrax {solver}, vmap"
            errors, wall = timed(call)
            accuracy, each = nearness(errors, reference), timing.per(count)
            lines.append(_line(name, _TOLERANCE, count, accuracy, wall / count, each.median))
            sides.append(Side(f"{name}, accuracy {accuracy:.1e}", each))
        accuracy = nearness(self.ensemble().final_errors, reference)
        comparison = Comparison(
            f"{self.name}, rtol {_TOLERANCE:g}, processor's time per run",
            Side(f"ensemble, one thread, accuracy {accuracy:.1e}", own.per(count)),
            min(sides, key=lambda side: side.timing.median),
            None if self.stiff else AtLeast(10),
        )
        return comparison, lines


def _line(
    name: str, tolerance: float, count: int, accuracy: float, wall: float, cpu: float
) -> tuple[str, ...]:
    return (
        name,
        f"{tolerance:.0e}",
        str(count),
        f"{accuracy:.1e}",
        f"{1e3 * wall:.3g} ms",
        f"{1e3 * cpu:.3g} ms",
    )
