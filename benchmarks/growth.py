"""Growth of the cost with the length of a record, the number of coefficients, and of runs.

    python -m benchmarks.growth

in the root of a clone draws `docs/assets/growth.png` and prints the table of `docs/comparison.md`.
Times are processor times, which depend little on other work of the machine.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.report import markdown
from benchmarks.size import sized
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.preparation.joint import flexible
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.laws import pd_gravity
from flexid.paper.loop import sinusoid
from flexid.report.figure import BLUE, GREEN, ORANGE, new_figure, save
from flexid.simulation.closed_loop import ClosedLoop, simulate
from flexid.simulation.ensemble import simulate_ensemble
from flexid.simulation.free_run import free_run
from flexid.simulation.sampled import simulate_sampled
from flexid.studies.runs import TRUE, table1_loop

ASSETS = Path("docs/assets")

SAMPLE_TIME = 1e-3  # s
NOISE = 1e-5  # rad
LENGTHS = sized(
    (3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000), (2_000, 3_000, 4_000)
)  # samples
RUN_LENGTHS = sized((3.0, 10.0, 30.0, 100.0), (1.0, 2.0, 3.0))  # s
RUNS = sized((1, 3, 10, 30, 100), (1, 2, 3))
_REPETITIONS = sized(3, 1)

JOINT = flexible()
SYSTEM = JOINT.systems[0]
PAPER = ("gravity", "motor_viscous")
CONTINUOUS = table1_loop((1, 2, 3))
SAMPLED = ClosedLoop(  # the gain of the paper's law is too high for sampling at 1 kHz
    flexible_joint(known={"beta1": TRUE["beta1"]}),
    {name: TRUE[name] for name in ("theta1", "theta2", "alpha1", "alpha2")},
    pd_gravity(),
    sinusoid(1.0, 2.0),
    {"link": 1.0, "motor": 1.0},
)


@dataclass(frozen=True)
class Growth:
    """Cost of one job as a function of its size.

    Parameters
    ----------
    job : str
        Name of the job.
    sizes : sequence of float
        Sizes of the job.
    seconds : list of float
        Processor times in s, minimum of some repetitions.
    """

    job: str
    sizes: Sequence[float]
    seconds: list[float]

    @property
    def exponent(self) -> float:
        """Exponent of the growth: slope of the logarithms over the larger half of the sizes."""
        half = len(self.sizes) // 2
        fit = np.polyfit(np.log(self.sizes[half:]), np.log(self.seconds[half:]), 1)
        return float(fit[0])

    def cells(self, label: str) -> tuple[str, ...]:
        """Return the line of the table."""
        sizes, seconds = self.sizes, self.seconds
        return (
            self.job,
            f"{sizes[0]:g} to {sizes[-1]:g} {label}",
            f"{seconds[0]:.2g} to {seconds[-1]:.2g} s",
            f"{self.exponent:.2f}",
        )


def record(count: int) -> Samples:
    """Simulate the paper's joint under a multisine torque, with noisy positions."""
    generator = np.random.default_rng(5)
    instants = SAMPLE_TIME * np.arange(count)
    tones, amplitudes = np.array([0.7, 5.3, 17.0, 25.0]), np.array([4.0, 6.0, 5.0, 6.0])
    torque = np.sin(np.outer(instants, tones) + generator.uniform(0, 2 * np.pi, 4)) @ amplitudes
    values = {name: TRUE.get(name, 0.0) for name in SYSTEM.coefficients}
    states = free_run(SYSTEM, values, np.zeros(4), torque, SAMPLE_TIME)
    positions = states[:, ::2] + NOISE * generator.standard_normal((count, 2))
    velocities = np.ascontiguousarray(states[:, 1::2])
    return Samples(positions, velocities, torque[:, None], SAMPLE_TIME)


def least(call: Callable[[], object]) -> float:
    """Return the minimum processor time of a call in s, after a warm-up."""
    call()
    taken = []
    for _ in range(_REPETITIONS):
        start = time.process_time()
        call()
        taken.append(time.process_time() - start)
    return min(taken)


def _sought(terms: Sequence[str]) -> Unknowns:
    """Return the coefficients of a model with only these terms."""
    kept = {c for term in terms for c in JOINT.terms[term]}
    return JOINT.unknowns(JOINT.optional - kept, {}, (0,))


def with_length() -> list[Growth]:
    """Measure estimators and simulations over the length of the record."""
    longest = record(LENGTHS[-1])

    def part(count: int) -> list[Samples]:
        assert longest.velocities is not None
        cut = (longest.positions[:count], longest.velocities[:count], longest.inputs[:count])
        return [Samples(*cut, SAMPLE_TIME)]

    unknowns = _sought(PAPER)
    jobs: dict[str, Callable[[list[Samples]], object]] = {
        "least squares with its covariance": lambda recordings: (
            filtered_least_squares(recordings, SYSTEM, unknowns=unknowns).covariance
        ),
        "prediction error, 1 s": lambda recordings: prediction_error(
            recordings, SYSTEM, _start(recordings), unknowns=unknowns
        ),
    }

    def _start(recordings: list[Samples]) -> LeastSquaresFit:
        return filtered_least_squares(recordings, SYSTEM, unknowns=unknowns)

    grown = [
        Growth(job, LENGTHS, [least(lambda n=n, call=call: call(part(n))) for n in LENGTHS])
        for job, call in jobs.items()
    ]
    for job, call, loop in (
        ("continuous run", simulate, CONTINUOUS),
        ("sampled run", simulate_sampled, SAMPLED),
    ):
        seconds = [least(lambda d=d, call=call, loop=loop: call(loop, d)) for d in RUN_LENGTHS]
        grown.append(Growth(job, [d / SAMPLE_TIME for d in RUN_LENGTHS], seconds))
    return grown


def with_coefficients() -> list[Growth]:
    """Measure estimators over the number of unknown coefficients, with 30 000 samples."""
    recordings = [record(sized(30_000, 3_000))]
    terms = [term for term, names in JOINT.terms.items() if not {*names} & JOINT.shapes]
    chosen = [PAPER, *(tuple({*PAPER, *terms[:n]}) for n in range(3, sized(len(terms) + 1, 6), 2))]
    unknowns = [_sought(names) for names in chosen]
    sizes = [len(sought.names) for sought in unknowns]

    def start(sought):
        return filtered_least_squares(recordings, SYSTEM, unknowns=sought)

    return [
        Growth(
            "least squares with its covariance",
            sizes,
            [least(lambda u=u: start(u).covariance) for u in unknowns],
        ),
        Growth(
            "prediction error, 1 s",
            sizes,
            [
                least(lambda u=u: prediction_error(recordings, SYSTEM, start(u), unknowns=u))
                for u in unknowns
            ],
        ),
    ]


def with_runs() -> list[Growth]:
    """Measure an ensemble of Table I's loop over its number of runs, on one thread."""
    generator = np.random.default_rng(3)
    loops = [table1_loop((1, 2, 3), k=float(k)) for k in generator.uniform(10.0, 50.0, RUNS[-1])]
    seconds = [least(lambda n=n: simulate_ensemble(loops[:n], 30.0)) for n in RUNS]
    return [Growth("ensemble, 30 s each", RUNS, seconds)]


def draw(groups: Sequence[tuple[str, Sequence[Growth]]]) -> None:
    """Draw one panel for each kind of size."""
    figure = new_figure(9.0, 3.2)
    for axes, (label, jobs) in zip(figure.subplots(1, len(groups)), groups, strict=True):
        for growth, colour in zip(jobs, (BLUE, ORANGE, GREEN, "#7b5ea7"), strict=False):
            axes.loglog(growth.sizes, growth.seconds, "o-", color=colour, ms=3, label=growth.job)
        axes.set_xlabel(label)
        if label == "coefficients":  # only a few numbers, so each gets a tick
            axes.set_xscale("linear")
        axes.legend(loc="best", fontsize=7, frameon=False)
        axes.margins(y=0.15)
    figure.axes[0].set_ylabel("processor time [s]")
    save(figure, ASSETS, "growth")


def main() -> None:
    groups = [
        ("samples", with_length()),
        ("coefficients", with_coefficients()),
        ("runs", with_runs()),
    ]
    draw(groups)
    lines = [job.cells(label) for label, jobs in groups for job in jobs]
    headings = ("job", "size", "processor time", "exponent")
    print("\n".join(markdown(headings, lines)))


if __name__ == "__main__":
    main()
